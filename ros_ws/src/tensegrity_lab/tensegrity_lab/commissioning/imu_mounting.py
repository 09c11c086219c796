# SPDX-License-Identifier: Apache-2.0
"""How the inertial sensor sits in the box: felt on faces that somebody names, by a person who puts the robot there."""

import math
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path

import numpy as np
from rich.console import Console

from hardware_bridge.errors import LinkLost
from hardware_bridge.imu.sensor_port import SensorPort
from hardware_bridge.imu.wt901 import GRAVITY_M_S2
from hardware_bridge.prototype_client.handshake import imu_path
from hardware_bridge.virtual_prototype.practice import practice_prototype
from sim_core.dynamics.model import build_model
from sim_core.errors import ParameterError
from sim_core.sensing.face_filter import box_share
from sim_core.sensing.mounting import LEAST_FACES, Mounting, found_mounting, mounting_text
from sim_core.structure.arrays import Array
from sim_core.structure.parameters import load_prototype
from sim_core.structure.topology import FACES as ALL_FACES
from tensegrity_lab.errors import StackError
from tensegrity_lab.session_data.ledger import write_durably
from tensegrity_lab.terminal.keys import require_keyboard

FACES = ("TC6", "TO5", "TC3", "TO9", "TC2", "TO12")
"""That are felt: they look into directions that are far apart."""
FELT_S, LEAST = 2.0, 50
"""Wall time for which each is felt, and the least measurements in it."""
STALE_S = 0.3
SHAKEN_RAD_S, WRONG = math.radians(5.0), 0.1
"""More turning is no rest; gravity that is off by this part of it is none."""
VIRTUAL_TIME_SCALE = 4.0


def felt_up(port: SensorPort, seconds: float = FELT_S) -> Array:
    """Mean acceleration of a sensor at rest, upward, (3,), in m/s^2. Raises ParameterError: not at rest, or it says too little."""
    until = time.monotonic() + STALE_S
    while time.monotonic() < until:
        port.read(0.05)  # what waited in the port is of before
    end, heard = time.monotonic() + seconds, []
    while time.monotonic() < end:
        heard += [measurement for _, measurement in port.read(0.1)]
    if len(heard) < LEAST:
        told = f"{len(heard)} measurements in {seconds:g} s: {LEAST} are needed"
        raise ParameterError(f"{told}; set the sensor's return rate to 100 Hz, its and the port's baud to the same")
    rates = np.array([measurement.rate_rad_s for measurement in heard])
    up = np.array([measurement.acceleration_m_s2 for measurement in heard]).mean(axis=0)
    shaken = float(np.linalg.norm(rates - rates.mean(axis=0), axis=1).max())
    if shaken > SHAKEN_RAD_S:
        raise ParameterError(f"it turned by {math.degrees(shaken):.0f} degrees a second: let it rest, and try again")
    if abs(float(np.linalg.norm(up)) / GRAVITY_M_S2 - 1.0) > WRONG:
        raise ParameterError(
            f"it feels {np.linalg.norm(up):.1f} m/s^2 at rest, gravity is {GRAVITY_M_S2:.1f}: calibrate the sensor itself"
        )
    return np.asarray(up)


def fitted(felt: Mapping[str, Array], prototype_file: str | None = None) -> Mounting:
    """The mounting, of a robot at neutral lengths on level ground. Raises ParameterError."""
    model = build_model(load_prototype(prototype_file))
    return found_mounting(model, felt, box_share(model))


def virtual_mounting(file: Path, seed: int, perturbation: float, tell: Callable[[str], None] = lambda line: None) -> Mounting:
    """That of a virtual prototype's sensor, put on each face anew on level ground; written into the file. Raises StackError."""
    felt = {}
    try:
        for face in FACES:
            tell(f"feeling the inertial sensor of the virtual prototype on {face}")
            robot = {"imu": "wt901", "face": face, "seed": seed, "perturbation": perturbation}
            with practice_prototype(VIRTUAL_TIME_SCALE, more=robot) as link, closing(SensorPort(str(imu_path(link)))) as port:
                felt[face] = felt_up(port, 1.0)
        mounting = fitted(felt)
    except (ParameterError, LinkLost) as error:
        raise StackError(f"its inertial sensor cannot be used: {error}") from error
    write_mounting(file, mounting)
    return mounting


def write_mounting(file: Path, mounting: Mounting) -> None:
    """Replaces the file at once. Raises OSError: it cannot be written; the old one stays."""
    write_durably(file, mounting_text(mounting))


def felt_by_hand(port: str, baud: int, console: Console) -> dict[str, Array]:
    """As a person puts the robot on face after face, and says so. Raises KeyboardMissing, BridgeError, KeyboardInterrupt."""
    require_keyboard()
    felt: dict[str, Array] = {}
    with closing(SensorPort(port, baud)) as sensor:
        console.print(
            f"The sensor at {port} is heard. Struts at mid stroke, a level floor; {LEAST_FACES} faces are needed, one of them "
            "a TO, and six are better. Ctrl-C leaves, and nothing is written."
        )
        for face in FACES:
            while (
                named := console.input(f"Put the robot on {face}, let go, then Enter; or say the face it is on, or - for none: ")
            ) != "-":
                if (named.strip() or face) not in ALL_FACES:
                    console.print(f"{named} is no face: valid are TC1 to TC8 and TO1 to TO12")
                    continue
                try:
                    felt[named.strip() or face] = felt_up(sensor)
                except ParameterError as error:
                    console.print(f"Once more: {error}.")
                    continue
                break
    return felt
