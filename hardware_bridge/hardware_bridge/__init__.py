# SPDX-License-Identifier: Apache-2.0
"""Servo-board codecs, serial transport, safety supervisor, virtual prototype and MCAP recorder. Knows no ROS."""
