# SPDX-License-Identifier: Apache-2.0
"""Per strut: rest length in m to pulse in µs and back. A missing or implausible calibration never drives a robot."""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from hardware_bridge.boards.registry import BOARDS
from hardware_bridge.errors import CalibrationError
from sim_core.errors import FileError, YamlError, brief
from sim_core.files.bounded_reader import read_bytes
from sim_core.files.yaml_reader import parse_yaml
from sim_core.names import STRUT_NAMES

LONGEST_NAME = 40
"""Characters of a robot's name."""

_PLAUSIBLE: dict[str, tuple[float, float]] = {
    "channel": (0, 32),
    "pulse_at_zero_us": (500, 2500),
    "us_per_mm": (1.0, 50.0),
    "direction": (-1, 1),
    "trim_us": (-100, 100),
    "stroke_mm": (-150.0, 150.0),
    "pulse_us": (500, 2500),
}
_PLAUSIBLE_MID_STROKE_M = (0.05, 1.0)
_INTEGERS = {"channel", "pulse_at_zero_us", "trim_us"}
_PAIRS = {"stroke_mm", "pulse_us"}


@dataclass(frozen=True)
class StrutCalibration:
    """One strut's actuator.

    Attributes:
        channel: the board's channel.
        pulse_at_zero_us: pulse at zero stroke before the trim, in [us].
        us_per_mm: slope, always positive, in [us/mm].
        direction: +1 if a longer pulse lengthens the strut, else -1.
        trim_us: added to every pulse, in [us].
        stroke_mm: shortest and longest stroke that the actuator may take, in [mm]; zero lies inside.
        pulse_us: shortest and longest pulse that may be sent, in [us].
    """

    channel: int
    pulse_at_zero_us: int
    us_per_mm: float
    direction: int
    trim_us: int
    stroke_mm: tuple[float, float]
    pulse_us: tuple[int, int]

    def stroke_to_pulse(self, stroke_m: float) -> int:
        """Nearest whole pulse in [us]; halves go up. Says nothing about limits."""
        exact = self.pulse_at_zero_us + self.trim_us + self.direction * self.us_per_mm * stroke_m * 1e3
        return math.floor(exact + 0.5)

    def pulse_to_stroke(self, pulse_us: float) -> float:
        """The stroke in [m] that a pulse stands for."""
        return (pulse_us - self.pulse_at_zero_us - self.trim_us) / (self.direction * self.us_per_mm) * 1e-3

    @property
    def quantum_m(self) -> float:
        """Change of length for one µs, in [m]."""
        return 1e-3 / self.us_per_mm


@dataclass(frozen=True)
class Calibration:
    """Six struts, S1 first.

    Attributes:
        mid_stroke_length_m: rest length at zero stroke, in [m].
        struts: six `StrutCalibration`.
        board: name of the board that it was measured with; None: the file does not say.
        robot: name of the robot; None: the file does not say, and nothing is remembered of a real one.
    """

    mid_stroke_length_m: float
    struts: tuple[StrutCalibration, ...]
    board: str | None = None
    robot: str | None = None

    @property
    def channels(self) -> tuple[int, ...]:
        """The board's channels of S1 to S6."""
        return tuple(strut.channel for strut in self.struts)

    def pulse_us(self, index: int, length_m: float) -> int:
        """Whole pulse in [us] for the rest length in [m] of strut `index` (from 0)."""
        return self.struts[index].stroke_to_pulse(length_m - self.mid_stroke_length_m)

    def length_m(self, index: int, pulse_us: float) -> float:
        """Rest length in [m] that `pulse_us` really asks strut `index` (from 0) for."""
        return self.mid_stroke_length_m + self.struts[index].pulse_to_stroke(pulse_us)

    def pulses_us(self, lengths_m: Sequence[float]) -> tuple[int, ...]:
        """Six pulses in [us] for six rest lengths in [m]."""
        return tuple(self.pulse_us(index, length) for index, length in enumerate(lengths_m))

    def lengths_m(self, pulses_us: Sequence[int]) -> tuple[float, ...]:
        """Six rest lengths in [m] that six pulses really ask for."""
        return tuple(self.length_m(index, pulse) for index, pulse in enumerate(pulses_us))

    @property
    def hash(self) -> str:
        """sha256 over names and numbers, in hexadecimal: equal for equal calibrations, whatever the file looks like."""
        values = {key: value for key, value in asdict(self).items() if value is not None}
        text = json.dumps(values, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()


def load_calibration(path: str | Path | None = None) -> Calibration:
    """Reads and checks a calibration file; without a path, the virtual prototype's.

    Raises:
        CalibrationError: one line with file, line or strut, and what is valid.
    """
    if path is None:
        name = "calibration_default.yaml"
        text = resources.files("hardware_bridge").joinpath("data", name).read_text(encoding="utf-8")
        return parse_calibration(text, name)
    try:
        return parse_calibration(read_bytes(path), str(path))
    except OSError as error:
        raise CalibrationError(str(path), f"cannot be read ({error.strerror}); give an existing YAML file") from error
    except FileError as error:
        raise CalibrationError(str(path), f"{error.problem}; {error.remedy}") from error


def parse_calibration(text: str | bytes, source: str) -> Calibration:
    """The calibration in YAML text; `source` names it in errors.

    Raises:
        CalibrationError: as `load_calibration`.
    """
    try:
        data = parse_yaml(text, source)
    except YamlError as error:
        raise CalibrationError(source, f"broken YAML, {error.problem}; {error.remedy}", line=error.line) from error
    if not isinstance(data, Mapping) or set(data) - {"board", "robot"} != {"mid_stroke_length_m", "struts"}:
        got = sorted(map(str, data)) if isinstance(data, Mapping) else type(data).__name__
        raise CalibrationError(source, f"top level is {got}, valid is mid_stroke_length_m, struts and, if you like, board, robot")
    robot = None if data.get("robot") is None else robot_name(data["robot"], source)
    board = data.get("board")
    if board is not None and board not in BOARDS:
        raise CalibrationError(source, f"board is {brief(board)}, valid is {', '.join(BOARDS)}")
    mid_m = _number(source, None, "mid_stroke_length_m", data["mid_stroke_length_m"], _PLAUSIBLE_MID_STROKE_M)
    struts = data["struts"]
    if not isinstance(struts, Mapping):
        raise CalibrationError(source, "struts is no table, valid is one entry for each of S1 to S6")
    for name in (*STRUT_NAMES, *struts):
        if name not in struts:
            raise CalibrationError(source, "is missing; every one of S1 to S6 needs an entry", strut=name)
        if name not in STRUT_NAMES:
            raise CalibrationError(source, "is no strut, valid are S1 to S6", strut=str(name))
    parsed = tuple(parse_strut(source, name, struts[name]) for name in STRUT_NAMES)
    channels = [strut.channel for strut in parsed]
    for name, channel in zip(STRUT_NAMES, channels, strict=True):
        first = STRUT_NAMES[channels.index(channel)]
        if first != name:
            raise CalibrationError(source, f"channel {channel} already belongs to {first}; give each strut its own", strut=name)
    return Calibration(mid_m, parsed, board, robot)


def robot_name(value: object, source: str) -> str:
    """A robot's name: what it is known by, wherever it is plugged in. `source` names it in errors. Raises CalibrationError."""
    if isinstance(value, str) and 1 <= len(value) <= LONGEST_NAME and value.isprintable() and value == value.strip():
        return value
    got = repr(value) if len(repr(value)) < 80 else f"{repr(value)[:80]}…"
    valid = f'a text of 1 to {LONGEST_NAME} characters on one line, such as robot: "blue one"'
    raise CalibrationError(source, f"robot is {got}, valid is {valid}")


def parse_strut(source: str, name: str, data: object) -> StrutCalibration:
    """One strut's entry; `source` and `name` say in errors whose it is. Raises CalibrationError."""
    if not isinstance(data, Mapping) or set(data) != set(_PLAUSIBLE):
        got = set(data) if isinstance(data, Mapping) else set()
        missing, unknown = sorted(_PLAUSIBLE.keys() - got), sorted(map(str, got - _PLAUSIBLE.keys()))
        raise CalibrationError(source, f"missing fields {missing}, unknown fields {unknown}", strut=name)
    if isinstance(data["direction"], bool) or data["direction"] not in (-1, 1):
        raise CalibrationError(source, f"direction is {brief(data['direction'])}, valid is 1 or -1", strut=name)
    values: dict[str, Any] = {
        key: (_pair if key in _PAIRS else _number)(source, name, key, data[key], valid) for key, valid in _PLAUSIBLE.items()
    }
    values |= {"direction": int(data["direction"]), "pulse_us": tuple(map(int, values["pulse_us"]))}
    strut = StrutCalibration(**values)
    if not strut.stroke_mm[0] < 0 < strut.stroke_mm[1]:
        raise CalibrationError(source, f"stroke_mm {list(strut.stroke_mm)} must have zero inside", strut=name)
    low_us, high_us = strut.pulse_us
    for end_mm in strut.stroke_mm:
        at_end = strut.stroke_to_pulse(end_mm * 1e-3)
        if not low_us <= at_end <= high_us:
            needs = f"stroke {end_mm:g} mm needs {at_end} us, pulse_us permits {low_us} to {high_us} us"
            raise CalibrationError(source, f"{needs}; reduce stroke_mm or trim_us", strut=name)
    return strut


def _number(source: str, strut: str | None, field: str, value: object, valid: tuple[float, float]) -> float:
    whole = field in _INTEGERS
    if (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and math.isfinite(value)
        and (not whole or value == int(value))
        and valid[0] <= value <= valid[1]
    ):
        return int(value) if whole else float(value)
    kind = "a whole number" if whole else "a number"
    raise CalibrationError(source, f"{field} is {brief(value)}, valid is {kind} from {valid[0]} to {valid[1]}", strut)


def _pair(source: str, strut: str, field: str, value: object, valid: tuple[float, float]) -> tuple[float, float]:
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 2:
        raise CalibrationError(source, f"{field} is {brief(value)}, valid is [low, high]", strut)
    low, high = (_number(source, strut, field, item, valid) for item in value)
    if low >= high:
        raise CalibrationError(source, f"{field} is {brief(value)}, low must be below high", strut)
    return low, high
