# SPDX-License-Identifier: Apache-2.0
"""The pty behind a link at a well-known path: one living owner a link, and nothing left behind."""

import contextlib
import errno
import fcntl
import os
import termios
import time
import tty
from pathlib import Path

from hardware_bridge.errors import PrototypeError
from hardware_bridge.prototype_client import private_files
from hardware_bridge.prototype_client.handshake import lock_path

_LOCK_LIMIT_S = 0.5


class PseudoPort:
    """A raw pty whose other end is linked at `link`.

    Attributes:
        link: the link.
        device: what it points to.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        try:
            self._lock = _lock(link)
        except OSError as error:
            problem = error.strerror or str(error)
            raise PrototypeError(str(link), f"{problem}; give --link in a folder of your own") from error
        if link.exists() and not link.is_symlink():
            os.close(self._lock)
            raise PrototypeError(str(link), "exists and is no link of ours; remove it or give another --link")
        # Our own copy of the far end stays open: without it, every client's close would end the line.
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        os.set_blocking(self._near, False)
        self.device = os.ttyname(self._far)
        temporary = link.with_name(f"{link.name}.{os.getpid()}.tmp")
        temporary.unlink(missing_ok=True)
        temporary.symlink_to(self.device)
        temporary.replace(link)

    def fileno(self) -> int:
        """Readable when bytes have come."""
        return self._near

    def read(self, limit: int) -> bytes:
        """What has come, up to `limit` bytes, without waiting."""
        try:
            return os.read(self._near, limit)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EIO):
                return b""
            raise

    def write(self, data: bytes) -> None:
        """Replies; what nobody takes is lost, as on a wire."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._near, data)

    def hold_back(self, on: bool) -> None:
        """Makes the far end take no more bytes, as a radio link that is out of range does, or take them again."""
        termios.tcflow(self._far, termios.TCOOFF if on else termios.TCOON)

    def close(self) -> None:
        """Removes the link, if it is still ours, and ends the line."""
        if self.link.is_symlink() and str(self.link.readlink()) == self.device:
            self.link.unlink()
        os.close(self._near)
        os.close(self._far)
        os.close(self._lock)


def _lock(link: Path) -> int:
    """The lock that says that the owner lives; the kernel lets it go with the process.

    Its file stays: removing it would let two owners hold locks on two files of one name.
    """
    folder = private_files.open_folder(link.parent, create=True)
    try:
        lock = private_files.open_file(folder, lock_path(link).name, os.O_RDWR | os.O_CREAT)
    finally:
        os.close(folder)
    deadline = time.monotonic() + _LOCK_LIMIT_S
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return lock
        except BlockingIOError:
            if time.monotonic() > deadline:  # a bridge that only looks holds it for microseconds
                os.close(lock)
                problem = "another one lives there; stop it, or give another --link"
                raise PrototypeError(str(link), problem) from None
            time.sleep(0.01)
