# SPDX-License-Identifier: Apache-2.0
"""The one list of boards, by the names that parameters, calibration files and command lines use. Light to import."""

from __future__ import annotations

BOARDS = ("lsc", "ssc32", "maestro")
VALID = (
    "lsc, ssc32, or maestro with any of :device=0..127 (Pololu protocol), :crc and :limits=LOW-HIGH (us, if not 992-2000), such as "
    "maestro:device=12:crc"
)
SERVO_BOARD = "servo board: lsc, ssc32 or maestro, the last with :device=N (Pololu protocol) and :crc if so set"
"""For help texts."""
