# SPDX-License-Identifier: Apache-2.0
"""Small JSON files that outlive the bridge: replaced whole, never written or read through a link, never larger than they may be."""

import json
import os
from pathlib import Path

from hardware_bridge.errors import StateFileError
from sim_core.errors import FileError
from sim_core.files.bounded_reader import read_bytes
from sim_core.files.places import writable_folder

LARGEST_BYTES = 1_000_000
"""More than any record can need; what is larger is not read."""


class UnreadableError(Exception):
    """There is a file, and it is none of ours; the text says why, for people."""


def state_directory() -> Path:
    """`$SIXSTRUT_STATE_DIR`, or `~/.local/state/sixstrut`, or the same in a temporary folder where there is no such home."""
    configured = os.environ.get("SIXSTRUT_STATE_DIR")
    return Path(configured) if configured else writable_folder(".local/state/sixstrut")


def read(path: Path) -> dict[str, object] | None:
    """The object in a file; None: there is no such file. Not-a-number and infinity are no JSON here.

    Raises:
        UnreadableError: it is no plain file of this user, is too large, or holds no JSON object.
    """
    try:
        text = read_bytes(path, LARGEST_BYTES, owners=(os.geteuid(), 0))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise UnreadableError(f"{path} cannot be read ({error.strerror})") from error
    except FileError as error:
        raise UnreadableError(f"{path} cannot be read: {error.problem}") from error
    try:
        data = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise UnreadableError(f"{path} is damaged") from error
    if not isinstance(data, dict):
        raise UnreadableError(f"{path} is damaged")
    return data


def write(path: Path, data: dict[str, object], what: str, durable: bool = False) -> None:
    """Replaces a file at once, whatever it was; `durable` waits for the disk.

    Raises:
        StateFileError: `what` cannot be kept; the old file stays.
    """
    temporary = path.with_suffix(f".{os.getpid()}.tmp")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        temporary.unlink(missing_ok=True)  # of a process of this number that was killed
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(json.dumps(data, allow_nan=False))
            if durable:
                file.flush()
                os.fsync(descriptor)
        temporary.replace(path)
    except OSError as error:
        raise StateFileError(str(path), error.strerror or str(error), what) from error


def _refuse(constant: str) -> object:
    raise ValueError(f"{constant} is no JSON")
