# SPDX-License-Identifier: Apache-2.0
"""The last pulses, kept over restarts: no board can be asked where its actuators are, and none remembers after a reset.

One file a robot, replaced atomically *before* each write to the board. It says of which robot, calibration and board the
pulses are; another one, or none, means that nobody knows where the struts are. It survives the death of the process;
after a power cut of the computer it may be some seconds old, so the operator is asked to look (lifted, hands clear)
before every arm.

A real robot whose calibration does not name it is not remembered. Since it may be any of the named ones, nothing that
was known of those before it moved counts afterwards: each opening that sends such a robot anything leaves a new mark in
`last_pulses-nameless.json`, and a record that knows another mark is no knowledge.
"""

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from hardware_bridge.errors import StateFileError
from hardware_bridge.saved_state import state_file
from hardware_bridge.saved_state.robot_identity import NAMELESS, Identity, record_path
from hardware_bridge.saved_state.state_file import UnreadableError

_WHAT = "the last pulses"
_PLAUSIBLE_US = (500, 2500)
_NO_NAME = "the calibration names no robot, so nothing is remembered of it (a line `robot: NAME` in it gives it a name)"


class LastPulses:
    """Pulses by channel, for one robot with its calibration and board.

    Attributes:
        path: the file.
        identity: whose pulses.
        why: why nobody knows them, after `load`, for people; empty: they are known.
    """

    def __init__(self, directory: Path, identity: Identity) -> None:
        self.path = record_path(directory, "last_pulses", identity)
        self.identity = identity
        self.why = ""
        self._nameless = record_path(directory, "last_pulses", NAMELESS)
        self._saved: dict[str, object] | None = None
        self._others: dict[str, object] | None = None
        self._doubt = ""
        self._mark = self._read_mark()

    def load(self, channels: Sequence[int]) -> tuple[int | None, ...]:
        """Last pulse in [us] of each channel; None where no trustworthy record says so, see `why`."""
        self._saved = self._others = None
        self.why, pulses = self._look()
        if not self.why and not all(str(channel) in pulses for channel in channels):
            self.why = f"the last pulses of {self.identity} are not known of all its channels"
        return tuple(pulses.get(str(channel)) for channel in channels)

    def save(self, channels: Sequence[int], pulses_us: Sequence[int | None], force: bool = False, durable: bool = False) -> None:
        """Replaces the record, if it changes anything or `force` is set; `durable` waits for the disk.

        While nobody knows a single pulse, what the file says of another calibration or board stays: nothing has moved.

        Raises:
            StateFileError: it cannot be written.
        """
        pulses: dict[str, object] = {
            str(channel): pulse for channel, pulse in zip(channels, pulses_us, strict=True) if pulse is not None
        }
        if pulses == self._saved and not force:
            return
        if not self.identity.is_known:
            if pulses and not self._saved:
                self._mark = secrets.token_hex(8)
            if force or not self._saved:
                state_file.write(self._nameless, {"mark": self._mark}, _WHAT, durable)
        elif not pulses and self._others is not None:
            state_file.write(self.path, self._others, _WHAT, durable)
        else:
            whose = {"robot": self.identity.robot, "calibration": self.identity.calibration, "board": self.identity.board}
            state_file.write(self.path, {**whose, "mark": self._mark, "pulses_us": pulses}, _WHAT, durable)
            self._others = None
        self._saved = pulses

    def forget(self, channels: Sequence[int]) -> None:
        """The struts may have moved by themselves. Raises StateFileError: the old record is still there."""
        self._others = None
        try:
            self.save(channels, (None,) * len(channels), force=True)
        except StateFileError:
            try:
                self.path.unlink(missing_ok=True)  # which a full disk permits
            except OSError as error:
                raise StateFileError(str(self.path), error.strerror or str(error), _WHAT) from error

    def becomes(self, calibration_hash: str, pulses_us: Mapping[int, int]) -> None:
        """The same robot at the same pulses, with a calibration that has just been measured at it. Raises StateFileError."""
        self.identity = replace(self.identity, calibration=calibration_hash)
        self.save(list(pulses_us), list(pulses_us.values()), force=True, durable=True)

    def _look(self) -> tuple[str, dict[str, int]]:
        """Why nothing is known, and what is."""
        if not self.identity.is_known:
            return _NO_NAME, {}
        try:
            data = state_file.read(self.path)
            if data is None:
                return f"no last pulses of {self.identity} are kept", {}
            theirs = Identity(
                _text(data.get("robot")), _text(data.get("calibration")), _text(data.get("board")), self.identity.link
            )
            pulses = _pulses(data.get("pulses_us"))
        except UnreadableError as error:
            return str(error), {}
        except ValueError:
            return f"{self.path} is damaged", {}
        if theirs != self.identity:
            self._others = data
            return f"the last pulses are of {theirs}, this is {self.identity}", {}
        if self._doubt or data.get("mark") != self._mark:
            self._others = data
            unnamed = f"after the last pulses of {self.identity} a calibration without a name moved a robot, maybe this one"
            return self._doubt or unnamed, {}
        return "", pulses

    def _read_mark(self) -> object:
        """Of the last nameless robot that moved; None: none ever did, or it does not matter."""
        if self.identity.link:
            return None
        try:
            data = state_file.read(self._nameless)
        except UnreadableError as error:
            self._doubt = f"{error}, so a calibration without a name may have moved this robot; remove that file"
            return secrets.token_hex(8)
        return None if data is None else data.get("mark")


def _text(value: object) -> str:
    if not isinstance(value, str) or len(value) > 200 or not value.isprintable():
        raise ValueError("no text")
    return value


def _pulses(value: object) -> dict[str, int]:
    if not isinstance(value, Mapping):
        raise ValueError("no table")
    low, high = _PLAUSIBLE_US
    for pulse in value.values():
        if not isinstance(pulse, int) or isinstance(pulse, bool) or not low <= pulse <= high:
            raise ValueError("no pulse")
    return dict(value)
