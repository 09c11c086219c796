# SPDX-License-Identifier: Apache-2.0
"""Calibrations on disk, whole and unfinished."""

from pathlib import Path

import pytest

from hardware_bridge.calibration.calibration_file import Unfinished, load_calibration, write_calibration
from hardware_bridge.calibration.pulse_map import Calibration
from hardware_bridge.errors import CalibrationError
from sim_core.names import STRUT_NAMES


def by_name(calibration: Calibration) -> dict:
    return dict(zip(STRUT_NAMES, calibration.struts, strict=True))


def test_what_is_written_is_what_is_read(tmp_path: Path, calibration: Calibration) -> None:
    file = tmp_path / "mine.yaml"
    written = write_calibration(file, 0.234, by_name(calibration))
    assert written == load_calibration(file) == calibration
    assert [path.name for path in tmp_path.iterdir()] == ["mine.yaml"]


@pytest.mark.parametrize("name", ["blue", 'the "blue" one: #1', "Ünï ✓", "NO", "12", "{a}"])
def test_the_robots_name_is_kept_as_it_is(tmp_path: Path, calibration: Calibration, name: str) -> None:
    file = tmp_path / "mine.yaml"
    assert write_calibration(file, 0.234, by_name(calibration), name).robot == load_calibration(file).robot == name
    part = Unfinished(file)
    part.robot, part.mid_stroke_length_m = name, 0.234
    part.save()
    assert Unfinished(file).robot == name


def test_an_incomplete_one_is_not_written_and_the_old_file_stays(tmp_path: Path, calibration: Calibration) -> None:
    file = tmp_path / "mine.yaml"
    write_calibration(file, 0.234, by_name(calibration))
    before = file.read_bytes()
    five = {name: strut for name, strut in by_name(calibration).items() if name != "S4"}
    with pytest.raises(CalibrationError, match="S4: is missing"):
        write_calibration(file, 0.234, five)
    assert file.read_bytes() == before


def test_a_folder_that_takes_no_file_is_named(tmp_path: Path, calibration: Calibration) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CalibrationError, match="cannot be written"):
        write_calibration(tmp_path / "file" / "mine.yaml", 0.234, by_name(calibration))


def test_an_unfinished_one_is_taken_up_again_and_drives_no_robot(tmp_path: Path, calibration: Calibration) -> None:
    file = tmp_path / "mine.yaml"
    first = Unfinished(file)
    assert (first.mid_stroke_length_m, first.struts) == (None, {})
    first.mid_stroke_length_m = 0.2345
    first.struts["S1"] = calibration.struts[0]
    first.save()
    again = Unfinished(file)
    assert again.mid_stroke_length_m == 0.2345
    assert again.struts == {"S1": calibration.struts[0]}
    with pytest.raises(CalibrationError, match="S2: is missing"):
        load_calibration(again.path)
    again.remove()
    assert not again.path.exists()


@pytest.mark.parametrize("text", ["{", "[]", "mid_stroke_length_m: x\nstruts: {}\n", "struts: {}\n"])
def test_an_unfinished_one_that_is_broken_says_what_to_do(tmp_path: Path, text: str) -> None:
    (tmp_path / "mine.yaml.part").write_text(text)
    with pytest.raises(CalibrationError, match="remove it to begin anew"):
        Unfinished(tmp_path / "mine.yaml")
