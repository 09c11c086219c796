# SPDX-License-Identifier: Apache-2.0
"""Where files can be written: looked at before anything is computed, and a place for what belongs in a home that is none."""

import fcntl
import os
import shutil
import stat
import sys
import tempfile
from functools import cache
from pathlib import Path

LEAST_BYTES = 1_000_000
LONGEST_PARENT = 50
"""Bytes; what comes below has some 40."""


def folder_problem(folder: Path, needed_bytes: int = LEAST_BYTES, locks: bool = False) -> str:
    """Why nothing can be written into a folder, or where it will be made; empty: it can, and there is room. Leaves no trace.

    Args:
        folder: may not exist yet.
        needed_bytes: of room.
        locks: files in it will be locked, which some network file systems cannot.
    """
    there = folder
    try:
        there = folder.absolute()
        while not os.path.lexists(there) and there != there.parent:
            there = there.parent
        with tempfile.TemporaryFile(dir=there) as file:
            if locks:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            free = shutil.disk_usage(there).free
    except OSError as error:
        where = "" if there == folder else f" ({there})"
        return f"{folder} cannot be written{where}: {error.strerror or error}"
    if free < needed_bytes:
        return f"{free / 1e9:.2f} GB free for {folder}, {needed_bytes / 1e9:g} GB are needed"
    return ""


def writable_folder(below_home: str, *wanted: Path | str | None) -> Path:
    """The first that can be written, not made yet: those wanted, ~/`below_home`, the same in a private temporary folder.

    The last is said on standard error, once. Raises OSError: there is not even a temporary folder.
    """
    for folder in wanted:
        if folder and not folder_problem(Path(folder)):
            return Path(folder)
    problem = home_problem(below_home)
    if not problem:
        return Path.home() / below_home
    if not _private.cache_info().currsize:
        told = f"{problem}: caches, logs and state are kept in {_private()}, which is emptied now and then"
        print(told, file=sys.stderr)
    return _private() / below_home


def seen_from_here(path: Path) -> Path:
    """Relative to where the user is, if below it."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path


def cache_folder(name: str, *wanted: Path | str | None) -> Path:
    """For what can be made again: as `writable_folder`, in the user's cache."""
    cache_home = os.environ.get("XDG_CACHE_HOME")
    return writable_folder(f".cache/sixstrut/{name}", *wanted, cache_home and Path(cache_home) / "sixstrut" / name)


def temporary_parent() -> str:
    """A folder for temporary ones that hold sockets, whose paths have at most 107 bytes: the usual one, if it is not too deep."""
    places = (tempfile.gettempdir(), os.environ.get("XDG_RUNTIME_DIR"), "/tmp", "/var/tmp", "/dev/shm")
    short = [place for place in places if place and len(os.fsencode(place)) <= LONGEST_PARENT]
    return next((place for place in short if os.access(place, os.W_OK | os.X_OK)), places[0])


def home_problem(below_home: str) -> str:
    """Why nothing can be written below the user's home; empty: it can."""
    try:
        home = Path.home()
    except RuntimeError:
        return "HOME is not set"
    return folder_problem(home / below_home) if home.is_absolute() else f"HOME is {str(home)!r}"


@cache
def _private() -> Path:
    """Below the folder for temporary files: this user's, whoever comes first."""
    folder = Path(temporary_parent()) / f"sixstrut-{os.geteuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & 0o022:
        folder = Path(tempfile.mkdtemp(prefix="sixstrut-", dir=temporary_parent()))
    return folder
