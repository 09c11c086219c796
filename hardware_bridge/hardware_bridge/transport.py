"""Bytes in, bytes out, over any pyserial URL: ``/dev/rfcomm0``, ``socket://host:port``, a pty.

A transport opens exclusively, writes all, reads exactly, closes; it knows no protocol. Every failure is an error that
names the port and what to do. pyserial and the kernel raise ``SerialException`` or a plain ``OSError``; the second is
the base of the first and is what is caught here.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import select
import tempfile
import threading
import time
from typing import IO

import serial

from hardware_bridge.errors import LinkLost, PortBusy, PortMissing, PortWrongKind, TransportError

_BUSY = {errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES}
_MISSING = {errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.EIO, errno.EHOSTDOWN, errno.ECONNREFUSED, errno.ETIMEDOUT}
_REMEDY_MISSING = "start the virtual prototype, or power the robot and bind its Bluetooth (rfcomm bind 0 <address> 1)"


class SerialTransport:
    """One exclusive serial port.

    Attributes:
        port: The path or pyserial URL.
        baud: Rate of the port; the Bluetooth side of an rfcomm port ignores it.
        read_timeout_s: Longest wait of ``read_exactly``, wall time.
        write_timeout_s: Longest wait of ``write_all``, wall time; about a frame, so that stop never waits longer.
        open_timeout_s: Longest wait of ``open``, wall time: a paired module that is off blocks the kernel for seconds.
    """

    def __init__(
        self,
        port: str,
        baud: int = 9600,
        read_timeout_s: float = 0.2,
        write_timeout_s: float = 0.04,
        open_timeout_s: float = 10.0,
    ) -> None:
        self.port = port
        self.baud = baud
        self.read_timeout_s = read_timeout_s
        self.write_timeout_s = write_timeout_s
        self.open_timeout_s = open_timeout_s
        self._serial: serial.Serial | None = None
        self._lock_file: IO[str] | None = None
        self._descriptor: int | None = None

    @property
    def is_open(self) -> bool:
        """Whether ``open`` succeeded and ``close`` has not been called."""
        return self._serial is not None

    @property
    def descriptor(self) -> int | None:
        """The open file, where the port is one."""
        return self._descriptor

    def open(self) -> None:
        """Opens the port exclusively.

        Raises:
            PortMissing, PortBusy, PortWrongKind: Within ``open_timeout_s``, naming port and remedy.
        """
        if self._serial is not None:
            return
        is_url = "://" in self.port
        if not is_url and not os.path.exists(self.port):
            raise PortMissing(self.port, "does not exist", _REMEDY_MISSING)
        lock_file = _lock_url(self.port) if is_url else None
        try:
            self._serial = self._open_within_limit()
        except BaseException:
            if lock_file is not None:
                lock_file.close()
            raise
        self._lock_file = lock_file
        self._descriptor = _descriptor(self._serial)
        # With a descriptor, write_all waits by itself: pyserial also reports a timeout after a late but complete write.
        self._serial.write_timeout = self.write_timeout_s if self._descriptor is None else 0

    def close(self) -> None:
        """Closes the port; closing twice, or after the peer is gone, is fine."""
        port, self._serial, self._descriptor = self._serial, None, None
        try:
            if port is not None:
                port.close()
        except OSError:
            pass  # the peer is gone and took the descriptor's use with it
        finally:
            if self._lock_file is not None:
                self._lock_file.close()
                self._lock_file = None

    def write_all(self, data: bytes) -> None:
        """Hands every byte to the operating system within ``write_timeout_s``.

        Raises:
            LinkLost: The port failed or did not take all; ``dirty`` says whether a part of ``data`` may be on its way.
        """
        port = self._require_open()
        deadline = time.monotonic() + self.write_timeout_s
        rest = memoryview(data)
        try:
            while rest:
                if self._descriptor is not None:
                    wait_s = max(0.0, deadline - time.monotonic())
                    if not select.select([], [self._descriptor], [], wait_s)[1]:
                        taken = len(data) - len(rest)
                        raise self._lost(f"took {taken} of {len(data)} bytes in time", dirty=taken > 0)
                count = port.write(bytes(rest))
                rest = rest[count or 0 :]
        except OSError as error:
            raise self._lost(f"write failed ({error})", dirty=True) from error

    def read_exactly(self, count: int) -> bytes:
        """``count`` bytes, or an error after ``read_timeout_s``.

        Raises:
            LinkLost: The port failed, or sent fewer bytes in time.
        """
        port = self._require_open()
        try:
            data = bytes(port.read(count))
        except OSError as error:
            raise self._lost(f"read failed ({error})") from error
        if len(data) < count:
            raise self._lost(f"sent {len(data)} of {count} bytes in {self.read_timeout_s:g} s")
        return data

    def read_available(self, limit: int = 256) -> bytes:
        """What has arrived, up to ``limit`` bytes, without waiting.

        Raises:
            LinkLost: The peer is gone.
        """
        port = self._require_open()
        data = bytearray()
        try:
            while len(data) < limit and (waiting := port.in_waiting):
                data += port.read(min(waiting, limit - len(data)))
        except OSError as error:
            raise self._lost(f"read failed ({error})") from error
        return bytes(data)

    def pending_bytes(self) -> int:
        """Bytes accepted but not yet sent on, as far as the port can say (a pty and a socket say 0)."""
        port = self._require_open()
        try:
            return int(port.out_waiting)
        except (OSError, AttributeError, NotImplementedError):
            return 0

    def _require_open(self) -> serial.Serial:
        if self._serial is None:
            raise self._lost("is not open")
        return self._serial

    def _lost(self, problem: str, dirty: bool = False) -> LinkLost:
        remedy = "check power and link, then reset"
        if dirty:
            remedy = "switch the servo supply off and on (the board may hold half a frame), then reset"
        return LinkLost(self.port, problem, remedy, dirty)

    def _open_within_limit(self) -> serial.Serial:
        opened: list[serial.Serial] = []
        failed: list[BaseException] = []
        lock = threading.Lock()
        given_up = False

        def work() -> None:
            try:
                port = serial.serial_for_url(
                    self.port, baudrate=self.baud, timeout=self.read_timeout_s,
                    exclusive=None if "://" in self.port else True,
                )  # fmt: skip
            except Exception as error:
                failed.append(error)
                return
            with lock:
                opened.append(port)
                if given_up:
                    port.close()

        thread = threading.Thread(target=work, name="open serial port", daemon=True)
        thread.start()
        thread.join(self.open_timeout_s)
        with lock:
            if opened:
                return opened[0]
            given_up = True
        if failed:
            raise self._explain(failed[0]) from failed[0]
        raise PortMissing(self.port, f"did not open in {self.open_timeout_s:g} s", _REMEDY_MISSING)

    def _explain(self, error: BaseException) -> TransportError:
        number = getattr(error, "errno", None)
        text = " ".join(str(error).split())
        if "lock" in text.lower() or number == errno.EBUSY:
            return PortBusy(self.port, "is in use", "stop the other program that holds it (fuser shows which)")
        if number in (errno.EACCES, errno.EPERM):
            return PortWrongKind(self.port, "permission denied", "add the user to the group of the port (dialout)")
        if number in _MISSING or "://" in self.port:
            return PortMissing(self.port, f"does not answer ({text})", _REMEDY_MISSING)
        return PortWrongKind(self.port, f"is no serial port ({text})", "give a tty, a pty or a pyserial URL")


def _descriptor(port: serial.Serial) -> int | None:
    try:
        return int(port.fileno())
    except (OSError, AttributeError):
        return None


def _lock_url(url: str) -> IO[str]:
    """pyserial locks device files only; a URL is locked by a file of ours, so that two bridges cannot share it."""
    name = f"sixstrut-port-{os.getuid()}-{hashlib.sha256(url.encode()).hexdigest()[:16]}.lock"
    handle = open(os.path.join(tempfile.gettempdir(), name), "w")  # noqa: SIM115 - it must stay open
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        handle.close()
        if error.errno in _BUSY:
            raise PortBusy(url, "is in use", "stop the other bridge that holds it") from error
        raise
    return handle
