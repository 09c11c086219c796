from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.calibration import Calibration, load_calibration
from hardware_bridge.checks import Rules
from hardware_bridge.codecs.fit import require_fit
from hardware_bridge.codecs.maestro import Maestro
from hardware_bridge.codecs.registry import BOARDS, parse_board
from hardware_bridge.errors import BoardMismatch, CalibrationError, ParameterError
from hardware_bridge.limits import Pacing

SPECS = ["lsc", "ssc32", "maestro", "maestro:crc", "maestro:device=12", "maestro:device=12:crc"]


@pytest.mark.parametrize("spec", SPECS)
def test_every_board_is_found_by_its_own_name(spec: str) -> None:
    assert parse_board(spec).spec == spec
    assert parse_board(spec.upper()) == parse_board(spec)
    assert spec.startswith(parse_board(spec).name)


def test_options_may_come_in_any_order() -> None:
    assert parse_board("maestro:crc:device=12") == Maestro(12, True)


@pytest.mark.parametrize(
    "spec",
    ["", "lsc:crc", "ssc32u:x", "mastro", "maestro:", "maestro:crc:crc", "maestro:device=128", "maestro:device=", "maestro:crc=1"],
)
def test_another_board_is_refused_with_those_that_exist(spec: str) -> None:
    with pytest.raises(ParameterError, match="valid is lsc, ssc32, or maestro with"):
        parse_board(spec)


@given(st.text(max_size=30).filter(lambda text: text.strip().lower().split(":")[0] not in BOARDS))
def test_any_other_text_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(ParameterError) as caught:
        parse_board(text)
    assert "\n" not in str(caught.value)


# ---- what goes together ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spec", SPECS)
def test_every_board_goes_with_the_usual_rules_at_its_usual_rate(spec: str, calibration: Calibration) -> None:
    board = parse_board(spec)
    require_fit(board, Rules(calibration), board.quirks.usual_baud)


@pytest.mark.parametrize("spec", ["ssc32", "maestro"])
def test_a_rate_at_which_frames_would_queue_is_refused(spec: str, calibration: Calibration) -> None:
    board = parse_board(spec)
    with pytest.raises(ParameterError, match="baud is 9600, valid is at least 1"):
        require_fit(board, Rules(calibration), 9600)
    require_fit(board, Rules(calibration, pacing=Pacing(0.1)), 9600)


def test_a_calibration_made_with_another_board_is_refused(calibration: Calibration) -> None:
    mine = replace(calibration, board="maestro")
    require_fit(parse_board("maestro:crc"), Rules(mine), 115200)
    with pytest.raises(BoardMismatch, match="board is lsc, but the calibration is for maestro; set the board to maestro"):
        require_fit(parse_board("lsc"), Rules(mine), 9600)


@pytest.mark.parametrize(
    ("spec", "change", "problem"),
    [("lsc", {"channel": 0}, "channel is 0, valid is 1 to 32"), ("maestro", {"pulse_us": (900, 2000)}, "valid is within")],
)
def test_what_a_board_does_not_have_is_refused_by_strut(spec: str, change: dict, problem: str) -> None:
    calibration = load_calibration()
    struts = (*calibration.struts[:2], replace(calibration.struts[2], **change), *calibration.struts[3:])
    with pytest.raises(CalibrationError, match=problem) as caught:
        require_fit(parse_board(spec), Rules(replace(calibration, struts=struts)), 115200)
    assert caught.value.strut == "S3"
