"""How a bridge knows that a port is the virtual prototype: not by its name, but by what its living owner keeps by it.

Beside the link ``L`` the prototype keeps ``L.lock`` (locked while it lives), ``L.json`` (this handshake), ``L.observer``
and ``L.faults`` (Unix sockets, see the prototype's observer and ``fault_injection``).
"""

from __future__ import annotations

import fcntl
import json
import math
import os
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from hardware_bridge.errors import BoardMismatch, TimeScaleError


@dataclass(frozen=True)
class Handshake:
    """What the virtual prototype says about itself; nothing about its parameters.

    Attributes:
        pid: Its process.
        instance: New at every start: another robot, whose struts are elsewhere.
        device: The pty behind the link.
        time_scale: Its robot seconds per second.
        observer: Path of its observer's socket.
        board: The board that it emulates (see ``codecs.registry``).
    """

    pid: int
    instance: str
    device: str
    time_scale: float
    observer: str
    board: str = "lsc"


def default_link() -> Path:
    """Where the prototype is linked if nobody says otherwise."""
    for variable, below in (("SIXSTRUT_STATE_DIR", ""), ("XDG_RUNTIME_DIR", "sixstrut")):
        if os.environ.get(variable):
            return Path(os.environ[variable]) / below / "prototype"
    return Path(tempfile.gettempdir()) / f"sixstrut-{os.getuid()}" / "prototype"


def lock_path(link: Path) -> Path:
    """The file whose lock means that the prototype lives."""
    return link.with_name(link.name + ".lock")


def handshake_path(link: Path) -> Path:
    """The file with the handshake."""
    return link.with_name(link.name + ".json")


def observer_path(link: Path) -> Path:
    """The observer's socket."""
    return link.with_name(link.name + ".observer")


def faults_path(link: Path) -> Path:
    """The socket where it is told to fail."""
    return link.with_name(link.name + ".faults")


def write_handshake(link: Path, handshake: Handshake) -> None:
    """Puts the handshake beside the link, atomically."""
    path = handshake_path(link)
    temporary = path.with_suffix(f".{os.getpid()}.tmp")
    temporary.write_text(json.dumps(asdict(handshake)), encoding="utf-8")
    os.replace(temporary, path)


def read_handshake(port: str) -> Handshake | None:
    """The handshake of the living prototype behind ``port``, or None: a real port."""
    link = Path(port)
    try:
        if not link.is_symlink() or not _is_locked(lock_path(link)):
            return None
        data = json.loads(handshake_path(link).read_text(encoding="utf-8"))
        if not isinstance(data, Mapping) or data.get("device") != os.readlink(link):
            return None
        shake = Handshake(
            int(data["pid"]),
            str(data["instance"]),
            str(data["device"]),
            float(data["time_scale"]),
            str(data["observer"]),
            str(data.get("board", "lsc")),
        )
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return shake if shake.time_scale > 0 and math.isfinite(shake.time_scale) else None


def agree_on_time_scale(port: str, wanted: float | None, handshake: Handshake | None) -> float:
    """The time scale to use: the prototype's, or 1 for a real port. ``wanted`` None takes what the port has.

    Raises:
        TimeScaleError: ``wanted`` is another one.
    """
    actual = 1.0 if handshake is None else handshake.time_scale
    if wanted is None or wanted == actual:
        return actual
    if handshake is None:
        raise TimeScaleError(port, wanted, "it is no living virtual prototype, valid is 1 only")
    raise TimeScaleError(port, wanted, f"the virtual prototype runs at {actual:g}, start both with the same one")


def agree_on_board(port: str, spec: str, handshake: Handshake | None) -> None:
    """Raises BoardMismatch if the virtual prototype behind ``port`` emulates another board than ``spec``."""
    if handshake is not None and handshake.board != spec:
        raise BoardMismatch(spec, handshake.board, f"the virtual prototype at {port}")


def _is_locked(path: Path) -> bool:
    with path.open("rb") as handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False
