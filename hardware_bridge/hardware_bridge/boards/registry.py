# SPDX-License-Identifier: Apache-2.0
"""Boards by the names that parameters, calibration files and command lines use. Light to import."""

import re

from hardware_bridge.boards.board import Board
from hardware_bridge.boards.lsc import Lsc
from hardware_bridge.boards.maestro import LIMITS_US, Maestro
from hardware_bridge.boards.ssc32 import Ssc32
from hardware_bridge.errors import CodecError, ParameterError

BOARDS = ("lsc", "ssc32", "maestro")
VALID = (
    "lsc, ssc32, or maestro with any of :device=0..127 (Pololu protocol), :crc and :limits=LOW-HIGH (us, if not 992-2000), such as "
    "maestro:device=12:crc"
)
SERVO_BOARD = "servo board: lsc, ssc32 or maestro, the last with :device=N (Pololu protocol) and :crc if so set"
"""For help texts."""

_OPTION = re.compile(r"device=(?P<device>[0-9]{1,3})|(?P<crc>crc)|limits=(?P<low>[0-9]{3,4})-(?P<high>[0-9]{3,4})")


def parse_board(spec: str) -> Board:
    """The board that a text such as `lsc`, `ssc32`, `maestro` or `maestro:device=12:crc` names.

    Raises:
        ParameterError: no such board or variant; names the valid ones.
    """
    name, *options = spec.strip().lower().split(":")
    if name == "lsc" and not options:
        return Lsc()
    if name == "ssc32" and not options:
        return Ssc32()
    found: dict[str, str] = {}
    for option in options:
        match = _OPTION.fullmatch(option)
        given = {} if match is None else {key: value for key, value in match.groupdict().items() if value is not None}
        if not given or given.keys() & found.keys():
            raise ParameterError("board", repr(spec), VALID)
        found |= given
    if name != "maestro":
        raise ParameterError("board", repr(spec), VALID)
    device = int(found["device"]) if "device" in found else None
    limits_us = (int(found["low"]), int(found["high"])) if "low" in found else LIMITS_US
    try:
        return Maestro(device, "crc" in found, limits_us)
    except CodecError as error:
        raise ParameterError("board", repr(spec), VALID) from error
