# SPDX-License-Identifier: Apache-2.0
"""Calibrations on disk: read and checked, written atomically, and the unfinished one that a person may leave and come back to.

A missing or implausible calibration never drives a robot.
"""

import contextlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from hardware_bridge.boards.registry import BOARDS
from hardware_bridge.calibration.pulse_map import Calibration, StrutCalibration
from hardware_bridge.errors import CalibrationError
from sim_core.errors import FileError, YamlError, brief
from sim_core.files.bounded_reader import read_bytes
from sim_core.files.yaml_reader import parse_yaml, read_yaml, sealed
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
_HEAD = """\
# Calibration of one robot, measured with `./sixstrut calibrate`. Another robot needs its own.
#
# pulse [us] = pulse_at_zero_us + trim_us + direction * us_per_mm * stroke [mm];  stroke = rest length - mid stroke
"""
_UNFINISHED_HEAD = "# Unfinished: `./sixstrut calibrate` goes on from here. No bridge takes it.\n"


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


def text_of(robot: str | None, mid_stroke_length_m: float, struts: Mapping[str, StrutCalibration], head: str = _HEAD) -> str:
    """The YAML; `robot` None: without a name."""
    named = [] if robot is None else [f"robot: {json.dumps(robot, ensure_ascii=False)}"]
    lines = [*named, f"mid_stroke_length_m: {mid_stroke_length_m:g}", "struts:"]
    for name, strut in struts.items():
        (low_mm, high_mm), (low_us, high_us) = strut.stroke_mm, strut.pulse_us
        lines.append(
            f"  {name}: {{channel: {strut.channel}, pulse_at_zero_us: {strut.pulse_at_zero_us}, "
            f"us_per_mm: {strut.us_per_mm!r}, direction: {strut.direction}, trim_us: {strut.trim_us}, "
            f"stroke_mm: [{low_mm:g}, {high_mm:g}], pulse_us: [{low_us}, {high_us}]}}"
        )
    return sealed(head + "\n".join(lines) + "\n")


def write_calibration(
    path: Path, mid_stroke_length_m: float, struts: Mapping[str, StrutCalibration], robot: str | None = None
) -> Calibration:
    """Replaces the file at once, on the disk before this returns; what was read back.

    Raises:
        CalibrationError: it would not be valid, or cannot be written; the old file stays.
    """
    text = text_of(robot, mid_stroke_length_m, {name: struts[name] for name in STRUT_NAMES if name in struts})
    calibration = parse_calibration(text, str(path))
    _replace(path, text)
    return calibration


class Unfinished:
    """The struts that are done, beside the file that they will go into.

    Attributes:
        path: `<file>.part`.
        robot: name of the robot; None while not known.
        mid_stroke_length_m: None while not known.
        struts: name to calibration, those that are done.
    """

    def __init__(self, file: Path) -> None:
        """Raises CalibrationError: there is an unfinished one, but it cannot be understood."""
        self.path = file.with_name(file.name + ".part")
        self.robot: str | None = None
        self.mid_stroke_length_m: float | None = None
        self.struts: dict[str, StrutCalibration] = {}
        if self.path.exists():
            self._load()

    def save(self) -> None:
        """Raises CalibrationError: it cannot be written."""
        assert self.mid_stroke_length_m is not None
        _replace(self.path, text_of(self.robot, self.mid_stroke_length_m, self.struts, _UNFINISHED_HEAD))

    def remove(self) -> None:
        """It is finished, or not wanted."""
        self.path.unlink(missing_ok=True)

    def _load(self) -> None:
        try:
            data = read_yaml(self.path)
            self.mid_stroke_length_m = float(data["mid_stroke_length_m"])
            found = dict(data["struts"] or {})
            robot = data.get("robot")
        except (OSError, YamlError, AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
            raise CalibrationError(str(self.path), "cannot be understood; remove it to begin anew") from error
        self.robot = None if robot is None else robot_name(robot, str(self.path))
        self.struts = {name: parse_strut(str(self.path), name, found[name]) for name in STRUT_NAMES if name in found}


def _replace(path: Path, text: str) -> None:
    temporary = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        reason = error.strerror or str(error)
        raise CalibrationError(str(path), f"cannot be written ({reason}); make its folder writable or give another") from error


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
