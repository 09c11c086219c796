# SPDX-License-Identifier: Apache-2.0
"""Is this machine one that the packages run on? Every problem is named with its remedy, all at once."""

import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

from tooling.layout import SetupError

OLDEST_GLIBC = (2, 28)  # the ROS wheels are manylinux_2_28
LINKED = ("sim_core", "hardware_bridge")  # from ros_ws/src, so that colcon finds them
DISK_NEEDED_BYTES = 1_500_000_000  # .venv takes 0.6 GB in the end; pip's downloads and the build want room, too

_PLATFORM_REMEDY = "use an x86-64 Linux machine (a virtual machine or container will do), or ROS 2 Jazzy with colcon"


def platform_problems() -> list[str]:
    """Why this platform does not do; empty: it does."""
    system, machine = platform.system(), platform.machine()
    if system != "Linux" or machine not in ("x86_64", "amd64"):
        return [f"the ROS 2 wheels exist for Linux on x86-64 only, this is {system} on {machine}: {_PLATFORM_REMEDY}"]
    name, _, version = (_libc() or "no glibc").partition(" ")
    if name != "glibc" or tuple(int(part) for part in version.split(".")[:2]) < OLDEST_GLIBC:
        wanted = ".".join(map(str, OLDEST_GLIBC))
        return [f"needs glibc {wanted} or newer, found {name} {version}: {_PLATFORM_REMEDY}"]
    return []


def _libc() -> str | None:
    try:
        return os.confstr("CS_GNU_LIBC_VERSION")
    except (ValueError, OSError):  # musl knows no such name
        return None


def compiler_problems(environ: Mapping[str, str]) -> list[str]:
    """The message package is C and C++; CMake itself comes as a wheel, make does not."""
    path = environ.get("PATH")
    wanted = {
        "a C compiler (cc, gcc or clang)": environ.get("CC", "cc gcc clang"),
        "a C++ compiler (c++, g++ or clang++)": environ.get("CXX", "c++ g++ clang++"),
        "make": "make gmake",
    }
    missing = [what for what, names in wanted.items() if not any(shutil.which(name, path=path) for name in names.split())]
    if not missing:
        return []
    return [f"lacks {' and '.join(missing)}: on Debian or Ubuntu, sudo apt install build-essential"]


def disk_problems(root: Path) -> list[str]:
    """Why the disk does not do; empty: it does."""
    free = shutil.disk_usage(root).free
    if free >= DISK_NEEDED_BYTES:
        return []
    return [f"{free / 1e9:.1f} GB free under {root}, set-up needs {DISK_NEEDED_BYTES / 1e9:.1f} GB: make room"]


def path_problems(root: Path) -> list[str]:
    """Executables get headers without quotes, and search paths have no way to escape a colon."""
    if any(c.isspace() or c in ":;$\"'\\" for c in str(root)):
        return [f"the path {str(root)!r} holds a space or another character that ROS's build tools cannot take: move it"]
    return []


def checkout_problems(root: Path) -> list[str]:
    """What git, or whatever brought the files here, made of the checkout."""
    problems = []
    if lacking := [name for name in LINKED if not (root / "ros_ws" / "src" / name).is_dir()]:
        remedy = "git config core.symlinks true, git checkout -- ros_ws/src; or clone it again where there are links"
        problems.append(f"the symbolic links {' and '.join(lacking)} in {root}/ros_ws/src are none: {remedy}")
    if any(b"\r\n" in path.read_bytes() for path in (root / "sixstrut", Path(__file__))):
        problems.append(f"the lines of files in {root} end with CR LF: clone it again with git, which leaves them as they are")
    return problems


def file_system_problems(folder: Path) -> list[str]:
    """What set-up does with files that this file system cannot: links, and programs that run."""
    try:
        with tempfile.TemporaryDirectory(dir=folder) as name:
            script = Path(name) / "script"
            script.write_text("#!/bin/sh\n", encoding="utf-8")
            script.chmod(0o755)
            script.with_name("link").symlink_to(script)
            subprocess.run([script.with_name("link")], check=False)
    except OSError as error:
        problem = f"the file system of {folder} holds no symbolic links or runs no programs ({error.strerror})"
        return [f"{problem}: move the checkout to a local disk"]
    return []


def check(root: Path, environ: Mapping[str, str], *, needs_disk: bool) -> None:
    """Raises SetupError naming everything that would stop set-up later."""
    problems = platform_problems() + path_problems(root) + compiler_problems(environ)
    problems += checkout_problems(root) + file_system_problems(root)
    if needs_disk:
        problems += disk_problems(root)
    if problems:
        raise SetupError("\n".join(problems))
