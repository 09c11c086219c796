# SPDX-License-Identifier: Apache-2.0
"""The console: one page, its server, its 3D scene, its side in ROS."""
