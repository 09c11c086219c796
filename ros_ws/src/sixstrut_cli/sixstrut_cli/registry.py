# SPDX-License-Identifier: Apache-2.0
"""The table of commands. Standard library only: set-up reads it before anything is installed."""

import shutil
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple


class Entry(NamedTuple):
    """One command."""

    name: str
    help: str  # one line
    module: str | None  # in sixstrut_cli.commands; None: done by tooling/bootstrap.py before Python packages are there
    group: str  # one of GROUPS
    packages: tuple[str, ...] = ()  # groups of packages that it needs beside the base; tooling/packages.py


START, SIMULATE, ROBOT, TRIALS, DEVELOP = "Start here", "Simulate", "Robot", "Trials", "Develop"
GROUPS = (START, SIMULATE, ROBOT, TRIALS, DEVELOP)
"""Of the help, in this order."""

_FOR_TESTS = ("console", "cluster", "checks", "bench")
_ALL = (
    Entry("demo", "Roll the virtual prototype with its twin, no hardware needed.", "robot.demo", START),
    Entry("console", "The robot in the browser: twin, rolls by clicks, a stop button.", "robot.console", START, ("console",)),
    Entry("roll", "Simulate one roll and judge it.", "model.roll", START),
    Entry("replay", "Step the twin through a recorded session and compare.", "trials.replay", START),
    Entry("doctor", "Check port, pairing, calibration, disk and versions; say how to mend each.", "robot.doctor", START),
    Entry("rehearse", "Try a roll on perturbed robots before the real one does it.", "model.rehearse", SIMULATE),
    Entry("route", "The likeliest sequence of rolls from one face to another, or to a place.", "model.route", SIMULATE),
    Entry("robustness", "Try a library's 24 gaits on perturbed prototypes: rates, what kills them.", "model.robustness", SIMULATE),
    Entry("climb", "How steep each primitive of a library still rolls uphill.", "model.climb", SIMULATE),
    Entry("search", "Find primitives with a genetic algorithm: improved, previous or robust.", "model.search", SIMULATE),
    Entry("recheck", "Compare both models' predictions with experiments, gait by gait.", "model.recheck", SIMULATE),
    Entry("parameters", "Show the parameters of robot and model, with their sources.", "model.parameters", SIMULATE),
    Entry("export", "Write the robot as URDF or MJCF, for viewers and other simulators.", "model.export", SIMULATE),
    Entry("calibrate-model", "Scale the ropes until the first frequency is the given one.", "model.calibrate_model", SIMULATE),
    Entry("calibrate", "Measure the robot's struts with a person at the keyboard; write a calibration.", "robot.calibrate", ROBOT),
    Entry("travel", "Roll the virtual prototype to a place on the floor, replanned after every roll.", "robot.travel", ROBOT),
    Entry("play", "Play a recorded session into ROS, for a twin and viewers.", "robot.play", ROBOT),
    Entry("foxglove", "Serve the live stack to the Foxglove app, with a stop button.", "robot.foxglove", ROBOT, ("console",)),
    Entry("trial", "Run a session of trials, a day long and resumable: primitives × gaits × repeats.", "trials.trial", TRIALS),
    Entry("report", "Success rates, intervals and tests of sessions, as a page with Figure 8.", "trials.report", TRIALS),
    Entry("odds", "Were the predicted success probabilities right? Bags against what happened.", "trials.odds", TRIALS),
    Entry("fit", "Learn from trials: robots that would have had them, and how likely each gait is.", "trials.fit", TRIALS),
    Entry("campaign", "Whole libraries in virtual trials, fast; a sample through the whole stack.", "trials.campaign", TRIALS),
    Entry("validate", "Compare the solver with closed forms.", "model.validate", DEVELOP),
    Entry("bench", "Measure the solver beside MuJoCo, or the stack's own cost.", "develop.bench", DEVELOP, ("bench",)),
    Entry("faults", "Make failures happen to the stack and look what comes of each.", "develop.faults", DEVELOP),
    Entry("docs", "Write the reference from the code; build the documentation's site.", "develop.docs", DEVELOP, ("docs",)),
    Entry("test", "Run the checks and tests; with arguments, only pytest with these.", "develop.test", DEVELOP, _FOR_TESTS),
    Entry("setup", "Only set up: .venv, the build of ros_ws, and the packages of groups named, such as cluster.", None, DEVELOP),
    Entry("env", 'Print the environment for a shell: eval "$(./sixstrut env)"', None, DEVELOP),
    Entry("clean", "Remove what set-up made.", None, DEVELOP),
)

_OPTIONS = {"--scheduler": "cluster", "--console": "console"}
"""Options of any command -> the group of packages that they need."""

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


def packages_of(name: str | None, arguments: Sequence[str]) -> tuple[str, ...]:
    """Groups of packages that a command line needs beside the base."""
    groups = next((entry.packages for entry in _ALL if entry.name == name), ())
    return (*groups, *(group for option, group in _OPTIONS.items() if any(word.split("=")[0] == option for word in arguments)))


def static_help(name: str | None) -> str:
    """Help without the command's own options, for a checkout that is not set up."""
    for entry in entries():
        if entry.name == name:
            more = "" if entry.module is None else "\n\nIts options: ./sixstrut setup, then this again."
            return f"Usage: ./sixstrut {name}\n\n{entry.help}{more}"
    width, room = max(map(len, names())), shutil.get_terminal_size().columns
    lines = []
    for group in GROUPS:
        lines += ["", f"{group}:", *(_line(entry, width, room) for entry in entries() if entry.group == group)]
    return "\n".join(
        [
            "Usage: ./sixstrut COMMAND [OPTIONS]",
            "",
            textwrap.fill("A six-strut rolling tensegrity robot: its model, its gaits, its ROS 2 nodes.", room),
            *lines,
            "",
            textwrap.fill(
                "The first command installs packages into .venv and builds ros_ws, once; one that needs more adds it.", room
            ),
        ]
    )


def _line(entry: Entry, width: int, room: int) -> str:
    return textwrap.fill(f"  {entry.name:{width}}  {entry.help}", room, subsequent_indent=" " * (width + 4))
