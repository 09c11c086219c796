# SPDX-License-Identifier: Apache-2.0
"""How long each strut has run lately, kept over restarts of the bridge: motors stay warm.

It belongs to the actuators: one file a robot, whatever its calibration, board and port. What nobody knows counts as
spent: a robot without a record, or with one that cannot be trusted, may have run until now. A new virtual prototype has
not.
"""

import logging
import math
import time
from collections.abc import Sequence
from pathlib import Path

from hardware_bridge.errors import StateFileError
from hardware_bridge.safety.duty_cycle import SPELL_S, Duty, Spell
from hardware_bridge.safety.limits import Limits
from hardware_bridge.saved_state import state_file
from hardware_bridge.saved_state.robot_identity import NAMELESS, Identity, record_path
from hardware_bridge.saved_state.state_file import UnreadableError
from sim_core.names import STRUT_NAMES

_log = logging.getLogger(__name__)

SAVE_PERIOD_S = 1.0
"""A bridge that is killed forgets at most so much of its struts' running, in wall time."""

UNKNOWN_S = math.inf
"""The running time of a spell of which nothing is known: more than any budget."""

_BOOT = Path("/proc/sys/kernel/random/boot_id")
_MOST_SPELLS = 1000
_YEAR_2024_S = 1_704_067_200.0


class DutyRecord:
    """Spells of running of one robot.

    Rest while no bridge ran counts by a clock that runs through suspend and that no setting of the time changes. After a
    restart of the computer only what is beyond doubt counts: the time since that restart, and no more than the calendar
    says.

    Attributes:
        path: the file.
        identity: whose actuators; only its robot matters.
    """

    def __init__(self, directory: Path, identity: Identity, limits: Limits) -> None:
        self.path = record_path(directory, "duty", identity)
        self.identity = identity
        self._limits = limits
        self._nameless = record_path(directory, "duty", NAMELESS)
        self._known_since_s = -math.inf
        self._saved: Duty | None = None
        self._saved_s = -math.inf
        self._told = False

    def load(self, now_s: float, time_scale: float, rested_s: float = 0.0) -> Duty:
        """What counts still, on a robot clock that reads `now_s`.

        Args:
            now_s: the robot clock, in [s].
            time_scale: robot seconds per second.
            rested_s: for how long the actuators have rested by the operator's word, in [s] of robot time. It is taken for what
                nobody knows, not against what the record knows.
        """
        window_s = self._limits.longest_window_s
        known_s, spells = self._past(self.path, time_scale, rested_s)
        if not self.identity.is_known:
            known_s = 0.0  # of some robot without a name, not of this one
        elif not self.identity.link:  # what moved without a name may have been this one
            readable, more = self._past(self._nameless, time_scale, rested_s)
            spells += more
            if readable < 0.0:
                known_s = min(known_s, 0.0)
        known_s = max(known_s, rested_s, 0.0)
        self._known_since_s = now_s - known_s
        # A record of an older software has spells as long as this, and does not say when they ended.
        longest_s = max(SPELL_S, self._limits.duty_window_s / 60)
        loaded = [Spell(now_s - age_s, now_s - max(0.0, age_s - longest_s), run_s) for age_s, run_s in spells]
        if known_s < window_s:
            since_s = now_s - known_s - SPELL_S
            loaded.append(Spell(since_s, since_s, (UNKNOWN_S,) * len(STRUT_NAMES)))
        return Duty(tuple(sorted(loaded)))

    def save(self, duty: Duty, now_s: float, force: bool = False) -> None:
        """Replaces the record if it has changed, and not more often than is useful unless `force` is set.

        Raises:
            StateFileError: it cannot be written.
        """
        wall_s = time.monotonic()
        if not force and (duty == self._saved or wall_s - self._saved_s < SAVE_PERIOD_S):
            return
        data: dict[str, object] = {
            "robot": self.identity.robot,
            "boot": _boot(),
            "steady_s": _steady_s(),
            "wall_s": _wall_s(),
            "known_s": round(max(0.0, min(now_s - self._known_since_s, self._limits.longest_window_s)), 3),
            "spells": [[round(now_s - s.start_s, 3), [round(run, 3) for run in s.run_s]] for s in duty.spells if s.is_known],
        }
        state_file.write(self.path, data, "the struts' running time")
        self._saved, self._saved_s = duty, wall_s

    def try_to_save(self, duty: Duty, now_s: float) -> None:
        """As `save`, but a failure is only logged, once: no motion ends for it, and `arm` looks again."""
        try:
            self.save(duty, now_s)
        except StateFileError as error:
            if not self._told:
                _log.error("%s", error)
            self._told = True

    def _past(self, path: Path, time_scale: float, rested_s: float) -> tuple[float, list[tuple[float, tuple[float, ...]]]]:
        """For how long all is known of the past, and (age, run time) of its spells, in [s] of robot time.

        Less than nothing is known of a file that cannot be trusted; all, if nothing can have run.
        """
        try:
            data = state_file.read(path)
            if data is None:
                fresh = bool(self.identity.link) or path == self._nameless
                return (math.inf if fresh else 0.0), []
            if data["robot"] != self.identity.robot and path != self._nameless:
                return (math.inf if self.identity.link else 0.0), []
            rest_s = _rest_s(data) * time_scale
            if data["boot"] != _boot():
                rest_s = max(rest_s, rested_s)
            known_s = _number(data["known_s"])
            spells = [(rest_s + _number(age_s), tuple(map(_number, run_s))) for age_s, run_s in _spells(data["spells"])]
        except UnreadableError as error:
            _log.warning("%s; the struts count as having run until now", error)
            return -1.0, []
        except (KeyError, TypeError, ValueError, OverflowError):
            _log.warning("%s is damaged; the struts count as having run until now", path)
            return -1.0, []
        return known_s + rest_s, spells


def _rest_s(data: dict[str, object]) -> float:
    """Wall time since a record that is certain to have been rest, in [s]."""
    steady_s, wall_s, boot = _number(data["steady_s"]), _number(data["wall_s"]), _boot()
    if boot and data["boot"] == boot:
        return max(0.0, _steady_s() - steady_s)
    if min(wall_s, _wall_s()) < _YEAR_2024_S:
        return 0.0  # a clock that nobody has set
    return max(0.0, min(_steady_s(), _wall_s() - wall_s))


def _spells(value: object) -> Sequence[tuple[object, Sequence[object]]]:
    if not isinstance(value, list) or len(value) > _MOST_SPELLS:
        raise ValueError("no spells")
    if any(len(spell) != 2 or not isinstance(spell[1], list) or len(spell[1]) != len(STRUT_NAMES) for spell in value):
        raise ValueError("no spell")
    return value


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < math.inf:
        raise ValueError("no time")
    return float(value)


def _boot() -> str:
    try:
        return _BOOT.read_text(encoding="ascii").strip()
    except OSError:
        return ""


def _steady_s() -> float:
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def _wall_s() -> float:
    return time.time()
