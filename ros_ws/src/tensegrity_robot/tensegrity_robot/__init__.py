# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 nodes: thin hands over `hardware_bridge` and `sim_core`, which know no ROS."""

import os
import sys

from ament_index_python.resources import has_resource

if (_asked := os.environ.get("RMW_IMPLEMENTATION")) and not has_resource("rmw_typesupport", _asked):
    # rclpy ends the process then, and names no variable
    print(f"RMW_IMPLEMENTATION={_asked} is not installed: unset it", file=sys.stderr)
