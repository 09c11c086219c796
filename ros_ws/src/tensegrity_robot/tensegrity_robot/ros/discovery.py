# SPDX-License-Identifier: Apache-2.0
"""Who on the network may find, and so command, the robot: this machine only, unless the user says otherwise."""

import os
import socket
from collections.abc import Mapping, Sequence
from pathlib import Path

from sim_core.files.places import writable_folder
from tensegrity_robot.ros.errors import StartError

DOMAIN = "ROS_DOMAIN_ID"
HIGHEST_DOMAIN = 232
LOGS = "ROS_LOG_DIR"
MIDDLEWARE = "RMW_IMPLEMENTATION"
PEERS = "ROS_STATIC_PEERS"
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
FAST_DDS = "rmw_fastrtps_cpp"
RANGES = ("LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")


def discovery_changes(environ: Mapping[str, str], profile: Path) -> dict[str, str]:
    """What to set in the environment before rclpy's start.

    Nothing asked for, or `LOCALHOST`: every socket on loopback, by the profile, which is only read in full where ROS leaves the
    range to it. `SUBNET` is the explicit choice of a wider network, static peers and a profile of the user's own are others:
    they stay as they are. `profile`: config/loopback.xml.
    """
    # Fast DDS's shared memory holds locks that all its users wait for: a process killed at the wrong moment would leave the bridge
    # waiting for ever. Over UDP nobody's death concerns another.
    changes = {} if TRANSPORTS in environ else {TRANSPORTS: "UDPv4"}
    if environ.get(RANGE, "LOCALHOST") != "LOCALHOST" or environ.get(PEERS):
        return changes
    other_middleware = environ.get(MIDDLEWARE, FAST_DDS) != FAST_DDS
    if other_middleware or environ.get(PROFILES) or not profile.exists():
        return changes | {RANGE: "LOCALHOST"}
    return changes | {PROFILES: str(profile), RANGE: "SYSTEM_DEFAULT"}


def network_problem(environ: Mapping[str, str], middlewares: Sequence[str]) -> tuple[str, str]:
    """Which variable keeps nodes from starting or from finding each other, and how to mend it; two empty texts: none.

    Args:
        environ: the environment.
        middlewares: names of those that are installed.
    """
    domain, reach, middleware = (environ.get(name, "") for name in (DOMAIN, RANGE, MIDDLEWARE))
    if domain.strip() and not (domain.strip().isdecimal() and int(domain) <= HIGHEST_DOMAIN):
        return f"{DOMAIN}={domain}", f"valid is 0 to {HIGHEST_DOMAIN}, and best below 102: export {DOMAIN}=7, or unset it"
    if reach == "OFF":
        return f"{RANGE}=OFF: no node finds another", f"unset {RANGE} (this machine only), or export {RANGE}=SUBNET"
    if reach and reach not in RANGES:
        return f"{RANGE}={reach}", f"valid are {', '.join(RANGES)}; or unset it (this machine only)"
    if middleware and middleware not in middlewares:
        return f"{MIDDLEWARE}={middleware} is not installed", f"unset {MIDDLEWARE}; installed are: {', '.join(middlewares)}"
    for name in (PROFILES, "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_ENVIRONMENT_FILE"):
        if (file := environ.get(name)) and not Path(file).is_file():
            return f"{name}={file}: there is no such file", f"unset {name}, or name a file that exists"
    for peer in filter(None, environ.get(PEERS, "").split(";")):
        try:
            socket.getaddrinfo(peer.strip(), None)
        except OSError as error:
            return f"{PEERS}: {peer} is not known ({error.strerror})", f"unset {PEERS}, or give addresses with ; between"
    return "", ""


def installed_middlewares() -> Sequence[str]:
    """Names of what RMW_IMPLEMENTATION may say."""
    from ament_index_python.resources import get_resources

    return sorted(set(get_resources("rmw_typesupport")) - {"rmw_implementation"})


def require_network() -> None:
    """Look at the environment, and find a place for ROS's logs; to be called before rclpy's start.

    Raises StartError: no node would start with it, or none would find another.
    """
    home = os.environ.get("ROS_HOME")
    os.environ[LOGS] = str(writable_folder(".ros/log", os.environ.get(LOGS), home and Path(home) / "log"))
    problem, mend = network_problem(os.environ, installed_middlewares())
    if problem:
        raise StartError(f"ROS's network: {problem}; {mend}")


def set_discovery() -> None:
    """Change this process's environment so; to be called before rclpy's start. Raises StartError: as `require_network`."""
    from ament_index_python.packages import get_package_share_directory

    require_network()

    profile = Path(get_package_share_directory("tensegrity_robot")) / "config" / "loopback.xml"
    os.environ.update(discovery_changes(os.environ, profile))
