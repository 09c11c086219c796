# SPDX-License-Identifier: Apache-2.0
"""Servo boards as bytes: a board is a codec and its quirks. No port, no calibration, no clock."""
