# SPDX-License-Identifier: Apache-2.0
"""A roll and its judgement: actuate, wait until at rest, return to neutral, wait until at rest."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from sim_core.dynamics.actuators import ActuatorParameters, Numbers, load_actuators
from sim_core.dynamics.footing import FACE_NAMES, Footing, footing_of
from sim_core.dynamics.model import Model
from sim_core.dynamics.robot import Robot
from sim_core.rolling import quasi_static as q
from sim_core.rolling import roll_monitor as w
from sim_core.rolling.roll_monitor import SAMPLE_S
from sim_core.structure.arrays import Array
from sim_core.structure.elements import PREVIOUS
from sim_core.structure.policy import MOST_STAGES, Policy, checked_policy, in_stages, lengths_of, neutral_lengths
from sim_core.structure.rotations import down_of
from sim_core.structure.topology import FACES, NEIGHBOURS, TENDON_LENGTH, require_adjacent, require_face


@dataclass(frozen=True)
class RollResult:
    """What a roll did.

    Attributes:
        source, target: faces asked for.
        policy: strokes in mm.
        feasible: judged as in docs/model.md "What a roll is".
        reason: why not, in one line; empty if feasible.
        faces: every face stood on, in order, from the first.
        actuated, returned: footing at rest after actuation and after the return (returned: None if not reached).
        peak_force_n: largest strut force along the path.
        clearance_m: smallest gap between surfaces along the path.
        margin_m: smaller of the two margins of the centre of mass inside the base triangle at rest.
        past_edge_m: for each adjacent face, how far the centre of mass got past the edge towards it before the robot stood on
            another face; negative: so far it stayed inside.
        duration_s: simulated time; of a quasi-static roll, the actuators' own.
        travel_m: (x, y) displacement of the centre of mass.
    """

    source: str
    target: str
    policy: Policy
    feasible: bool
    reason: str
    faces: tuple[str, ...]
    actuated: Footing
    returned: Footing | None
    peak_force_n: float
    clearance_m: float
    margin_m: float
    past_edge_m: Mapping[str, float]
    duration_s: float
    travel_m: tuple[float, float]

    @property
    def ended(self) -> str:
        """The face at the end; empty: none."""
        return (self.returned or self.actuated).face or ""


@dataclass(frozen=True)
class Sample:
    """One moment of a recorded roll: time (s), joints (12, 3) m, box (3,) m, rest lengths (6,) m, strut forces (6,) N, face."""

    time_s: float
    joints_m: Array
    box_m: Array
    lengths_m: Array
    forces_n: Array
    face: str | None


def sample(robot: Robot) -> Sample:
    """The robot now."""
    return Sample(
        robot.step * robot.model.dt_s,
        robot.joints_m(),
        robot.box_m(),
        robot.rest_lengths_m(),
        robot.strut_forces_n(),
        robot.footing().face,
    )


def roll(
    model: Model,
    source: str,
    target: str | None,
    policy: Sequence[float],
    *,
    start: Robot | None = None,
    trace: list[Sample] | None = None,
) -> RollResult:
    """Roll from `source` with a policy and judge whether it lands, and stays, on `target`.

    Args:
        model: the robot's model.
        source: the face it stands on.
        target: the wanted face, a neighbour of it; None: whatever it lands on.
        policy: six strokes, whole mm, or six for each of two stages, for this very pair (not for the reference pair).
        start: a robot resting on `source` at neutral lengths (changed in place); default: settled afresh.
        trace: filled with samples every 10 ms if given.

    Raises:
        UnknownFaceError, NotAdjacentError, PolicyError, DivergedError.
    """
    if target is None:
        require_face(source)
    else:
        require_adjacent(source, target)
    checked = checked_policy(policy, model.prototype.policy_limit_mm, 1 if model.kind == PREVIOUS else MOST_STAGES)
    robot = start if start is not None else Robot.resting_on(model, source)
    (state, work), struts, static = robot.arrays(), model.layout.struts, model.kind == PREVIOUS
    rules, chunk, tolerance = rules_of(model), samples_of(model, SAMPLE_S), tolerance_of(model)
    record, track = np.zeros(w.RECORD), np.zeros(q.TRACK_ROWS)
    stages = stages_of(model, checked, target)
    drive = drive_of(model)
    w.begin(state, work, record, rules, drive, struts, face_number(source), stages)
    if static:
        q.step_lengths(state, struts)
    while record[w.PHASE] == w.GOING:
        if static:
            q.relax(state, model.par, work, track, model.assembly, model.dt_s, model.reach_m, q.LOOK_STEPS)
            robot.step += q.LOOK_STEPS
            q.look(state, work, track, record, rules, struts, stages, tolerance)
        else:
            robot.advance(chunk)
            w.look(state, work, record, rules, drive, struts, stages)
        if trace is not None:
            trace.append(sample(robot))
    return result_of(model, source, target, checked, record, robot.peak_forces_n(), robot.center_of_mass_m())


def stages_of(model: Model, policy: Policy, target: str | None) -> Array:
    """The stages (n, STAGE_ROWS) of a roll: actuate until at rest, and return to neutral until at rest.

    Of a policy in stages the first lasts as long as the actuators need to get there at their speed, whatever is stood on meanwhile.
    """
    rule, parts = model.prototype, in_stages(policy)
    stages = np.zeros((len(parts) + 1, w.STAGE_ROWS))
    stages[:, w.ONTO] = -1 if target is None else face_number(target)
    for row, part in zip(stages, parts, strict=False):
        row[: w.ONTO] = model.rest_lengths(lengths_of(rule, part))
    stages[-1, : w.ONTO] = model.rest_lengths(neutral_lengths(rule))
    for row, part in zip(stages, parts[:-1], strict=False):
        row[w.ONTO], row[w.ENDS], row[w.SEEN] = -1, w.ON_TIME, -1
        row[w.LEAST] = math.ceil(1e-3 * max(map(abs, part)) / rule.actuator_speed_m_s / SAMPLE_S - 1e-9)
    return stages


def drive_of(model: Model, actuators: ActuatorParameters | None = None, strength: Array | None = None) -> w.Drive:
    """How this robot's struts are driven; `strength` (6,): each actuator's own factor on speed, stall and back-drive force."""
    parameters, e = actuators or load_actuators(), model.elements  # where nothing feels its load, stand-ins that nobody reads
    numbers = Numbers(**asdict(parameters))
    keep, reach_m = math.exp(-SAMPLE_S / parameters.load_time_s), e.strut_gain * e.strut_speed_m_s * SAMPLE_S
    return w.Drive(actuators is not None, numbers, keep, reach_m, e.strut_mid_m, np.ones(6) if strength is None else strength)


def rules_of(model: Model) -> w.Rules:
    """What a watch of this model judges by."""
    p = model.prototype
    period = samples_of(model, SAMPLE_S) * model.dt_s
    return w.Rules(
        model.elements.mass_kg,
        p.carry_fraction * model.weight_n,
        down_of(model.elements.gravity_m_s2),
        p.rest_speed_m_s,
        math.ceil(p.rest_hold_s / period - 1e-9),
        math.ceil(p.rest_timeout_s / period - 1e-9),
        p.strut_diameter_m,
        p.box_radius_m,
        model.assembly.particles,
    )


def tolerance_of(model: Model) -> float:
    """Square of the largest net force (N²) at which a relaxation is over."""
    p = model.prototype
    ideal_m = TENDON_LENGTH * p.strut_length_m
    pretension = p.tendon_stiffness_n_m * ideal_m * (1.0 - 1.0 / p.tendon_stretch)
    return float((q.RESIDUAL * pretension) ** 2)


def samples_of(model: Model, seconds: float) -> int:
    """Steps that last `seconds`, at least one."""
    return max(1, round(seconds * model.steps_per_second))


def face_number(face: str) -> int:
    """Number of a face in `support.FACE_NAMES`."""
    return FACE_NAMES.index(face)


def result_of(
    model: Model,
    source: str,
    target: str | None,
    policy: Policy,
    record: Array,
    peak_forces_n: Array,
    center_of_mass_m: Array,
) -> RollResult:
    """Judge a finished record."""
    rule, phase = model.prototype, int(record[w.PHASE])
    actuated, returned = (_footing(record, place) for place in (w.ACTUATED, w.RETURNED))
    went_back = record[w.RESTS] > 1
    static = model.kind == PREVIOUS
    peak = float(record[w.REST_FORCE] if static else peak_forces_n.max())
    clearance = float(record[w.CLEARANCE])
    allowed = rule.force_fraction * rule.actuator_stall_n
    wanted = target or actuated.face or ""
    if phase == w.DIVERGED:
        reason = "the simulation diverged"
    elif phase == w.TIMED_OUT:
        limit = "its relaxation" if static else f"{rule.rest_timeout_s:g} s"
        reason = f"not settled within {limit} after {'the return' if went_back else 'actuation'}"
    elif actuated.face is None or actuated.face != wanted or wanted == source:
        reason = f"after actuation it {_stands(actuated)}"
    elif returned.face != wanted:
        reason = f"after the return it {_stands(returned)}"
    elif peak > allowed:
        reason = f"strut force reached {peak:.1f} N; allowed are {allowed:.1f} N"
    elif clearance < rule.clearance_margin_m:
        reason = f"clearance fell to {1e3 * clearance:.1f} mm; required are {1e3 * rule.clearance_margin_m:.1f} mm"
    else:
        reason = ""
    travel = center_of_mass_m - record[w.START : w.START + 3]
    margins = [footing.margin_m for footing in ((actuated, returned) if went_back else (actuated,))]
    faces = tuple(FACE_NAMES[int(n)] for n in record[w.FACE_LIST : w.FACE_LIST + int(record[w.FACES_SEEN])])
    return RollResult(
        source,
        wanted,
        policy,
        not reason,
        reason,
        faces,
        actuated,
        returned if went_back else None,
        peak,
        clearance,
        min(margins),
        _past_edges(source, record),
        _actuation_s(model, policy, went_back) if static else float(record[w.SAMPLES]) * samples_of(model, SAMPLE_S) * model.dt_s,
        (float(travel[0]), float(travel[1])),
    )


def _actuation_s(model: Model, policy: Policy, went_back: bool) -> float:
    """Time that the actuators need; all there is of time in a quasi-static roll."""
    return (1 + went_back) * 1e-3 * max(map(abs, policy)) / model.prototype.actuator_speed_m_s


def _past_edges(source: str, record: Array) -> dict[str, float]:
    """Per adjacent face: the two share two joints, which are an edge of the source."""
    corners = FACES[source]
    edges = {frozenset((corners[i], corners[(i + 1) % 3])): float(record[w.PAST_EDGES + i]) for i in range(3)}
    return {face: edges[frozenset(corners) & frozenset(FACES[face])] for face in NEIGHBOURS[source]}


def _footing(record: Array, place: int) -> Footing:
    return footing_of(int(record[place]), int(record[place + 1]), float(record[place + 2]))


def _stands(footing: Footing) -> str:
    return f"stood on {footing.face}" if footing.face else footing.detail
