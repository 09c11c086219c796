# SPDX-License-Identifier: Apache-2.0
"""What set-up's results depend on, as short hashes: the same stamp means nothing has to be done."""

import hashlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

from tooling.layout import Layout

# Files whose content colcon turns into something else. With --symlink-install all other files are used where they are.
_BUILT_NAMES = ("package.xml", "setup.py", "setup.cfg", "CMakeLists.txt")
_BUILT_SUFFIXES = (".msg", ".srv", ".action")
# Folders whose files are linked one by one: a new name needs a build, a new content does not.
_LINKED_FOLDERS = ("launch", "config", "rviz", "resource")
_SKIPPED_FOLDERS = ("__pycache__", "build", "install", "log")


def python_identity() -> str:
    """The interpreter a virtual environment is made from, as far as what is built in it depends on it."""
    return f"{sys.implementation.cache_tag} {sys.base_prefix}"


def packages_stamp(layout: Layout, group: str) -> str:
    """Changes with the group's lock, the interpreter, and the checkout's place (scripts in .venv hold absolute paths)."""
    return _digest([layout.lock(group).read_bytes(), python_identity().encode(), str(layout.root).encode()])


def workspace_stamp(layout: Layout) -> str:
    """Changes with everything that a colcon build reads once and then keeps."""
    parts = [packages_stamp(layout, "base").encode()]
    for package in package_folders(layout):
        for path in _build_inputs(package):
            parts.append(str(path.relative_to(package.parent)).encode())
            if path.name in _BUILT_NAMES or path.suffix in _BUILT_SUFFIXES:
                parts.append(path.read_bytes())
    return _digest(parts)


def package_folders(layout: Layout) -> list[Path]:
    """Folders of the packages that set-up builds: the workspace's, and those of ROS that the wheels lack."""
    lacking = [path for path in layout.without_ros.glob("*/package.xml") if not (layout.venv / "share" / path.parent.name).exists()]
    return sorted(path.parent for path in (*layout.sources.glob("*/package.xml"), *lacking))


def _build_inputs(package: Path) -> Iterator[Path]:
    for folder, folders, files in os.walk(package):
        folders[:] = sorted(set(folders).difference(_SKIPPED_FOLDERS))
        here = Path(folder)
        linked = here.parent == package and here.name in _LINKED_FOLDERS
        for name in sorted(files):
            if linked or name in _BUILT_NAMES or name.endswith(_BUILT_SUFFIXES):
                yield here / name


def _digest(parts: list[bytes]) -> str:
    total = hashlib.sha256()
    for part in parts:
        total.update(len(part).to_bytes(8, "little"))
        total.update(part)
    return total.hexdigest()
