# SPDX-License-Identifier: Apache-2.0
"""Names of the robot's parts as messages, files and people write them."""

STRUT_NAMES = ("S1", "S2", "S3", "S4", "S5", "S6")
