# SPDX-License-Identifier: Apache-2.0
"""The environment that ROS programs of this checkout run in.

The virtual environment is the underlay (its `share` and `lib` hold the ROS wheels), ros_ws/install lies over it. An apt
ROS that the user has sourced, or another checkout's environment, is taken out first: two builds of the same libraries
in one process end in crashes.
"""

import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path

from tooling.layout import Layout

Paths = dict[str, list[str]]
Changes = dict[str, str | None]  # None: remove the variable

# What a workspace's local_setup script may set.
WORKSPACE_VARIABLES = ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "PKG_CONFIG_PATH")

_PREFIX_VARIABLES = ("AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH")
_BOOTSTRAPPED = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"


def underlay(environ: Mapping[str, str], layout: Layout) -> Changes:
    """The ROS wheels alone, as colcon needs them."""
    foreign = _foreign_prefixes(environ)
    changes: Changes = {
        name: _join(_without(split(environ.get(name, "")), foreign))
        for name in ("CMAKE_PREFIX_PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "PKG_CONFIG_PATH")
    }
    venv_bin = str(layout.venv / "bin")
    path = [entry for entry in _without(split(environ.get("PATH", "")), foreign) if entry != venv_bin]
    changes |= {
        "PATH": _join([venv_bin, *path]),
        "VIRTUAL_ENV": str(layout.venv),
        "AMENT_PREFIX_PATH": str(layout.venv),
        "COLCON_PREFIX_PATH": None,
        "PYTHONHOME": None,
        # Set by the wheels for their own interpreter and inherited by all below it, where they do harm.
        _BOOTSTRAPPED: None,
        "ROS_DISTRO": "jazzy",
        "ROS_VERSION": "2",
        "ROS_PYTHON_VERSION": "3",
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",  # the only one among the wheels
        "ROS_AUTOMATIC_DISCOVERY_RANGE": _discovery_range(environ, [p for p in foreign if not p.is_relative_to(layout.root)]),
    }
    return changes


def overlay(environ: Mapping[str, str], layout: Layout, workspace: Paths) -> Changes:
    """The wheels with ros_ws on top: for a shell."""
    changes = underlay(environ, layout)
    for name, entries in workspace.items():
        changes[name] = _join([*entries, *split(changes.get(name) or "")])
    changes["COLCON_PREFIX_PATH"] = str(layout.install)
    changes["SIXSTRUT_ROOT"] = str(layout.root)
    return changes


def for_command(environ: Mapping[str, str], layout: Layout, workspace: Paths) -> Changes:
    """The same, and what the wheels' own start hook would add by starting Python a second time."""
    changes = overlay(environ, layout, workspace)
    libraries = [str(layout.venv / "lib"), *map(str, sorted(layout.venv.glob("lib/python3*/site-packages/ros_*.libs")))]
    changes["LD_LIBRARY_PATH"] = _join([*libraries, *split(changes["LD_LIBRARY_PATH"] or "")])
    changes[_BOOTSTRAPPED] = "1"
    return changes


def applied(environ: Mapping[str, str], changes: Changes) -> dict[str, str]:
    """The environment after the changes."""
    merged = {**environ, **changes}
    return {name: value for name, value in merged.items() if value is not None}


def exports(changes: Changes) -> str:
    """Lines for `eval` in a POSIX shell."""
    lines = []
    for name, value in sorted(changes.items()):
        lines.append(f"unset {name}" if value is None else f"export {name}={shlex.quote(value)}")
    return "\n".join(lines)


def split(value: str) -> list[str]:
    """Entries of a search path, without the empty ones (which would mean the current folder)."""
    return [entry for entry in value.split(":") if entry]


def _join(entries: Iterable[str]) -> str | None:
    return ":".join(dict.fromkeys(entries)) or None


def _foreign_prefixes(environ: Mapping[str, str]) -> list[Path]:
    """Every ROS prefix that is in effect, our own from an earlier `sixstrut env` included: they are all set anew.

    Beside an install folder lies the build folder that colcon's --symlink-install puts on PYTHONPATH.
    """
    prefixes = [Path(entry) for name in _PREFIX_VARIABLES for entry in split(environ.get(name, ""))]
    builds = [prefix.parent / "build" for prefix in map(Path, split(environ.get("COLCON_PREFIX_PATH", "")))]
    return prefixes + builds


def _without(entries: list[str], prefixes: list[Path]) -> list[str]:
    return [entry for entry in entries if not any(Path(entry).is_relative_to(prefix) for prefix in prefixes)]


def _discovery_range(environ: Mapping[str, str], foreign: list[Path]) -> str:
    """This machine only, unless the user chose otherwise. SUBNET beside a sourced ROS is a default, not a choice."""
    asked = environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE")
    return "LOCALHOST" if asked is None or (asked == "SUBNET" and foreign) else asked
