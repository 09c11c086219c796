# SPDX-License-Identifier: Apache-2.0
"""How a bridge knows that a port is the virtual prototype: not by its name, and not by what a file says, but by proof.

Beside the link `L` the prototype keeps `L.lock` (locked while it lives), `L.observer` and `L.faults` (Unix sockets, see
the prototype's observer and `fault_client`). Who asks at the latter gets this handshake. It counts if folder, link and
sockets are this user's alone, if the process that answers is this user's, and if the pty behind the link is that process's own.
"""

import fcntl
import json
import math
import os
import re
import secrets
import stat
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hardware_bridge.errors import BoardMismatch, PortMissing, TimeScaleError
from hardware_bridge.prototype_client import private_files
from sim_core.files.places import temporary_parent

ANSWER_LIMIT_S = 10.0
"""Wall time within which a prototype says who it is; it looks every 50 ms, if its computer lets it."""

_LONGEST_ANSWER = 4096
_PTY = re.compile(r"/dev/pts/(\d+)")
_PTMX = os.makedev(5, 2)


@dataclass(frozen=True)
class Handshake:
    """What the virtual prototype says about itself; nothing about its parameters.

    Attributes:
        pid: its process, by the kernel's word.
        instance: new at every start: another robot, whose struts are elsewhere.
        device: the pty behind the link.
        time_scale: its robot seconds per second.
        observer: path of its observer's socket.
        board: the board that it emulates (see `boards.registry`).
    """

    pid: int
    instance: str
    device: str
    time_scale: float
    observer: str
    board: str = "lsc"


def default_link(namespace: str = "") -> Path:
    """Where the prototype is linked if nobody says otherwise; each ROS namespace has its own, in the same folder."""
    name = "-".join(["prototype", *filter(None, namespace.split("/"))])  # no part of a namespace has a -
    for variable, below in (("SIXSTRUT_STATE_DIR", ""), ("XDG_RUNTIME_DIR", "sixstrut")):
        if os.environ.get(variable):
            return Path(os.environ[variable]) / below / name
    return Path(temporary_parent()) / f"sixstrut-{os.getuid()}" / name


def lock_path(link: Path) -> Path:
    """The file whose lock means that the prototype lives."""
    return link.with_name(link.name + ".lock")


def observer_path(link: Path) -> Path:
    """The observer's socket."""
    return link.with_name(link.name + ".observer")


def faults_path(link: Path) -> Path:
    """The socket where it is told to fail."""
    return link.with_name(link.name + ".faults")


def imu_path(link: Path) -> Path:
    """The link to the pty of its inertial sensor, if it has one."""
    return link.with_name(link.name + ".imu")


def read_handshake(port: str) -> Handshake | None:
    """The handshake of the living prototype behind `port`, or None: a real port."""
    return examine(port)[0]


def examine(port: str) -> tuple[Handshake | None, str]:
    """The handshake of the living prototype behind `port`; or None, and why what looks like one is not taken for one.

    An empty reason: nothing there looks like a prototype.
    """
    link = Path(port)
    is_link = os.path.islink(port)  # noqa: PTH114 (no error where it may not be looked at)
    if not is_link or not (os.path.lexists(lock_path(link)) or os.path.lexists(faults_path(link))):
        return None, ""
    try:
        return _proven(link), ""
    except OSError as error:
        return None, error.strerror or str(error)
    except (ValueError, KeyError, TypeError):
        return None, "what lives there gives no handshake of a virtual prototype"


def require_prototype(link: Path) -> Handshake:
    """The handshake of the prototype at a link that nobody named as a port: what else lives there is nobody's robot.

    Raises:
        PortMissing: there is none, with what is there instead.
    """
    handshake, doubt = examine(str(link))
    if handshake is None:
        raise PortMissing(str(link), doubt or "no virtual prototype lives there", "start one, or give the board's port")
    return handshake


def require_same_pty(port: str, handshake: Handshake, descriptor: int | None) -> None:
    """Raises PortMissing unless what was opened is the pty of the prototype that gave the handshake before."""
    try:
        if descriptor is None or _identity(os.fstat(descriptor)) != _identity(Path(handshake.device).stat()):
            raise OSError(None, "another device was opened")
        _require_pty(handshake.pid, handshake.device)
    except OSError as error:
        raise PortMissing(port, "changed while it was opened", "try again") from error


def agree_on_time_scale(port: str, wanted: float | None, handshake: Handshake | None) -> float:
    """The time scale to use: the prototype's, or 1 for a real port. `wanted` None takes what the port has.

    Raises:
        TimeScaleError: `wanted` is another one.
    """
    actual = 1.0 if handshake is None else handshake.time_scale
    if wanted is None or wanted == actual:
        return actual
    if handshake is None:
        raise TimeScaleError(port, wanted, "it is no living virtual prototype, valid is 1 only")
    raise TimeScaleError(port, wanted, f"the virtual prototype runs at {actual:g}, start both with the same one")


def agree_on_board(port: str, spec: str, handshake: Handshake | None) -> None:
    """Raises BoardMismatch if the virtual prototype behind `port` emulates another board than `spec`."""
    if handshake is not None and handshake.board != spec:
        raise BoardMismatch(spec, handshake.board, f"the virtual prototype at {port}")


def _proven(link: Path) -> Handshake:
    folder = private_files.open_folder(link.parent)
    try:
        device = private_files.read_link(folder, link.name)
        if not _is_locked(folder, lock_path(link).name):
            raise OSError(None, "no virtual prototype lives there")
        # through the open folder, so that no other folder takes its place meanwhile; and its path is short
        pid, answer = _ask(f"/proc/self/fd/{folder}/{faults_path(link).name}")
    finally:
        os.close(folder)
    who, where, board = (str(answer[key]) for key in ("instance", "device", "board"))
    shake = Handshake(pid, who, where, float(answer["time_scale"]), str(observer_path(link)), board)
    if shake.device != device:
        raise OSError(None, f"the link leads to {device}, but the virtual prototype's pty is {shake.device}")
    if not (shake.instance and math.isfinite(shake.time_scale) and shake.time_scale > 0):
        raise ValueError
    _require_pty(pid, device)
    return shake


def _ask(socket_path: str) -> tuple[int, Mapping[str, Any]]:
    """Process and answer of whoever listens; a nonce shows that it answers now. Raises OSError, ValueError."""
    nonce = secrets.token_hex(16)
    if not stat.S_ISSOCK(os.lstat(socket_path).st_mode):
        raise OSError(None, "its socket is no socket")
    pid, answer = ask(socket_path, {"who": nonce})
    if answer.get("who") != nonce:
        raise ValueError
    return pid, answer


def ask(socket_path: str | Path, request: Mapping[str, Any]) -> tuple[int, Mapping[str, Any]]:
    """Process and answer of the virtual prototype that listens. Raises OSError, ValueError: it says nothing, or no answer."""
    until = time.monotonic() + ANSWER_LIMIT_S
    while time.monotonic() < until:
        with private_files.connect(socket_path, ANSWER_LIMIT_S) as connection:
            try:
                connection.sendall(json.dumps(request).encode() + b"\n")
                with connection.makefile("rb") as lines:
                    line = lines.readline(_LONGEST_ANSWER)
            except ConnectionError:
                continue  # it did not wait for a question that came late
            pid, _ = private_files.peer(connection)
        if line:
            answer = json.loads(line)
            if not isinstance(answer, Mapping):
                raise ValueError(f"its answer is {answer!r}")
            return pid, answer
    raise OSError(None, f"the virtual prototype did not answer in {ANSWER_LIMIT_S:g} s")


def _require_pty(pid: int, device: str) -> None:
    """Raises OSError unless a process has both ends of a pty."""
    found = _PTY.fullmatch(device)
    if found is None:
        raise OSError(None, f"{device} is no pty")
    far = _identity(Path(device).stat())  # not only its number: containers count their own
    has_far = has_near = False
    for entry in os.scandir(f"/proc/{pid}/fd"):
        try:
            one = Path(entry.path).stat()
            has_far |= _identity(one) == far
            if stat.S_ISCHR(one.st_mode) and one.st_rdev == _PTMX:
                has_near |= f"tty-index:\t{found[1]}\n" in Path(f"/proc/{pid}/fdinfo/{entry.name}").read_text(encoding="ascii")
        except FileNotFoundError:
            continue  # closed meanwhile
    if not (has_far and has_near):
        raise OSError(None, f"{device} is not the pty of the virtual prototype, process {pid}")


def _identity(status: os.stat_result) -> tuple[int, int, int]:
    return status.st_dev, status.st_ino, status.st_rdev


def _is_locked(folder: int, name: str) -> bool:
    descriptor = private_files.open_file(folder, name)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False
