# SPDX-License-Identifier: Apache-2.0
"""What goes together, and what is refused before a port is opened."""

from dataclasses import replace

import pytest

from hardware_bridge.boards.registry import parse_board
from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.calibration.pulse_map import Calibration
from hardware_bridge.errors import BoardMismatch, CalibrationError, ParameterError
from hardware_bridge.safety.compatibility import require_fit
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.limits import Pacing
from tests.hardware_bridge.boards.test_registry import SPECS


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
