"""How long each strut has run lately, kept over restarts of the bridge beside the last pulses: motors stay warm."""

from __future__ import annotations

import json
import logging
import os
import time
from collections.abc import Mapping
from pathlib import Path

from hardware_bridge.calibration import STRUTS
from hardware_bridge.duty import Duty
from hardware_bridge.errors import StateFileError
from hardware_bridge.last_pulses import record_path
from hardware_bridge.limits import Limits

_log = logging.getLogger(__name__)

SAVE_PERIOD_S = 1.0
"""A bridge that is killed forgets at most so much of its struts' running, in wall time."""

_BOOT = Path("/proc/sys/kernel/random/boot_id")


class DutyRecord:
    """Spells of running, for one robot; see ``LastPulses`` for which one.

    Rest while no bridge ran counts by a clock that no setting of the time changes; after a restart of the computer, by
    the calendar, and never as less than nothing.
    """

    def __init__(self, directory: Path, port: str, robot: str = "") -> None:
        self.path = record_path(directory, "duty", port)
        self.robot = robot
        self._saved = Duty()
        self._saved_s = -float("inf")
        self._told = False

    def load(self, now_s: float, time_scale: float, limits: Limits) -> Duty:
        """What is known to count still, on a robot clock that reads ``now_s``; nothing if no trustworthy record says so."""
        try:
            data = json.loads(self.path.read_text(encoding="utf-8"))
            if not isinstance(data, Mapping) or data["robot"] != self.robot:
                return Duty()
            same_boot = data["boot"] == _boot()
            rest_s = _steady_s() - float(data["steady_s"]) if same_boot else time.time() - float(data["wall_s"])
            spells = [(float(age_s), tuple(map(float, run_s))) for age_s, run_s in data["spells"]]
        except (OSError, ValueError, KeyError, TypeError):
            return Duty()
        if any(len(run_s) != len(STRUTS) for _, run_s in spells):
            return Duty()
        rest_s = max(0.0, rest_s) * time_scale
        kept = [(now_s - rest_s - age_s, run_s) for age_s, run_s in spells if age_s + rest_s <= 2 * limits.duty_window_s]
        return Duty(tuple(kept))

    def save(self, duty: Duty, now_s: float, force: bool = False) -> None:
        """Replaces the record if it has changed, and not more often than is useful unless ``force`` is set.

        Raises:
            StateFileError: It cannot be written.
        """
        wall_s = time.monotonic()
        if duty == self._saved or not (force or wall_s - self._saved_s >= SAVE_PERIOD_S):
            return
        spells = [[round(now_s - start_s, 3), [round(run, 3) for run in run_s]] for start_s, run_s in duty.spells]
        data = {"robot": self.robot, "boot": _boot(), "steady_s": _steady_s(), "wall_s": time.time(), "spells": spells}
        temporary = self.path.with_suffix(f".{os.getpid()}.tmp")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            temporary.write_text(json.dumps(data), encoding="utf-8")
            os.replace(temporary, self.path)
        except OSError as error:
            raise StateFileError(str(self.path), error.strerror or str(error), "the struts' running time") from error
        self._saved, self._saved_s = duty, wall_s

    def try_to_save(self, duty: Duty, now_s: float) -> None:
        """As ``save``, but a failure is only logged, once: no motion ends for it, and ``arm`` looks again."""
        try:
            self.save(duty, now_s)
        except StateFileError as error:
            if not self._told:
                _log.error("%s", error)
            self._told = True


def _boot() -> str:
    try:
        return _BOOT.read_text(encoding="ascii").strip()
    except OSError:
        return ""


def _steady_s() -> float:
    return time.clock_gettime(time.CLOCK_BOOTTIME)
