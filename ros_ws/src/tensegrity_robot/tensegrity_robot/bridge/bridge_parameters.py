# SPDX-License-Identifier: Apache-2.0
"""The bridge's parameters, and the rules that follow from them."""

from dataclasses import dataclass

from hardware_bridge.boards.registry import SERVO_BOARD
from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.limits import Limits, Pacing
from hardware_bridge.safety.shape_cache import ShapeCheck
from tensegrity_robot.ros.node_parameters import parameter


@dataclass(frozen=True)
class BridgeParameters:
    """Parameters of the bridge; the descriptions are what `ros2 param describe` shows."""

    port: str = parameter("", "device or socket://HOST:PORT of the board; empty: the link of this namespace's virtual prototype")
    board: str = parameter("lsc", SERVO_BOARD)
    baud: int = parameter(0, "rate of board and port [baud]; 0: the board's usual, lsc 9600, else 115200", low=0, high=1_000_000)
    observer: str = parameter(
        "", "Unix socket of an observer; empty: the virtual prototype's own, if the port is its; none: nobody looks"
    )
    time_scale: float = parameter(
        0.0, "robot seconds per second; 0: what the port has: the virtual prototype its own, a real port 1", low=0.0, high=100.0
    )
    calibration: str = parameter("", "calibration YAML; empty: the virtual prototype's")
    stroke_limit_m: float = parameter(0.045, "largest change of a strut from mid stroke [m]", low=0.001, high=0.1)
    speed_limit_m_s: float = parameter(0.02, "largest speed of a strut [m/s of robot time]", low=0.001, high=0.1)
    step_limit_m: float = parameter(0.002, "largest change of a strut in one frame [m]", low=0.0002, high=0.01)
    slack_limit: int = parameter(6, "most tendons that may hang slack in a shape [1]", low=0, high=24)
    duty_fraction: float = parameter(0.2, "part of the duty window that a strut may run [1]", low=0.01, high=1.0)
    duty_window_s: float = parameter(600.0, "window of the duty budget [s of robot time]", low=10.0, high=3600.0)
    burst_fraction: float = parameter(0.9, "part of the burst window that a strut may run [1]", low=0.01, high=1.0)
    burst_window_s: float = parameter(60.0, "short window of the duty budget [s of robot time]", low=5.0, high=600.0)
    back_drive_n: float = parameter(
        46.0, "axial force that an actuator holds without power; held against more, it counts as running [N]", low=0.1, high=1e5
    )
    rested_s: float = parameter(
        0.0,
        "the operator's word at the start: so long the actuators have rested [s of robot time]; what nobody knows counts as run",
        low=0.0,
        high=1e7,
    )
    silent_board: bool = parameter(False, "the operator's word: this board cannot answer; arm it all the same")
    supply_low_v: float = parameter(6.4, "servo supply below which no gait is begun [V], if the board tells it", low=0.1, high=60.0)
    frame_period_s: float = parameter(0.05, "time between frames to the board [s of robot time]", low=0.03, high=0.5)
    homing_speed_m_s: float = parameter(0.008, "speed of the slow move to mid stroke [m/s]", low=0.0005, high=0.02)
    goal_age_s: float = parameter(0.5, "oldest stamp of a motion [s]", low=0.05, high=5.0)
    lease_silence_s: float = parameter(1.0, "longest silence of the lease's holder [s]", low=0.2, high=10.0)
    state_folder: str = parameter(
        "", "where what is known of robots is kept; empty: $SIXSTRUT_STATE_DIR or ~/.local/state/sixstrut"
    )
    record: bool = parameter(True, "record the session as a bag")
    bag_folder: str = parameter("", "where bags go; empty: $SIXSTRUT_BAGS or ./bags")
    space_limit_mb: float = parameter(
        200.0, "free space where bags go below which nothing is armed or moved [MB]", low=1.0, high=1e7
    )
    library: str = parameter("robust", "gait library whose file goes into the bag: a shipped name, or a path")
    prototype_file: str = parameter("", "YAML of the robot's numbers, to judge shapes and for the bag; empty: the nominal ones")
    stall_limit_m: float = parameter(
        0.005, "a strut at rest, seen farther than this from where it was sent, has stalled [m]", low=0.001, high=0.1
    )
    frame: str = parameter("odom", "frame of observed joints; below a namespace its name gets that prefix: robot1/odom")
    autostart: bool = parameter(True, "open the port and go active at once; nothing moves")


def rules_of(p: BridgeParameters, shape_check: ShapeCheck) -> Rules:
    """The supervisor's rules. Raises BridgeError."""
    limits = Limits(
        stroke_m=p.stroke_limit_m,
        speed_m_s=p.speed_limit_m_s,
        step_m=p.step_limit_m,
        goal_age_s=p.goal_age_s,
        lease_silence_s=p.lease_silence_s,
        duty_fraction=p.duty_fraction,
        duty_window_s=p.duty_window_s,
        burst_fraction=p.burst_fraction,
        burst_window_s=p.burst_window_s,
        back_drive_n=p.back_drive_n,
        supply_low_v=p.supply_low_v,
    )
    pacing = Pacing(p.frame_period_s, homing_speed_m_s=p.homing_speed_m_s)
    return Rules(load_calibration(p.calibration or None), limits, pacing, shape_check)
