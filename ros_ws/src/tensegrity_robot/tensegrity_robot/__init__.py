# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 nodes: thin hands over `hardware_bridge` and `sim_core`, which know no ROS.

May import those two packages; what could be tested without ROS lives there.
"""
