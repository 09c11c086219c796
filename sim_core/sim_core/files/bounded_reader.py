# SPDX-License-Identifier: Apache-2.0
"""Whole files, bounded: whatever a path leads to, reading it takes little time and memory. Light to import."""

import os
import stat
from collections.abc import Collection
from pathlib import Path

from sim_core.errors import FileError

DATA = Path(__file__).parent.parent / "data"
"""Files that are shipped with sim_core."""
MOST_BYTES = 4_000_000
"""The largest file that the tools read whole, a fitted ensemble of 10,000 members, has 2 MB."""


def read_bytes(path: Path | str, most: int = MOST_BYTES, owners: Collection[int] | None = None, hidden: bool = False) -> bytes:
    """A whole file.

    Args:
        path: where it lies.
        most: bytes that it may have.
        owners: numbers of the users of whom it may be; then it is read through no link. None: anybody's.
        hidden: others must be able neither to read nor to change it.

    Raises:
        FileError: it has more than `most` bytes, is no regular file, or others may have to do with it. OSError: it cannot be read.
    """
    no_link = 0 if owners is None else os.O_NOFOLLOW
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | no_link)  # a pipe that nobody writes to shall not block
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise FileError(str(path), "it is no regular file", "give a file")
        if owners is not None and status.st_uid not in owners:
            raise FileError(str(path), "it is of another user", "give a file of yours")
        if hidden and status.st_mode & 0o077:
            raise FileError(str(path), "others can read or change it", "chmod 600 it, as its owner")
        with os.fdopen(descriptor, "rb", closefd=False) as stream:
            data = stream.read(most + 1)
    finally:
        os.close(descriptor)
    if len(data) > most:
        raise FileError(str(path), f"it has more than {most / 1e6:g} MB", "is it the right file?")
    return data


def text_of(data: bytes, where: str, kind: type[FileError] = FileError) -> str:
    """UTF-8 text. Raises `kind`: it is none, and where."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        problem = f"byte {error.start} (0x{data[error.start]:02x}) is not UTF-8"
        raise kind(where, problem, "save it as UTF-8 (it may be Latin-1)", line) from None


def read_text(path: Path | str, most: int = MOST_BYTES) -> str:
    """A whole file of UTF-8 text. Raises FileError, OSError: as `read_bytes`."""
    return text_of(read_bytes(path, most), str(path))
