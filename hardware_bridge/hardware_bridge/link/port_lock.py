# SPDX-License-Identifier: Apache-2.0
"""One holder a port on this machine, however its name is spelled.

What is locked is the device behind a path (its number in the kernel, so also through another link or node), or the
address behind a `socket://` URL. The lock is a name in Linux's abstract socket space: it is the machine's and not a
user's, no file that somebody could put a link in place of, and gone with its process.
"""

import contextlib
import errno
import hashlib
import ipaddress
import os
import re
import socket
import stat
import struct
from pathlib import Path
from urllib.parse import urlsplit

from hardware_bridge.errors import PortBusy, PortMissing, PortWrongKind

REMEDY_MISSING = "start the virtual prototype, or power the robot and bind its Bluetooth (rfcomm bind 0 <address> 1)"
_GIVE = "give a device such as /dev/rfcomm0, or socket://HOST:PORT"
_HOST = re.compile(r"[A-Za-z0-9._:%-]+")
_ALIAS_MAJOR = 5
"""/dev/tty, /dev/console, /dev/ptmx: each another name for a device."""


class PortLock:
    """Held until `release`. Attributes: names: What is locked."""

    def __init__(self, names: tuple[str, ...], port: str, problem: str = "is in use") -> None:
        """Raises PortBusy: somebody on this machine holds one of the names; who, if it can be seen."""
        self.names = names
        self._held: list[socket.socket] = []
        for name in sorted(names):
            taken = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                taken.bind(f"\0sixstrut-{name}")
                taken.listen(socket.SOMAXCONN)  # so that who asks can see whose it is
            except OSError as error:
                taken.close()
                self.release()
                if error.errno != errno.EADDRINUSE:
                    raise
                remedy = f"stop the other program that holds it{_holder(name)} (fuser shows which)"
                raise PortBusy(port, problem, remedy) from error
            self._held.append(taken)

    def release(self) -> None:
        """Lets go; twice is fine."""
        while self._held:
            self._held.pop().close()


def lock_port(port: str) -> PortLock:
    """Locks what is behind a path or URL, before it is opened.

    Raises:
        PortMissing, PortBusy, PortWrongKind: as `SerialTransport.open`.
    """
    if "://" in port:
        return PortLock(_addresses(port), port)
    name = device_name(port)
    if who := _sits_at(os.stat(port).st_rdev):  # noqa: PTH116
        raise PortBusy(port, f"is the terminal of {who}", "give the port of the robot's board")
    return PortLock((name,), port)


def lock_robot(record: str, robot: str, port: str) -> PortLock:
    """Locks a robot's record: two bridges at once would each spoil what the other one knows. Raises PortBusy."""
    name = "robot-" + hashlib.sha256(os.path.realpath(record).encode()).hexdigest()[:24]
    problem = f"another bridge drives robot {robot!r} now; two robots need two names in their calibrations"
    return PortLock((name,), port, problem)


def device_name(port: str) -> str:
    """The lock's name of the device behind a path. Raises PortMissing, PortWrongKind."""
    try:
        status = os.stat(port)  # noqa: PTH116 (an empty Path is this folder, an empty name is none)
    except FileNotFoundError as error:
        raise PortMissing(port, "does not exist", REMEDY_MISSING) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise PortWrongKind(port, f"cannot be looked at ({reason})", _GIVE) from error
    if not stat.S_ISCHR(status.st_mode):
        raise PortWrongKind(port, "is no serial port", _GIVE)
    return number_of(port, status)


def _sits_at(device: int) -> str:
    """Which process has a device as its terminal, as far as it can be seen; "" for none.

    The name of a pty whose far end is gone goes to the next terminal window: a bridge that opens its port again must not open that.
    """
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            with contextlib.suppress(OSError, ValueError):
                words = (folder / "stat").read_text(encoding="utf-8", errors="replace").rpartition(")")
                number = int(words[2].split()[4]) & 0xFFFFFFFF
                if number and number == _as_in_stat(device):
                    return f"process {folder.name} ({words[0].partition('(')[2]})"
    return ""


def _as_in_stat(device: int) -> int:
    """A device's number as /proc writes it (proc_pid_stat(5), tty_nr): the minor number in bits 31 to 20 and 7 to 0."""
    major, minor = os.major(device), os.minor(device)
    return (minor & 0xFF) | major << 8 | (minor & ~0xFF) << 12


def number_of(port: str, status: os.stat_result) -> str:
    """The lock's name of a device. Raises PortWrongKind: it stands for another one."""
    if os.major(status.st_rdev) == _ALIAS_MAJOR:
        raise PortWrongKind(port, "stands for another device", "give the device itself, such as /dev/rfcomm0")
    return f"port-{os.major(status.st_rdev)}-{os.minor(status.st_rdev)}"


def _addresses(url: str) -> tuple[str, ...]:
    """The locks' names of all addresses behind a URL; all of this machine's own are one."""
    scheme = url.split("://", 1)[0]
    if scheme.lower() != "socket":
        raise PortWrongKind(url, f"{scheme}:// is not taken: it hides the device behind it", _GIVE)
    try:
        parts = urlsplit(url)
        host, number = parts.hostname or "", parts.port or 0
    except ValueError as error:
        raise PortWrongKind(url, f"is no URL ({error})", _GIVE) from error
    more = parts.path not in ("", "/") or parts.query or parts.fragment or "@" in parts.netloc or "?" in url or "#" in url
    if more or not _HOST.fullmatch(host) or not number:
        raise PortWrongKind(url, "is not socket://HOST:PORT", _GIVE)
    try:
        found = socket.getaddrinfo(host, number, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise PortMissing(url, f"has no address ({error})", "check the host's name and the network") from error
    return tuple({f"socket-{_machine(entry)}-{number}" for entry in found})


def _machine(entry: tuple[int, int, int, str, tuple[object, ...]]) -> str:
    """An address's machine: `here` for each of this one's."""
    family, _, _, _, address = entry
    spelled = ipaddress.ip_address(str(address[0]).split("%")[0])
    plain = getattr(spelled, "ipv4_mapped", None) or spelled
    if plain.is_loopback or plain.is_unspecified:
        return "here"
    with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
        probe.connect(address)  # sends nothing: it only asks for the way there
        if probe.getsockname()[0] == address[0]:
            return "here"
    return str(plain)


def _holder(name: str) -> str:
    """Which process holds a lock, as far as it can be seen."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
        asking.setblocking(False)
        asking.connect(f"\0sixstrut-{name}")
        process, _, _ = struct.unpack("3i", asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
        return f", process {process}" if process else ""
    return ""
