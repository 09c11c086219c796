# SPDX-License-Identifier: Apache-2.0
"""Bytes in, bytes out, over a device or a socket: `/dev/rfcomm0`, `socket://host:port`, a pty.

A transport opens exclusively, writes all, reads what has come, closes; it knows no protocol. Every failure is an error that
names the port and what to do. pyserial and the kernel raise `SerialException` or a plain `OSError`; the second is
the base of the first and is what is caught here.
"""

import errno
import os
import select
import threading
import time
from concurrent.futures import Future, wait

import serial

from hardware_bridge.errors import LinkLost, PortBusy, PortMissing, PortWrongKind, TransportError
from hardware_bridge.link.port_lock import REMEDY_MISSING, PortLock, lock_port, number_of

_MISSING = {errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.EIO, errno.EHOSTDOWN, errno.ECONNREFUSED, errno.ETIMEDOUT}


class SerialTransport:
    """One exclusive serial port.

    Attributes:
        descriptor: the open file, where the port is one.
        port: the path, or `socket://HOST:PORT`. Other URLs are refused: they hide a device, or are none.
        baud: rate of the port; the Bluetooth side of an rfcomm port ignores it.
        write_timeout_s: longest wait of `write_all`, wall time; about a frame, so that stop never waits longer.
        open_timeout_s: longest wait of `open`, wall time: a paired module that is off blocks the kernel for seconds.
    """

    def __init__(
        self,
        port: str,
        baud: int = 9600,
        write_timeout_s: float = 0.04,
        open_timeout_s: float = 10.0,
    ) -> None:
        self.port = port
        self.baud = baud
        self.write_timeout_s = write_timeout_s
        self.open_timeout_s = open_timeout_s
        self._serial: serial.Serial | None = None
        self._lock: PortLock | None = None
        self.descriptor: int | None = None
        self._opening: Future[tuple[serial.Serial, PortLock]] | None = None

    def open(self) -> None:
        """Opens the port exclusively, whatever its name is spelled like (see `port_lock`).

        Raises:
            PortMissing, PortBusy, PortWrongKind: within `open_timeout_s`, naming port and remedy.
        """
        if self._serial is not None:
            return
        self._serial, self._lock = self._open_within_limit()
        self.descriptor = _descriptor(self._serial)
        # With a descriptor, write_all waits by itself: pyserial also reports a timeout after a late but complete write.
        self._serial.write_timeout = self.write_timeout_s if self.descriptor is None else 0

    def close(self) -> None:
        """Closes the port; closing twice, or after the peer is gone, is fine."""
        port, self._serial, self.descriptor = self._serial, None, None
        try:
            if port is not None:
                port.close()
        except OSError:
            pass  # the peer is gone and took the descriptor's use with it
        finally:
            if self._lock is not None:
                self._lock.release()
                self._lock = None

    def write_all(self, data: bytes) -> None:
        """Hands every byte to the operating system within `write_timeout_s`.

        Raises:
            LinkLost: the port failed or did not take all; `dirty` says whether a part of `data` may be on its way.
        """
        port = self._require_open()
        deadline = time.monotonic() + self.write_timeout_s
        rest = memoryview(data)
        try:
            while rest:
                if self.descriptor is not None:
                    wait_s = max(0.0, deadline - time.monotonic())
                    if not select.select([], [self.descriptor], [], wait_s)[1]:
                        taken = len(data) - len(rest)
                        raise self._lost(f"took {taken} of {len(data)} bytes in time", dirty=taken > 0)
                count = port.write(bytes(rest))
                rest = rest[count or 0 :]
        except OSError as error:
            raise self._lost(f"write failed ({error})", dirty=True) from error

    def read_available(self, limit: int = 256) -> bytes:
        """What has arrived, up to `limit` bytes, without waiting.

        Raises:
            LinkLost: the peer is gone.
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

    def _open_within_limit(self) -> tuple[serial.Serial, PortLock]:
        deadline = time.monotonic() + self.open_timeout_s
        too_late = PortMissing(self.port, f"did not open in {self.open_timeout_s:g} s", REMEDY_MISSING)
        if self._opening is not None and not wait([self._opening], self.open_timeout_s).done:
            raise too_late  # an attempt that was given up still holds the port
        opening: Future[tuple[serial.Serial, PortLock]] = Future()
        self._opening = opening

        def work() -> None:
            try:
                opening.set_result(self._open_locked())
            except Exception as error:
                opening.set_exception(error)

        threading.Thread(target=work, name="open serial port", daemon=True).start()
        if not wait([opening], max(0.0, deadline - time.monotonic())).done:
            opening.add_done_callback(_let_go)
            raise too_late
        try:
            return opening.result()
        except Exception as error:
            raise self._explain(error) from error

    def _open_locked(self) -> tuple[serial.Serial, PortLock]:
        held = lock_port(self.port)
        try:
            is_url = "://" in self.port
            port = serial.serial_for_url(
                self.port if is_url else os.path.realpath(self.port), baudrate=self.baud, timeout=0,
                exclusive=None if is_url else True,
            )  # fmt: skip
            try:
                if not is_url and number_of(self.port, os.fstat(port.fileno())) not in held.names:
                    raise PortMissing(self.port, "became another device while it was opened", "open it again")
            except BaseException:
                port.close()
                raise
        except BaseException:
            held.release()
            raise
        return port, held

    def _explain(self, error: Exception) -> TransportError:
        if isinstance(error, TransportError):
            return error
        number = getattr(error, "errno", None)
        text = " ".join(str(error).split())
        if "lock" in text.lower() or number == errno.EBUSY:
            return PortBusy(self.port, "is in use", "stop the other program that holds it (fuser shows which)")
        if number in (errno.EACCES, errno.EPERM):
            return PortWrongKind(self.port, "permission denied", "add the user to the group of the port (dialout)")
        if number in _MISSING or "://" in self.port:
            return PortMissing(self.port, f"does not answer ({text})", REMEDY_MISSING)
        return PortWrongKind(self.port, f"is no serial port ({text})", "give a tty, a pty or socket://HOST:PORT")


def _descriptor(port: serial.Serial) -> int | None:
    try:
        return int(port.fileno())
    except (OSError, AttributeError):
        return None


def _let_go(opening: Future[tuple[serial.Serial, PortLock]]) -> None:
    """Of a port that opened when nobody waited for it any more."""
    if opening.exception() is None:
        port, held = opening.result()
        port.close()
        held.release()
