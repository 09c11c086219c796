# SPDX-License-Identifier: Apache-2.0
"""One set-up at a time in one checkout."""

import fcntl
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tooling.layout import SetupError


@contextmanager
def exclusive(path: Path) -> Iterator[int]:
    """Holds the lock at `path`, waiting for whoever has it; yields its file descriptor.

    The kernel drops the lock when its last holder ends, however it ends, so there is no stale lock to clean up.

    Raises SetupError: it cannot be made, or there are no locks.
    """
    descriptor = _open_locked(path)
    try:
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        yield descriptor
    finally:
        os.close(descriptor)


def _open_locked(path: Path) -> int:
    told = False
    while True:
        try:
            path.parent.mkdir(exist_ok=True)
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            remedy = "let whoever it belongs to run ./sixstrut setup with a Python that you may run too, or clone it for yourself"
            raise SetupError(
                f"{path.parents[1]} is not set up for this, and you cannot write there ({error.strerror}): {remedy}"
            ) from None
        try:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if not told:
                    _tell(descriptor)
                    told = True
                fcntl.flock(descriptor, fcntl.LOCK_EX)
            except OSError as error:
                raise SetupError(f"{path} cannot be locked ({error.strerror}): move the checkout to a local disk") from None
            if _is_still_at(path, descriptor):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # `sixstrut clean` removed the file while we waited: the lock is a new one


def _tell(descriptor: int) -> None:
    holder = os.pread(descriptor, 20, 0).decode(errors="replace").strip() or "unknown"
    print(f"another sixstrut (process {holder}) is setting up; waiting for it …", file=sys.stderr, flush=True)


def _is_still_at(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False
