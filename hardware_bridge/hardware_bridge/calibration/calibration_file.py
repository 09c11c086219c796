# SPDX-License-Identifier: Apache-2.0
"""Calibrations on disk: whole ones, written atomically, and the unfinished one that a person may leave and come back to."""

import contextlib
import json
import os
from collections.abc import Mapping
from pathlib import Path

from hardware_bridge.calibration.pulse_map import Calibration, StrutCalibration, parse_calibration, parse_strut, robot_name
from hardware_bridge.errors import CalibrationError
from sim_core.errors import YamlError
from sim_core.files.yaml_reader import read_yaml
from sim_core.names import STRUT_NAMES

_HEAD = """\
# Calibration of one robot, measured with `./sixstrut calibrate`. Another robot needs its own.
#
# pulse [us] = pulse_at_zero_us + trim_us + direction * us_per_mm * stroke [mm];  stroke = rest length - mid stroke
"""
_UNFINISHED_HEAD = "# Unfinished: `./sixstrut calibrate` goes on from here. No bridge takes it.\n"


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
    return head + "\n".join(lines) + "\n"


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
