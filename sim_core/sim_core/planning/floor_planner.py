# SPDX-License-Identifier: Apache-2.0
"""Ways over the floor: where each roll takes the robot, and the likeliest sequence of rolls to a goal.

Standing at rest on a face, the robot turns over an edge of its base onto the neighbour. Were the two nodes of that edge to stay
where they are, a *stance* (face, heading, place) and an edge would give the next stance, from the shape at rest alone. By how
much a gait's roll goes farther, aside and turns more is a *shift*, the same for all 24 gaits of a primitive but for its hand.
"""

import cmath
import heapq
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import takewhile
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from sim_core.dynamics.model import Model
from sim_core.dynamics.robot import Robot
from sim_core.errors import LibraryError, SimError
from sim_core.gaits.climb_limits import usual_deg
from sim_core.gaits.cycle import STRETCH, TWIST, Cycle
from sim_core.gaits.library import Gait
from sim_core.planning.face_graph import Choice, FaceGraph
from sim_core.rolling.roll import roll
from sim_core.structure.arrays import Array
from sim_core.structure.policy import Policy
from sim_core.structure.roll_classes import TC_TO, TO_TC, RollClass
from sim_core.structure.symmetry import CARRIERS, GROUP
from sim_core.structure.topology import FACES, NEIGHBOURS, require_face

REACH_M = 0.08
"""Default distance from the goal that counts as there: a roll goes about so far, so no route can promise to come much nearer."""
ROLL_COST = 0.02
"""What a sure roll costs beside its improbability, as −log: of equally likely routes the shorter one."""
ON_COST = 0.006
"""Likewise of a roll of a chain, which needs about a third of the time."""
START_COST = 0.01
"""Of each of a chain's first two rolls, beside that: it begins and ends at rest, in neutral."""
BACK_COST = 10.0 * ROLL_COST
"""Of a roll straight back, beside that: to and fro it creeps by the difference of two shifts, which no two robots have alike."""
EDGE_M = 0.02
"""Chains are planned so far inside of the keep-in area: it is judged again from where the robot is found."""
CELL_M, CELL_RAD = 0.02, math.radians(15.0)
"""Stances nearer than this to each other are taken for one."""
MOST_STANCES, MOST_STRIDING = 30_000, 15_000
"""Of a search for a way; chains make it wider."""
TACKS = (1.0, 1.25, 1.5, 2.0, 3.0)
"""How much longer than straight a way uphill is thought of being."""
Lean = tuple[float, float]
"""Which way the ground leans, a vector that points downhill: a roll in the direction of the unit vector u, by a gait that climbs s
degrees, is likelier than on level ground by lean·u/s logits."""
LEVEL: Lean = (0.0, 0.0)


class Shift(NamedTuple):
    """By how much a roll ends elsewhere than a turn over the edge does.

    Attributes:
        stretch: how far it goes, over that.
        veer_rad: how much more to the left it goes.
        twist_rad: how much more to the left it turns the robot.
    """

    stretch: float = 1.0
    veer_rad: float = 0.0
    twist_rad: float = 0.0

    def mirrored(self) -> "Shift":
        """The same roll in a mirror."""
        return Shift(self.stretch, -self.veer_rad, -self.twist_rad)


def chain_shifts(cycle: Cycle, faces: Sequence[str]) -> tuple[Shift, ...]:
    """Where each roll of a chain over these faces ends, from rest on the first: by the cycle's margins STRETCH and TWIST."""
    hand = 1.0 if CARRIERS[faces[0], faces[1]].proper else -1.0
    on = Shift(cycle.margins.get(STRETCH, 1.0))
    first = on._replace(twist_rad=hand * math.radians(cycle.margins.get(TWIST, 0.0)))
    return first, *(on for _ in faces[2:])


class Stride(NamedTuple):
    """Two rolls of a chain.

    Attributes:
        rolls: the surest gait of each.
        cost: of each: `ON_COST`, by how long it takes.
        shifts: where each ends; empty: where its gait does from rest to rest.
    """

    rolls: tuple[Choice, ...]
    cost: float = ON_COST
    shifts: tuple[Shift, ...] = ()


NO_SHIFT = Shift()
PLAIN, PLAIN_BESIDE_CHAINS = Stride((), ROLL_COST), Stride((), 4.0 * ROLL_COST)
"""How a roll from rest to rest goes; where chains are possible its time counts, four times that of one of theirs."""
Strides = Mapping[tuple[str, str, str], Stride]
"""By (TO before the TC that it stands on, or "" at rest; this TC; the next TO)."""


class Stance(NamedTuple):
    """Where the robot stands.

    Attributes:
        face: it rests on.
        x_m, y_m: its nodes' centre on the floor.
        yaw_rad: turn about the vertical from the attitude of `Robot.resting_on(model, face)`.
    """

    face: str
    x_m: float
    y_m: float
    yaw_rad: float

    def distance_m(self, goal_m: tuple[float, float]) -> float:
        """Distance from a place on the floor."""
        return math.hypot(goal_m[0] - self.x_m, goal_m[1] - self.y_m)

    def heading_rad(self, other: "Stance") -> float:
        """Direction on the floor of the way to another stance."""
        return math.atan2(other.y_m - self.y_m, other.x_m - self.x_m)


class Way(NamedTuple):
    """Rolls to a goal.

    Attributes:
        stances: from the first to the last.
        choices: the most reliable gait of each roll.
        probability: that all of them work at first try, taken as independent.
        left_m: distance from the goal at the end.
        reaches: it is within what was asked for.
        on: so many of the first rolls are a chain.
    """

    stances: tuple[Stance, ...]
    choices: tuple[Choice, ...]
    probability: float
    left_m: float
    reaches: bool
    on: int = 0


class _Node(NamedTuple):
    """A stance that a way may come to; `on`: by a chain that may go on."""

    stance: Stance
    before: int
    choice: Choice | None
    on: bool = False


class Floor:
    """The nominal robot's footprints at rest on level ground."""

    def __init__(self, model: Model):
        """Settle the robot on a face of either kind; the others' footprints are theirs, relabelled."""
        self._model, self._shifts = model, dict[tuple[str, Policy], Shift]()
        settled = {face: _centred(Robot.resting_on(model, face).joints_m()) for face in (TC_TO.source, TO_TC.source)}
        self._joints: Mapping[str, Array] = {face: _relabelled(settled, model, face) for face in FACES}
        self._moves = {(source, target): self._move(source, target) for source, targets in NEIGHBOURS.items() for target in targets}
        self.longest_m = max(math.hypot(x, y) for x, y, _ in self._moves.values())

    def stance(self, face: str, joints_m: Array) -> Stance:
        """The stance of a robot that rests on a face with its joints there, (12, 3) or (12, 2): the best fit.

        Raises UnknownFaceError.
        """
        seen = np.asarray(joints_m, dtype=float)[:, :2]
        center = seen.mean(axis=0)
        return Stance(face, float(center[0]), float(center[1]), _turn(self._joints[require_face(face)], seen - center))

    def joints_m(self, stance: Stance) -> Array:
        """Where the twelve joints of a stance are above, (12, 2)."""
        return np.asarray(_turned(self._joints[stance.face], stance.yaw_rad) + np.array((stance.x_m, stance.y_m)))

    def rolled(self, stance: Stance, target: str, shift: Shift = NO_SHIFT) -> Stance:
        """The stance after a roll onto an adjacent face. Raises KeyError: it is not adjacent."""
        x, y, turn = self._moves[stance.face, target]
        angle = stance.yaw_rad + shift.veer_rad
        c, s = shift.stretch * math.cos(angle), shift.stretch * math.sin(angle)
        yaw = math.remainder(stance.yaw_rad + turn + shift.twist_rad, 2.0 * math.pi)
        return Stance(target, stance.x_m + c * x - s * y, stance.y_m + s * x + c * y, yaw)

    def shift(self, gait: Gait) -> Shift:
        """Where a gait's roll ends, from rest to rest: its primitive is rolled once on the nominal robot, which is kept."""
        roll_class, policy = gait.primitive.roll_class, gait.primitive.policy
        key = roll_class.source, policy
        if key not in self._shifts:
            self._shifts[key] = self._rolled_once(roll_class, policy)
        return self._shifts[key] if gait.proper else self._shifts[key].mirrored()

    def _rolled_once(self, roll_class: RollClass, policy: Policy) -> Shift:
        robot = Robot.resting_on(self._model, roll_class.source)
        start = self.stance(roll_class.source, robot.joints_m())
        try:
            if not roll(self._model, roll_class.source, roll_class.target, policy, start=robot).feasible:
                return NO_SHIFT
        except SimError:
            return NO_SHIFT
        turned, ended = self.rolled(start, roll_class.target), self.stance(roll_class.target, robot.joints_m())
        went, over = (complex(place.x_m - start.x_m, place.y_m - start.y_m) for place in (ended, turned))
        twist_rad = math.remainder(ended.yaw_rad - turned.yaw_rad, 2.0 * math.pi)
        return Shift(abs(went / over), cmath.phase(went / over), twist_rad)

    def _move(self, source: str, target: str) -> tuple[float, float, float]:
        """Shift of the centre and turn, seen from the source's attitude: the common edge stays."""
        edge = sorted(set(FACES[source]) & set(FACES[target]))
        a, b = self._joints[source][edge], self._joints[target][edge]
        turn = math.remainder(_heading(a) - _heading(b), 2.0 * math.pi)
        shift = a.mean(axis=0) - _turned(b, turn).mean(axis=0)
        return float(shift[0]), float(shift[1]), turn

    def way(
        self,
        start: Stance,
        goal_m: tuple[float, float],
        graph: FaceGraph,
        reach_m: float = REACH_M,
        lean: Lean = LEVEL,
        climbs_deg: Callable[[Gait], float] = usual_deg,
        strides: Strides = MappingProxyType({}),
        outside_m: Callable[[Array], float] | None = None,
        shifted: bool = True,
    ) -> Way:
        """The likeliest rolls to within `reach_m` of a goal (A* over stances, by −log of their probability and length).

        If none of MOST_STANCES looked at is that near, it looks once more without shifts, where stances come again and are fewer;
        and then the way to the nearest one. On ground that leans, a gait that climbs steeper (`climbs_deg`) is preferred uphill.
        `strides`: what a cycle rolls on by. `outside_m`: how far joints, (12, 2), are outside of where the robot may be: no roll
        leads there, or farther there. `shifted`: see `Shift`; False: rolls from rest to rest are turns over the edge.

        Raises:
            LibraryError: the library has no gait from there.
        """
        shift_of = self.shift if shifted else _unshifted
        best = {pair: _undominated(graph.choices(*pair), climbs_deg, lean) for pair in self._moves}
        plain = PLAIN_BESIDE_CHAINS if strides else PLAIN
        kinds = (
            (plain.cost, [one for ones in best.values() for one in ones]),
            (
                min((stride.cost for stride in strides.values()), default=ON_COST),
                [(choice, climbs_deg(choice.gait)) for stride in strides.values() for choice in stride.rolls],
            ),
        )
        on_m = max((shift.stretch for stride in strides.values() for shift in stride.shifts), default=0.0)
        plain_m = max((shift_of(choice.gait).stretch for ones in best.values() for choice, _ in ones), default=1.0)
        longest_m = self.longest_m * max(on_m, plain_m)
        surest = [(cost, max(choice.probability for choice, _ in ways), [deg for _, deg in ways]) for cost, ways in kinds if ways]

        def ahead(stance: Stance) -> float:
            left_m = stance.distance_m(goal_m)
            if left_m <= reach_m:
                return 0.0
            rolls = (left_m - reach_m) / longest_m
            x, y = (goal_m[0] - stance.x_m) / left_m, (goal_m[1] - stance.y_m) / left_m
            down, steepest = lean[0] * x + lean[1] * y, max if lean[0] * x + lean[1] * y < 0.0 else min
            return min((_least_cost(rolls, cost, sure, down / steepest(degs)) for cost, sure, degs in surest), default=0.0)

        nodes = [_Node(start, -1, None)]
        costs = {(_cell(start), ""): 0.0}
        queue = [(ahead(start), 0)]
        nearest, closed = 0, set[tuple[tuple[str, int, int, int], str]]()
        while queue and len(nodes) < (MOST_STRIDING if strides else MOST_STANCES):
            _, number = heapq.heappop(queue)
            stance = nodes[number].stance
            from_face = nodes[nodes[number].before].stance.face if number else ""
            before = from_face if nodes[number].on else ""
            cell = _cell(stance), before
            if cell in closed:
                continue
            closed.add(cell)
            if stance.distance_m(goal_m) < nodes[nearest].stance.distance_m(goal_m):
                nearest = number
            if stance.distance_m(goal_m) <= reach_m:
                return self._way(nodes, number, goal_m, reach_m)
            moves = [([best[stance.face, target]], plain) for target in NEIGHBOURS[stance.face]]
            ways_on = (strides.get((before, stance.face, target)) for target in NEIGHBOURS[stance.face])
            moves += [([[(choice, climbs_deg(choice.gait))] for choice in on.rolls], on) for on in ways_on if on is not None]
            for rolls, how in moves:
                cost, made = self._moved(stance, costs[cell], rolls, how, shift_of, lean, outside_m)
                if not made:
                    continue
                on = len(made) > 1
                cost += BACK_COST * (made[0][0].face == from_face)
                reached = _cell(made[-1][0]), made[0][0].face if on else ""
                if cost < costs.get(reached, math.inf):
                    costs[reached] = cost
                    nodes.append(_Node(made[0][0], number, made[0][1], on))
                    nodes.extend(_Node(there, len(nodes) - 1, choice, on) for there, choice in made[1:])
                    heapq.heappush(queue, (cost + ahead(made[-1][0]), len(nodes) - 1))
        if len(nodes) == 1:
            raise LibraryError(f"library {graph.library.name} has no gait from {start.face}")
        found = self._way(nodes, nearest, goal_m, reach_m)
        if not shifted:
            return found
        other = self.way(start, goal_m, graph, reach_m, lean, climbs_deg, strides, outside_m, shifted=False)
        return min(found, other, key=lambda way: way.left_m)

    def _moved(
        self,
        stance: Stance,
        cost: float,
        rolls: Sequence[Sequence[tuple[Choice, float]]],
        how: Stride,
        shift_of: Callable[[Gait], Shift],
        lean: Lean,
        outside_m: Callable[[Array], float] | None,
    ) -> tuple[float, list[tuple[Stance, Choice]]]:
        """What a roll, or the two of a stride, add to a cost, and where they lead by which of their choices; none: nowhere."""
        made: list[tuple[Stance, Choice]] = []
        on = len(rolls) > 1
        for choices in rolls:
            likely = [
                self._likely(stance, choice, deg, how.shifts[len(made)] if how.shifts else shift_of(choice.gait), lean)
                for choice, deg in choices
            ]
            here, there, choice = max(likely, key=lambda one: one[0], default=(0.0, stance, None))
            if here <= 0.0 or choice is None:
                return cost, []
            if outside_m is not None:
                out_m = outside_m(self.joints_m(there))
                if out_m > (-EDGE_M if on else 0.0) and (on or out_m >= outside_m(self.joints_m(stance))):
                    return cost, []
            cost, stance = cost + how.cost - math.log(here), there
            made.append((there, choice._replace(probability=here)))
        return cost, made

    def _likely(self, stance: Stance, choice: Choice, deg: float, shift: Shift, lean: Lean) -> tuple[float, Stance, Choice]:
        """Probability of a gait that climbs so steep, where the ground leans, and where it leads."""
        there = self.rolled(stance, choice.gait.target, shift)
        heading = stance.heading_rad(there)
        logits = (lean[0] * math.cos(heading) + lean[1] * math.sin(heading)) / deg
        return _leaned(choice.probability, logits), there, choice

    def _way(self, nodes: list[_Node], end: int, goal_m: tuple[float, float], reach_m: float) -> Way:
        way, number = list[_Node](), end
        while number >= 0:
            way.append(nodes[number])
            number = nodes[number].before
        way.reverse()
        choices = tuple(node.choice for node in way if node.choice is not None)
        left = nodes[end].stance.distance_m(goal_m)
        probability = math.prod(choice.probability for choice in reversed(choices))
        on = len(list(takewhile(lambda node: node.on, way[1:])))
        return Way(tuple(node.stance for node in way), choices, probability, left, left <= reach_m, on)


def _unshifted(_: Gait) -> Shift:
    return NO_SHIFT


def _undominated(choices: Sequence[Choice], climbs_deg: Callable[[Gait], float], lean: Lean) -> list[tuple[Choice, float]]:
    """Of gaits for one roll, the surest first: those that may be the best in some direction, with how steep they climb."""
    kept: list[tuple[Choice, float]] = []
    for choice in choices if lean != LEVEL else choices[:1]:
        deg = climbs_deg(choice.gait)
        if not kept or deg > kept[-1][1]:
            kept.append((choice, deg))
    return kept


def _centred(joints_m: Array) -> Array:
    return np.asarray(joints_m[:, :2] - joints_m[:, :2].mean(axis=0))


def _relabelled(settled: Mapping[str, Array], model: Model, face: str) -> Array:
    """The footprint on a face from that of its kind, in the attitude in which the robot is placed on it."""
    element, own = next((g, own) for g in GROUP for source, own in settled.items() if g.face(source) == face)
    joints = np.empty_like(own)
    joints[list(element.nodes)] = own if element.proper else own * (1.0, -1.0)
    return _turned(joints, _turn(joints, _centred(Robot.placed_on(model, face).joints_m())))


def _cell(stance: Stance) -> tuple[str, int, int, int]:
    turns = round(2.0 * math.pi / CELL_RAD)
    return stance.face, round(stance.x_m / CELL_M), round(stance.y_m / CELL_M), round(stance.yaw_rad / CELL_RAD) % turns


def _least_cost(rolls: float, roll_cost: float, surest: float, logits: float) -> float:
    """What so many rolls' length straight ahead cost at least, where a roll in that direction is worth `logits` more.

    Straight, if that is downhill; uphill also with more rolls that climb less each: costs are convex in the heading, so no zigzag
    is cheaper than all its rolls alike (Jensen), up to the coarseness of TACKS.
    """
    longer = TACKS if logits < 0.0 else TACKS[:1]
    return min(rolls * n * (roll_cost - math.log(max(_leaned(surest, logits / n), 1e-6))) for n in longer)


def _leaned(probability: float, logits: float) -> float:
    """A probability after so many logits are added to its own."""
    if logits == 0.0 or probability <= 0.0 or probability >= 1.0:
        return probability
    return probability / (probability + (1.0 - probability) * math.exp(-logits))


def _heading(edge: Array) -> float:
    return math.atan2(edge[1, 1] - edge[0, 1], edge[1, 0] - edge[0, 0])


def _turned(points: Array, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def _turn(points: Array, seen: Array) -> float:
    """The turn that fits points best onto seen ones, both about their centres (least squares)."""
    cross = points[:, 0] @ seen[:, 1] - points[:, 1] @ seen[:, 0]
    return math.atan2(float(cross), float((points * seen).sum()))
