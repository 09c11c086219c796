# SPDX-License-Identifier: Apache-2.0
"""How well an inertial sensor in the box tells the face: hidden robots, all libraries and cycles, level ground and slopes."""
