# SPDX-License-Identifier: Apache-2.0
import math
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.calibration.calibration_file import load_calibration, parse_calibration
from hardware_bridge.calibration.pulse_map import Calibration
from hardware_bridge.errors import CalibrationError

DEFAULT = load_calibration()


def as_data() -> dict:
    struts = {
        f"S{number}": {
            "channel": number,
            "pulse_at_zero_us": 1500,
            "us_per_mm": 10.0,
            "direction": 1,
            "trim_us": 0,
            "stroke_mm": [-50, 50],
            "pulse_us": [1000, 2000],
        }
        for number in range(1, 7)
    }
    return {"mid_stroke_length_m": 0.234, "struts": struts}


def parse(data: object) -> Calibration:
    return parse_calibration(yaml.safe_dump(data), "robot.yaml")


def test_the_default_is_the_virtual_prototypes() -> None:
    assert parse(as_data()) == DEFAULT
    assert DEFAULT.channels == (1, 2, 3, 4, 5, 6)
    assert DEFAULT.pulses_us([0.184, 0.284, 0.234, 0.189, 0.279, 0.2345]) == (1000, 2000, 1500, 1050, 1950, 1505)


@given(
    st.floats(-0.05, 0.05),
    st.sampled_from([1, -1]),
    st.integers(-100, 100),
    st.floats(1.0, 50.0),
)
def test_the_inverse_is_the_length_that_was_really_sent(stroke_m: float, direction: int, trim_us: int, slope: float) -> None:
    strut = replace(DEFAULT.struts[0], direction=direction, trim_us=trim_us, us_per_mm=slope)
    calibration = replace(DEFAULT, struts=(strut, *DEFAULT.struts[1:]))
    pulse = calibration.pulse_us(0, 0.234 + stroke_m)
    sent_m = calibration.length_m(0, pulse)
    assert abs(sent_m - (0.234 + stroke_m)) <= strut.quantum_m / 2 + 1e-12
    assert calibration.pulse_us(0, sent_m) == pulse


def test_direction_minus_one_shortens_with_a_longer_pulse() -> None:
    data = as_data()
    data["struts"]["S2"]["direction"] = -1
    calibration = parse(data)
    assert calibration.pulse_us(1, 0.244) == 1400
    assert math.isclose(calibration.length_m(1, 1400), 0.244)


def test_the_hash_is_of_the_numbers_not_of_the_text() -> None:
    other = as_data()
    assert parse(other).hash == DEFAULT.hash
    other["struts"]["S6"]["trim_us"] = 0.0
    assert parse(other).hash == DEFAULT.hash
    other["struts"]["S6"]["stroke_mm"] = [-49, 49]
    assert parse(other).hash != DEFAULT.hash


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("channel", 33, "channel is 33, valid is a whole number from 0 to 32"),
        ("channel", 1.5, "channel is 1.5"),
        ("channel", "three", "channel is 'three'"),
        ("channel", 1, "channel 1 already belongs to S1; give each strut its own"),
        ("pulse_at_zero_us", 400, "valid is a whole number from 500 to 2500"),
        ("us_per_mm", 0.0, "us_per_mm is 0.0, valid is a number from 1.0 to 50.0"),
        ("us_per_mm", math.nan, "us_per_mm is nan"),
        ("us_per_mm", math.inf, "us_per_mm is inf"),
        ("us_per_mm", True, "us_per_mm is True"),
        ("direction", 0, "direction is 0, valid is 1 or -1"),
        ("direction", True, "direction is True"),
        ("trim_us", 101, "trim_us is 101"),
        ("trim_us", 20, "stroke 50 mm needs 2020 us, pulse_us permits 1000 to 2000 us; reduce"),
        ("trim_us", None, "trim_us is None"),
        ("stroke_mm", [5, 50], "must have zero inside"),
        ("stroke_mm", [50, -50], "low must be below high"),
        ("stroke_mm", 50, "valid is [low, high]"),
        ("stroke_mm", [-50, math.nan], "stroke_mm is nan"),
        ("pulse_us", [1000, 3000], "pulse_us is 3000"),
        ("pulse_us", "12", "valid is [low, high]"),
    ],
)
def test_an_implausible_value_names_the_strut_and_what_is_valid(field: str, value: object, says: str) -> None:
    data = as_data()
    data["struts"]["S3"][field] = value
    with pytest.raises(CalibrationError) as caught:
        parse(data)
    assert caught.value.strut == "S3"
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_strut_is_named() -> None:
    data = as_data()
    del data["struts"]["S4"]
    with pytest.raises(CalibrationError, match="S4: is missing"):
        parse(data)


def test_a_seventh_strut_is_refused() -> None:
    data = as_data()
    data["struts"]["S7"] = dict(data["struts"]["S1"], stroke_mm=[-20, 20], pulse_us=[900, 2100])
    with pytest.raises(CalibrationError, match="S7: is no strut"):
        parse(data)


def test_a_missing_or_unknown_field_is_named() -> None:
    data = as_data()
    del data["struts"]["S5"]["trim_us"]
    data["struts"]["S5"]["trimm_us"] = 0
    with pytest.raises(CalibrationError, match=r"S5: missing fields \['trim_us'\], unknown fields \['trimm_us'\]"):
        parse(data)


@pytest.mark.parametrize("data", [None, [], 3, {}, {"struts": {}}, {"mid_stroke_length_m": 0.2, "struts": []}])
def test_a_file_of_another_shape_is_refused(data: object) -> None:
    with pytest.raises(CalibrationError, match="valid is"):
        parse(data)


@pytest.mark.parametrize("length", [math.nan, 0.0, 1.5, "long"])
def test_an_implausible_mid_stroke_length_is_refused(length: object) -> None:
    with pytest.raises(CalibrationError, match="mid_stroke_length_m"):
        parse({**as_data(), "mid_stroke_length_m": length})


def test_broken_yaml_is_one_line_with_file_and_line() -> None:
    with pytest.raises(CalibrationError) as caught:
        parse_calibration("mid_stroke_length_m: 0.2\nstruts:\n  S1: {channel: 1\n  S2: 3\n", "robot.yaml")
    assert "robot.yaml, line 4" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_strut_given_twice_is_broken_yaml() -> None:
    text = yaml.safe_dump(as_data()) + "  S1: {}\n"
    with pytest.raises(CalibrationError, match="S1 is given twice"):
        parse_calibration(text, "robot.yaml")


@given(st.text(max_size=200))
def test_any_text_gives_a_calibration_error(text: str) -> None:
    with pytest.raises(CalibrationError) as caught:
        parse_calibration(text, "robot.yaml")
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=r"nowhere\.yaml: cannot be read"):
        load_calibration(tmp_path / "nowhere.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CalibrationError, match="UTF-8"):
        load_calibration(tmp_path / "binary.yaml")


def test_a_file_may_name_its_board() -> None:
    assert load_calibration().board is None
    text = (files("hardware_bridge") / "data" / "calibration_default.yaml").read_text(encoding="utf-8")
    named = parse_calibration(f"board: ssc32\n{text}", "robot.yaml")
    assert named.board == "ssc32"
    assert named.struts == load_calibration().struts
    assert named.hash != load_calibration().hash
    with pytest.raises(CalibrationError, match="board is 'arduino', valid is lsc, ssc32, maestro"):
        parse_calibration(f"board: arduino\n{text}", "robot.yaml")


def named(line: str) -> Calibration:
    text = (files("hardware_bridge") / "data" / "calibration_default.yaml").read_text(encoding="utf-8")
    return parse_calibration(f"{line}\n{text}", "robot.yaml")


def test_a_file_may_name_its_robot_and_old_ones_do_not() -> None:
    assert load_calibration().robot is None
    assert load_calibration().hash == "dac4ccfa5b8af8dac776dd7c834d664c97985ef28ae453009ab16656a376bcba", (
        "as older software has it in its bags"
    )
    blue = named('robot: "blue one"')
    assert blue.robot == "blue one"
    assert blue.struts == load_calibration().struts
    assert len({load_calibration().hash, blue.hash, named("robot: green").hash}) == 3


@pytest.mark.parametrize("name", ["NO", "12", "[a]", '""', '" blue"', '"a\\nb"', '"\\e[31mred"', "x" * 41, '"\u200bhidden"'])
def test_a_name_is_a_short_printable_text(name: str) -> None:
    wanted = r"robot is .*, valid is a text of 1 to 40 characters|write it in quotes if it is text"
    with pytest.raises(CalibrationError, match=wanted) as caught:
        named(f"robot: {name}")
    assert str(caught.value).isprintable()
