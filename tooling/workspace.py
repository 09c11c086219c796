# SPDX-License-Identifier: Apache-2.0
"""Builds ros_ws with colcon, and keeps what its set-up script would export."""

import json
import os
import shutil
import subprocess
from collections.abc import Mapping
from typing import Any

from tooling import environment, packages, stamps
from tooling.layout import Layout, SetupError
from tooling.process import Runner
from tooling.progress import Progress

STEPS = 1  # that `build` takes
_RECORD = "sixstrut.json"


def _record(layout: Layout) -> dict[str, Any]:
    """What the last build noted in the install folder: {} where there is none of ours, {"stamp": None} during one."""
    try:
        text = (layout.install / _RECORD).read_text(encoding="utf-8")
        return dict(json.loads(text))
    except (FileNotFoundError, ValueError):
        return {}


def made_by_us(layout: Layout) -> bool:
    """Whether set-up made what is installed."""
    return (layout.install / _RECORD).exists()


def ready(layout: Layout) -> bool:
    """Whether the workspace is built from these sources."""
    return _record(layout).get("stamp") == stamps.workspace_stamp(layout)


def paths(layout: Layout) -> environment.Paths:
    """The search paths of the built workspace, as its local_setup.sh gives them."""
    return dict(_record(layout)["paths"])


def build(layout: Layout, runner: Runner, environ: Mapping[str, str]) -> None:
    """Build the workspace with colcon."""
    names = [folder.name for folder in stamps.package_folders(layout)]
    with runner.progress.step(f"building ros_ws ({len(names)} packages)"):
        base = {"packages": names, "base": stamps.packages_stamp(layout, "base")}
        _clear_if_outdated(layout, base)
        _write(layout, {**base, "stamp": None})
        counter = _Counter(len(names), runner.progress)
        with packages.build_tools(layout, runner, environ) as tools:
            inside = environment.applied(environ, environment.underlay(environ, layout))
            inside.setdefault("HOME", str(layout.state))  # colcon ends where a user without a home has none
            inside["PATH"] = f"{tools}{os.pathsep}{inside['PATH']}"
            runner.run("building ros_ws", _command(layout), cwd=layout.workspace, environ=inside, on_line=counter.line)
        _write(layout, {**base, "stamp": stamps.workspace_stamp(layout), "paths": _sourced(layout)})
        runner.progress.result(f"{len(names)} packages")


def remove(layout: Layout) -> None:
    """Remove what was built."""
    for name in ("build", "log", "install"):  # install last: it holds the record that says they are ours
        shutil.rmtree(layout.workspace / name, ignore_errors=True)


def _command(layout: Layout) -> list[str]:
    python = str(layout.venv_python)
    return [
        python,
        str(layout.venv / "bin" / "colcon"),
        "--log-base=log",
        "build",
        "--base-paths",
        *(str(folder.relative_to(layout.workspace)) for folder in stamps.package_folders(layout)),
        "--build-base=build",
        "--install-base=install",
        "--symlink-install",
        "--event-handlers=console_cohesion+",
        "--cmake-args",
        "-DBUILD_TESTING=OFF",
        "-DPYTHON_ONLY=ON",
        # Otherwise CMake may prefer another, newer Python that it finds on the machine.
        f"-DPython3_EXECUTABLE={python}",
    ]


def _clear_if_outdated(layout: Layout, base: Mapping[str, Any]) -> None:
    """A build on other Python packages, or with a package that is gone, is of no use. Somebody else's is theirs."""
    if not layout.install.exists():
        return
    if not made_by_us(layout):
        raise SetupError(
            f"{layout.install} was built by another colcon (of an installed ROS?), and the two do not mix.\n"
            f"Remove {layout.workspace}/build, install and log, or use another checkout, and run this again"
        )
    record = _record(layout)
    if any(record.get(name) != value for name, value in base.items()):
        remove(layout)


def _write(layout: Layout, record: Mapping[str, Any]) -> None:
    layout.install.mkdir(exist_ok=True)
    new = layout.install / f"{_RECORD}.new"
    new.write_text(json.dumps(record, indent=1), encoding="utf-8")
    new.replace(layout.install / _RECORD)


def _sourced(layout: Layout) -> environment.Paths:
    """Asks the set-up script once, so that starting a command needs no shell."""
    script = layout.install / "local_setup.sh"
    command = ["/bin/sh", "-c", '. "$1" && env -0', "sh", str(script)]
    environ = {"PATH": os.defpath, "COLCON_CURRENT_PREFIX": str(layout.install)}
    output = subprocess.run(command, env=environ, capture_output=True, check=True).stdout.decode()
    values = dict(entry.partition("=")[::2] for entry in output.split("\0") if entry)
    found = {name: environment.split(values.get(name, "")) for name in environment.WORKSPACE_VARIABLES}
    return {name: entries for name, entries in found.items() if entries}


class _Counter:
    """Turns colcon's lines into '2 of 5 packages'."""

    def __init__(self, total: int, progress: Progress) -> None:
        self._total, self._progress = total, progress
        self._finished = 0
        self._busy: list[str] = []

    def line(self, line: str) -> None:
        word, arrow, rest = line.partition(" >>> ") if " >>> " in line else line.partition(" <<< ")
        name = rest.split(" ")[0]
        if arrow == " >>> " and word == "Starting":
            self._busy.append(name)
        elif arrow == " <<< " and name in self._busy:
            self._busy.remove(name)
            self._finished += 1
        else:
            return
        busy = f" (now {', '.join(self._busy)})" if self._busy else ""
        self._progress.update(f"built {self._finished} of {self._total} packages{busy}")
