# SPDX-License-Identifier: Apache-2.0
"""Emulated boards by name."""

from hardware_bridge.boards.maestro import Maestro
from hardware_bridge.boards.registry import parse_board
from hardware_bridge.virtual_prototype.boards.emulated_board import EmulatedBoard
from hardware_bridge.virtual_prototype.boards.lsc import EmulatedLsc
from hardware_bridge.virtual_prototype.boards.maestro import ControlCenter, EmulatedMaestro
from hardware_bridge.virtual_prototype.boards.ssc32 import EmulatedSsc32


def emulate(spec: str, baud: int | None = None, settings: ControlCenter | None = None) -> EmulatedBoard:
    """The board that `spec` names (see `hardware_bridge.boards.registry`), at a rate; None: its usual one.

    `settings` are a Maestro's; the others have none. Raises ParameterError: no such board.
    """
    board = parse_board(spec)
    rate = board.quirks.usual_baud if baud is None else baud
    if isinstance(board, Maestro):
        return EmulatedMaestro(board, rate, settings)
    return EmulatedSsc32(rate) if board.name == "ssc32" else EmulatedLsc(rate)
