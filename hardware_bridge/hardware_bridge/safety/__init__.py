# SPDX-License-Identifier: Apache-2.0
"""What may move. Pure: no port, no clock, no ROS.

May import `calibration`, `boards` and `errors`.
"""
