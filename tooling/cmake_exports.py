# SPDX-License-Identifier: Apache-2.0
"""Repairs the ROS wheels' CMake files, which name the Python of the machine that built them.

The message packages export include directories such as `/opt/python/cp312-cp312/include/python3.12` and that Python's
numpy. A package built on top of them (ours is one) would look there, and CMake refuses include directories that do
not exist.
"""

import os
import re
import tempfile
from pathlib import Path

_BUILDER = r"/opt/python/cp\d+-cp\d+"
_PYTHON_INCLUDE = re.compile(_BUILDER + r"/include/python3\.\d+")
_NUMPY_INCLUDE = re.compile(_BUILDER + r"/lib/python3\.\d+/site-packages/numpy/_?core/include")


def repaired(text: str, python_include: str, numpy_include: str) -> str:
    """The text with the builder's two paths replaced by ours; everything else as it was."""
    text = _PYTHON_INCLUDE.sub(lambda _: python_include, text)
    return _NUMPY_INCLUDE.sub(lambda _: numpy_include, text)


def repair(venv: Path, python_include: str, numpy_include: str) -> int:
    """Repairs `share/*/cmake/*.cmake` under a virtual environment; returns how many files changed."""
    changed = 0
    for path in sorted(venv.glob("share/*/cmake/*.cmake")):
        before = path.read_text(encoding="utf-8")
        after = repaired(before, python_include, numpy_include)
        if after != before:
            _replace(path, after)
            changed += 1
    return changed


def _replace(path: Path, text: str) -> None:
    """Atomically, through a new file: an installer may have hard-linked the old one from its cache."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=path.name)
    new = Path(name)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        new.chmod(path.stat().st_mode & 0o7777)
        new.replace(path)
    except BaseException:
        new.unlink()
        raise
