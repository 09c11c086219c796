# SPDX-License-Identifier: Apache-2.0
"""Six servo linear actuators on one supply: what becomes of commanded lengths under load.

The solver's own actuator goes to its target at a constant speed whatever the load, and stays. This model stands between a command
and that target, outside the solver: every few milliseconds it takes the struts' forces and gives the lengths that the actuators
have. It is a model of effects (of which sign and about what size), not of a product: see the sources in data/actuators.yaml.

For each actuator, with commanded length c, length of the screw x, supply voltage u = r times nominal, and f, the strut's force
(tension positive) averaged over the load time, because screw and motor do not follow the strut's vibration:

    drives        where it has a pulse and |c - x| > dead band, towards c
    load          L = -direction f, the force against the motion
    speed         v = v0 r max(0, 1 - max(0, L) / (stall r)), at most v0 r (a load that helps does not hasten a screw)
    stalled       where it drives and v = 0, or stands at a stop
    slides        where |f| exceeds what it holds: h = back-drive force without a pulse; with one, the stall force at this supply if
                  that is more, because its controller pushes back; with f, at slide speed (|f| / h - 1), at most v0
    length        x + play/2 clip(f / play load, -1, 1): the load rests on one side of the play
    current       no-load + (stall - no-load) L / (stall r) while it drives, and as much for what it holds beyond the back-drive
                  force while it stands; u = open - resistance x sum, from the last step's sum
"""

import hashlib
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_core.errors import ParameterError
from sim_core.structure.arrays import Array
from sim_core.structure.parameter_file import ParameterFile, spec, specs_of
from sim_core.structure.parameters import Prototype

IDEAL, STAND_IN = "ideal", "stand-in"
"""Names of actuators: the solver's own, and those of the shipped file."""
PERIOD_S = 0.01
"""Robot time between looks at the struts' forces."""
SPEED_OF_FOLLOWING = 2.0
"""Speed of the solver's own actuators over the fastest of the model here, which they only follow, without jerks."""


@dataclass(frozen=True)
class ActuatorParameters:
    """One kind of actuator; units are in the names, meanings in data/actuators.yaml."""

    no_load_speed_m_s: float = spec("m/s", 1e-4, 1.0)
    stall_n: float = spec("N", 0.1, 1e5)
    back_drive_n: float = spec("N", 0.1, 1e5)
    back_drive_speed_m_s: float = spec("m/s", 0.0, 1.0)
    dead_band_m: float = spec("m", 0.0, 0.01)
    play_m: float = spec("m", 0.0, 0.01)
    play_load_n: float = spec("N", 0.01, 1e3)
    load_time_s: float = spec("s", 0.005, 10.0)
    stroke_m: float = spec("m", 1e-3, 2.0)
    no_load_current_a: float = spec("A", 0.0, 100.0)
    stall_current_a: float = spec("A", 0.0, 100.0)
    supply_nominal_v: float = spec("V", 1.0, 100.0)
    supply_open_v: float = spec("V", 1.0, 100.0)
    supply_resistance_ohm: float = spec("ohm", 0.0, 10.0)
    brown_out_v: float = spec("V", 0.0, 100.0)


SPECS = specs_of(ActuatorParameters)
FILE = ParameterFile("actuators", SPECS, f"; give {IDEAL}, {STAND_IN} or a YAML file")


if TYPE_CHECKING:
    Numbers = ActuatorParameters
else:
    Numbers = NamedTuple("Numbers", [(name, float) for name in SPECS])
    """The parameters as compiled code takes them."""


class Actuators(NamedTuple):
    """State of six actuators.

    Attributes:
        screw_m: length that each screw gives, (6,).
        load_n: averaged axial force of each strut, tension positive, (6,).
        supply_v: voltage of the common supply at the end of the last step.
        current_a: what each motor drew in the last step, (6,).
        stalled: which drive without moving, (6,).
        sliding: which give way to their load, (6,).
    """

    screw_m: Array
    load_n: Array
    supply_v: float
    current_a: Array
    stalled: NDArray[np.bool_]
    sliding: NDArray[np.bool_]


def at_rest(parameters: ActuatorParameters, lengths_m: Array, forces_n: Array) -> Actuators:
    """Six actuators that stand at these lengths (6,) under these axial forces (6,) and draw nothing."""
    nothing = np.zeros(6)
    none = np.zeros(6, dtype=bool)
    return Actuators(
        np.array(lengths_m, dtype=float), np.array(forces_n, dtype=float), parameters.supply_open_v, nothing, none, none
    )


def step(
    parameters: ActuatorParameters,
    before: Actuators,
    commanded_m: Array,
    forces_n: Array,
    mid_m: float | Array,
    dt_s: float,
    strength: float | Array = 1.0,
) -> Actuators:
    """The actuators after `dt_s`; changes nothing that it is given.

    Args:
        parameters: of all six actuators.
        before: the actuators now.
        commanded_m: lengths asked for, (6,); NaN: no pulse, so the motor is off.
        forces_n: axial forces of the struts, tension positive, (6,).
        mid_m: length at mid stroke, a number or (6,).
        dt_s: how long, in [s].
        strength: each actuator's own factor on speed, stall and back-drive force, a number or (6,).
    """
    keep = math.exp(-dt_s / parameters.load_time_s)
    load_n = forces_n + (before.load_n - forces_n) * keep
    ratio = before.supply_v / parameters.supply_nominal_v
    columns = before.screw_m.tolist(), np.asarray(commanded_m).tolist(), load_n.tolist(), _six(mid_m), _six(strength)
    ones = [one_after(parameters, ratio, dt_s, *row) for row in zip(*columns, strict=True)]
    screw_m, current_a, stalled, sliding = map(np.array, zip(*ones, strict=True))
    supply_v = max(0.0, parameters.supply_open_v - parameters.supply_resistance_ohm * float(current_a.sum()))
    return Actuators(screw_m, load_n, supply_v, current_a, stalled, sliding)


def _six(value: float | Array) -> list[float]:
    return value.tolist() if isinstance(value, np.ndarray) else [float(value)] * 6


def one_after(
    p: ActuatorParameters,
    ratio: float,
    dt_s: float,
    screw_m: float,
    commanded_m: float,
    force_n: float,
    mid_m: float,
    strength: float,
) -> tuple[float, float, bool, bool]:
    """One actuator after `dt_s`: length of its screw, current, whether it is stalled, whether it slides.

    On plain numbers: so it is fast here, and compiled it is the lanes' (`p` is then a `Numbers`).
    """
    powered = not math.isnan(commanded_m)
    fastest, stall, back_drive = p.no_load_speed_m_s * ratio * strength, p.stall_n * ratio * strength, p.back_drive_n * strength
    error = commanded_m - screw_m if powered else 0.0
    direction = 0.0 if abs(error) <= p.dead_band_m else math.copysign(1.0, error)
    against = max(-direction * force_n, 0.0) / max(stall, 1e-9)
    speed = fastest * max(0.0, 1.0 - against)

    holds = max(back_drive, stall) if powered else back_drive
    excess = max(abs(force_n) / holds - 1.0, 0.0)
    slide = math.copysign(min(p.back_drive_speed_m_s * excess, p.no_load_speed_m_s), force_n)
    low, high = mid_m - p.stroke_m, mid_m + p.stroke_m
    screw_m = min(max(screw_m + direction * min(speed * dt_s, abs(error)) + slide * dt_s, low), high)

    at_stop = direction != 0.0 and screw_m == (high if direction > 0.0 else low)
    held = max(abs(force_n) - back_drive, 0.0) / max(stall, 1e-9) if powered else 0.0
    effort = 1.0 if at_stop else min(against if direction else held, 1.0)
    works = direction != 0.0 or held > 0.0
    current_a = p.no_load_current_a + (p.stall_current_a - p.no_load_current_a) * effort if works else 0.0
    return screw_m, current_a, at_stop or (direction != 0.0 and speed == 0.0), excess > 0.0


def lengths_m(parameters: ActuatorParameters, actuators: Actuators) -> Array:
    """Lengths (6,) that the struts have: the screws', shifted within the play by the load."""
    side = np.minimum(np.maximum(actuators.load_n / parameters.play_load_n, -1.0), 1.0)
    return np.asarray(actuators.screw_m + 0.5 * parameters.play_m * side)


def following(prototype: Prototype, parameters: ActuatorParameters) -> Prototype:
    """The prototype with struts quick enough to follow these actuators, whose lengths they are given every `PERIOD_S`."""
    return replace(prototype, actuator_speed_m_s=SPEED_OF_FOLLOWING * parameters.no_load_speed_m_s)


def hash_of(parameters: ActuatorParameters) -> str:
    """Identifies actuators: sha256 over every number, 16 hex digits."""
    return hashlib.sha256(repr(parameters).encode()).hexdigest()[:16]


def load_actuators(path: Path | str | None = None) -> ActuatorParameters:
    """The actuators of a YAML file (default: the stand-in ones).

    Raises:
        ParameterError: naming file, parameter, what was got and what is valid.
    """
    parameters = ActuatorParameters(**{entry.name: entry.value for entry in FILE.load(path)})
    if parameters.stall_current_a < parameters.no_load_current_a:
        given = f"stall_current_a is {parameters.stall_current_a}"
        raise ParameterError(f"{path}: {given}; valid is no_load_current_a or more")
    return parameters


def require_actuators(which: str) -> ActuatorParameters | None:
    """The actuators that an option names: None for `ideal`, the stand-in ones for `stand-in`, else those of a YAML file.

    Raises:
        ParameterError: as `load_actuators`.
    """
    if which == IDEAL:
        return None
    return load_actuators(None if which == STAND_IN else which)
