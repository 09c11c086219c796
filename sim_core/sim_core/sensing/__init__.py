# SPDX-License-Identifier: Apache-2.0
"""What an inertial sensor in the box tells about the face on which the robot stands. Knows no ROS and no clock."""
