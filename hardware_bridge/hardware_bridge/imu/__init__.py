# SPDX-License-Identifier: Apache-2.0
"""Inertial sensors on a serial port of their own: their bytes. Nothing here can reach the servo board."""
