# SPDX-License-Identifier: Apache-2.0
"""Servo boards as bytes: a board is a codec and its quirks.

May import `errors` only: no port, no calibration, no clock.
"""
