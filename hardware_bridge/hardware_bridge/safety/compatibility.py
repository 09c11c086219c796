# SPDX-License-Identifier: Apache-2.0
"""Whether a board, a calibration, a rate and a frame period go together; judged before a port is opened."""

import math

from hardware_bridge.boards.board import Board
from hardware_bridge.errors import BoardMismatch, CalibrationError, ParameterError
from hardware_bridge.safety.limit_checks import Rules
from sim_core.names import STRUT_NAMES

BITS_PER_BYTE = 10
LARGEST_SHARE = 0.9
"""Of a frame period that a frame may take on the wire; queries need the rest."""


def require_fit(board: Board, rules: Rules, baud: int) -> None:
    """Checks everything that would else fail at the first frame, or queue up on the wire.

    Raises:
        BoardMismatch: the calibration was measured with another board.
        CalibrationError: a channel or pulse limit that the board does not have.
        ParameterError: at this rate a frame takes longer than its period permits.
    """
    calibration, quirks = rules.calibration, board.quirks
    if calibration.board is not None and calibration.board != board.name:
        raise BoardMismatch(board.name, calibration.board, "the calibration")
    for name, strut in zip(STRUT_NAMES, calibration.struts, strict=True):
        if not quirks.channels[0] <= strut.channel <= quirks.channels[1]:
            low, high = quirks.channels
            raise CalibrationError(f"for {board.name}", f"channel is {strut.channel}, valid is {low} to {high}", strut=name)
        if strut.pulse_us[0] < quirks.pulse_us[0] or strut.pulse_us[1] > quirks.pulse_us[1]:
            low, high = quirks.pulse_us
            problem = f"pulse_us is {list(strut.pulse_us)}, valid is within [{low}, {high}]"
            raise CalibrationError(f"for {board.name}", problem, strut=name)
    frame_s = BITS_PER_BYTE * quirks.longest_frame_bytes / baud
    period_s = rules.pacing.period_s
    if frame_s > LARGEST_SHARE * period_s:
        fast = math.ceil(BITS_PER_BYTE * quirks.longest_frame_bytes / (LARGEST_SHARE * period_s))
        problem = f"at least {fast} for {board.name} frames of {quirks.longest_frame_bytes} bytes every {period_s * 1e3:g} ms"
        raise ParameterError("baud", baud, f"{problem}; raise the rate of board and radio, or the frame period")
