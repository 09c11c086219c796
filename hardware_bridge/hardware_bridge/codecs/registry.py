"""Boards by the names that parameters, calibration files and command lines use."""

from __future__ import annotations

from hardware_bridge.codecs import Board
from hardware_bridge.codecs.lsc import Lsc
from hardware_bridge.codecs.maestro import Maestro
from hardware_bridge.codecs.ssc32 import Ssc32
from hardware_bridge.errors import CodecError, ParameterError

BOARDS = ("lsc", "ssc32", "maestro")
VALID = "lsc, ssc32, or maestro with any of :device=0..127 (Pololu protocol) and :crc, such as maestro:device=12:crc"


def parse_board(spec: str) -> Board:
    """The board that a text such as ``lsc``, ``ssc32``, ``maestro`` or ``maestro:device=12:crc`` names.

    Raises:
        ParameterError: No such board or variant; names the valid ones.
    """
    name, *options = spec.strip().lower().split(":")
    if name == "lsc" and not options:
        return Lsc()
    if name == "ssc32" and not options:
        return Ssc32()
    if name != "maestro" or len({option.split("=")[0] for option in options}) != len(options):
        raise ParameterError("board", repr(spec), VALID)
    device = None
    for option in options:
        key, _, value = option.partition("=")
        if key == "device" and value.isdecimal():
            device = int(value)
        elif option != "crc":
            raise ParameterError("board", repr(spec), VALID)
    try:
        return Maestro(device, "crc" in options)
    except CodecError as error:
        raise ParameterError("board", repr(spec), VALID) from error
