# SPDX-License-Identifier: Apache-2.0
"""Who on the network may find, and so command, the robot: this machine only, unless the user says otherwise."""

import os
from collections.abc import Mapping
from pathlib import Path

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
FAST_DDS = "rmw_fastrtps_cpp"


def discovery_changes(environ: Mapping[str, str], profile: Path) -> dict[str, str]:
    """What to set in the environment before rclpy's start.

    Nothing asked for, or `LOCALHOST`: every socket on loopback, by the profile, which is only read in full where ROS leaves the
    range to it. `SUBNET` is the explicit choice of a wider network, static peers and a profile of the user's own are others:
    they stay as they are. `profile`: config/loopback.xml.
    """
    # Fast DDS's shared memory holds locks that all its users wait for: a process killed at the wrong moment would leave the bridge
    # waiting for ever. Over UDP nobody's death concerns another.
    changes = {} if TRANSPORTS in environ else {TRANSPORTS: "UDPv4"}
    if environ.get(RANGE, "LOCALHOST") != "LOCALHOST" or environ.get("ROS_STATIC_PEERS"):
        return changes
    other_middleware = environ.get("RMW_IMPLEMENTATION", FAST_DDS) != FAST_DDS
    if other_middleware or environ.get(PROFILES) or not profile.exists():
        return changes | {RANGE: "LOCALHOST"}
    return changes | {PROFILES: str(profile), RANGE: "SYSTEM_DEFAULT"}


def set_discovery() -> None:
    """Change this process's environment so; to be called before rclpy's start."""
    from ament_index_python.packages import get_package_share_directory

    profile = Path(get_package_share_directory("tensegrity_robot")) / "config" / "loopback.xml"
    os.environ.update(discovery_changes(os.environ, profile))
