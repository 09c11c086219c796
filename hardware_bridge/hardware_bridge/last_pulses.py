"""The last pulses, kept over restarts: no board can be asked where it is, and none remembers after a reset.

One file a port, replaced atomically *before* each write to the board. It survives the death of the process; after a
power cut of the computer it may be some seconds old, so the operator is asked to look (lifted, hands clear) before
every arm.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from hardware_bridge.errors import StateFileError


def state_directory() -> Path:
    """``$SIXSTRUT_STATE_DIR``, or ``~/.local/state/sixstrut``."""
    configured = os.environ.get("SIXSTRUT_STATE_DIR")
    return Path(configured) if configured else Path.home() / ".local" / "state" / "sixstrut"


def record_path(directory: Path, what: str, port: str) -> Path:
    """Where the record of something about the robot behind a port is kept."""
    slug = re.sub(r"[^A-Za-z0-9._-]+", "-", port).strip("-")
    return directory / f"{what}-{slug}.json"


class LastPulses:
    """Pulses by channel, for one robot.

    Attributes:
        path: The file.
        robot: Which robot behind the port: the virtual prototype's instance, empty for a board. Another robot's record
            is no knowledge about this one.
    """

    def __init__(self, directory: Path, port: str, robot: str = "") -> None:
        self.path = record_path(directory, "last_pulses", port)
        self.robot = robot
        self._saved: dict[str, int] | None = None

    def load(self, channels: Sequence[int]) -> tuple[int | None, ...]:
        """Last pulse in [us] of each channel; None where no trustworthy record says so."""
        try:
            data = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return (None,) * len(channels)
        pulses = data.get("pulses_us") if isinstance(data, Mapping) else None
        if not isinstance(pulses, Mapping) or data.get("robot") != self.robot:
            return (None,) * len(channels)
        found = [pulses.get(str(channel)) for channel in channels]
        return tuple(pulse if isinstance(pulse, int) and not isinstance(pulse, bool) else None for pulse in found)

    def save(self, channels: Sequence[int], pulses_us: Sequence[int | None], force: bool = False, durable: bool = False) -> None:
        """Replaces the record, if it changes anything or ``force`` is set; ``durable`` waits for the disk.

        Raises:
            StateFileError: It cannot be written.
        """
        pulses = {str(channel): pulse for channel, pulse in zip(channels, pulses_us, strict=True) if pulse is not None}
        if pulses == self._saved and not force:
            return
        text = json.dumps({"robot": self.robot, "pulses_us": pulses})
        temporary = self.path.with_suffix(f".{os.getpid()}.tmp")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with temporary.open("w", encoding="utf-8") as file:
                file.write(text)
                if durable:
                    file.flush()
                    os.fsync(file.fileno())
            os.replace(temporary, self.path)
        except OSError as error:
            raise StateFileError(str(self.path), error.strerror or str(error)) from error
        self._saved = pulses
