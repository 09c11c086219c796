"""The pty behind a link at a well-known path: one living owner a link, and nothing left behind."""

from __future__ import annotations

import errno
import fcntl
import os
import termios
import time
import tty
from pathlib import Path
from typing import IO

from hardware_bridge.errors import PrototypeError
from hardware_bridge.virtual_port import Handshake, handshake_path, lock_path, write_handshake

_LOCK_LIMIT_S = 0.5


class PseudoPort:
    """A raw pty whose other end is linked at ``link``.

    Attributes:
        link: The link.
        device: What it points to.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        try:
            link.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._lock = _lock(link)
        except OSError as error:
            raise PrototypeError(str(link), f"{error.strerror}; give --link in a folder that can be written") from error
        if link.exists() and not link.is_symlink():
            self._lock.close()
            raise PrototypeError(str(link), "exists and is no link of ours; remove it or give another --link")
        # Our own copy of the far end stays open: without it, every client's close would end the line.
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        os.set_blocking(self._near, False)
        self.device = os.ttyname(self._far)
        temporary = link.with_name(f"{link.name}.{os.getpid()}.tmp")
        temporary.unlink(missing_ok=True)
        temporary.symlink_to(self.device)
        os.replace(temporary, link)

    def fileno(self) -> int:
        """Readable when bytes have come."""
        return self._near

    def announce(self, handshake: Handshake) -> None:
        """Puts the handshake beside the link."""
        write_handshake(self.link, handshake)

    def read(self, limit: int) -> bytes:
        """What has come, up to ``limit`` bytes, without waiting."""
        try:
            return os.read(self._near, limit)
        except BlockingIOError:
            return b""
        except OSError as error:
            if error.errno == errno.EIO:
                return b""
            raise

    def write(self, data: bytes) -> None:
        """Replies; what nobody takes is lost, as on a wire."""
        try:
            os.write(self._near, data)
        except BlockingIOError:
            return

    def hold_back(self, on: bool) -> None:
        """Makes the far end take no more bytes, as a radio link that is out of range does, or take them again."""
        termios.tcflow(self._far, termios.TCOOFF if on else termios.TCOON)

    def close(self) -> None:
        """Removes link and handshake, if they are still ours, and ends the line."""
        if self.link.is_symlink() and os.readlink(self.link) == self.device:
            self.link.unlink()
            handshake_path(self.link).unlink(missing_ok=True)
        os.close(self._near)
        os.close(self._far)
        self._lock.close()


def _lock(link: Path) -> IO[bytes]:
    """The lock that says that the owner lives; the kernel lets it go with the process.

    Its file stays: removing it would let two owners hold locks on two files of one name.
    """
    handle = lock_path(link).open("ab")
    deadline = time.monotonic() + _LOCK_LIMIT_S
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return handle
        except BlockingIOError:
            if time.monotonic() > deadline:  # a bridge that only looks holds it for microseconds
                handle.close()
                problem = "another one lives there; stop it, or give another --link"
                raise PrototypeError(str(link), problem) from None
            time.sleep(0.01)
