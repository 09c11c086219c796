# SPDX-License-Identifier: Apache-2.0
"""The table of commands. Standard library only: set-up reads it before anything is installed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple


class Entry(NamedTuple):
    """One command."""

    name: str
    help: str  # one line
    module: str | None  # in sixstrut_cli.commands; None: done by tooling/bootstrap.py before Python packages are there
    groups: tuple[str, ...] = ()  # of packages that it needs beside the base; tooling/packages.py


_ALL = (
    Entry("demo", "Roll the virtual prototype with its twin, no hardware needed.", "robot.demo"),
    Entry("roll", "Simulate one roll and judge it.", "model.roll"),
    Entry("search", "Find primitives with a genetic algorithm: improved, previous or robust.", "model.search"),
    Entry("route", "The likeliest sequence of rolls from one face to another.", "model.route"),
    Entry("travel", "Roll the virtual prototype to a place on the floor, replanned after every roll.", "robot.travel"),
    Entry("rehearse", "Try a roll on perturbed robots before the real one does it: odds and outcomes.", "model.rehearse"),
    Entry("robustness", "Try a library's 24 gaits on perturbed prototypes: rates, intervals, what kills them.", "model.robustness"),
    Entry("climb", "How steep each primitive of a library still rolls uphill.", "model.climb"),
    Entry("recheck", "Compare both models' predictions with experiments, gait by gait.", "model.recheck"),
    Entry("trial", "Run a session of trials, a day long and resumable: primitives × gaits × repeats.", "trials.trial"),
    Entry("report", "Success rates, intervals and tests of sessions, as a page with the paper's Figure 8.", "trials.report"),
    Entry("odds", "Set the rehearsals' odds in any bags against what then happened: a calibration plot.", "trials.odds"),
    Entry(
        "campaign", "Whole libraries on virtual prototypes, fast, and a sample of it through the whole stack.", "trials.campaign"
    ),
    Entry("fit", "Learn from trials: an ensemble of robots that would have had them, and odds of every gait.", "trials.fit"),
    Entry("console", "The robot in the browser: twin, odds, rolls by clicks, a stop button.", "robot.console", ("console",)),
    Entry("foxglove", "Serve the live stack to the Foxglove app: every topic, and a stop button.", "robot.foxglove", ("console",)),
    Entry("replay", "Step the twin through a recorded session and compare.", "trials.replay"),
    Entry("play", "Play a recorded session into ROS, for a twin and viewers.", "robot.play"),
    Entry("calibrate", "Measure the robot's struts with a person at the keyboard; write a calibration.", "robot.calibrate"),
    Entry("doctor", "Check port, pairing, calibration, disk and versions; say how to mend each.", "robot.doctor"),
    Entry("parameters", "Show the parameters of robot and model, with their sources.", "model.parameters"),
    Entry("calibrate-model", "Scale the ropes until the first natural frequency is the given one.", "model.calibrate_model"),
    Entry("bench", "Measure the solver beside MuJoCo, or the stack's own cost.", "develop.bench", ("bench",)),
    Entry("faults", "Make failures happen to the stack and look what comes of each.", "develop.faults"),
    Entry("validate", "Compare the solver with closed forms and independent computations.", "model.validate"),
    Entry("docs", "Write the reference pages from the code, and build the documentation's site.", "develop.docs", ("docs",)),
    Entry(
        "test",
        "Run the checks and tests; with arguments, only pytest with these.",
        "develop.test",
        ("console", "cluster", "checks"),
    ),
    Entry("setup", "Only set up: .venv with all packages, and the build of ros_ws.", None),
    Entry("env", 'Print the environment for a shell: eval "$(./sixstrut env)"', None),
    Entry("clean", "Remove what set-up made.", None),
)

SETUP_COMMANDS = frozenset(entry.name for entry in _ALL if entry.module is None)

_COMMANDS = Path(__file__).parent / "commands"


def entries() -> list[Entry]:
    """The commands, in the order of the help.

    Raises:
        FileNotFoundError: A command's module is not where this table says.
    """
    missing = [
        entry.module
        for entry in _ALL
        if entry.module and not _COMMANDS.joinpath(*entry.module.split(".")).with_suffix(".py").is_file()
    ]
    if missing:
        raise FileNotFoundError(f"registry.py names commands whose modules are missing in {_COMMANDS}: {', '.join(missing)}")
    return list(_ALL)


def names() -> list[str]:
    """Names of all commands."""
    return [entry.name for entry in entries()]


def groups_of(name: str | None, arguments: Sequence[str]) -> tuple[str, ...]:
    """Groups of packages that a command line needs beside the base."""
    groups = next((entry.groups for entry in _ALL if entry.name == name), ())
    return (*groups, "cluster") if any(word.split("=")[0] == "--scheduler" for word in arguments) else groups


def static_help(name: str | None) -> str:
    """Help without the command's own options, for a checkout that is not set up."""
    for entry in entries():
        if entry.name == name:
            more = "" if entry.module is None else "\n\nIts options: ./sixstrut setup, then this again."
            return f"Usage: ./sixstrut {name}\n\n{entry.help}{more}"
    width = max(map(len, names()))
    lines = [f"  {entry.name:{width}}  {entry.help}" for entry in entries()]
    return "\n".join(
        [
            "Usage: ./sixstrut COMMAND [OPTIONS]",
            "",
            "A six-strut rolling tensegrity robot: its model, its gaits, its ROS 2 nodes.",
            "",
            "Commands:",
            *lines,
            "",
            "The first command that needs them installs all packages into .venv and builds ros_ws, once.",
        ]
    )
