# SPDX-License-Identifier: Apache-2.0
"""Where to roll next on the way to a place on the floor, and when to give up. Knows no ROS and no clock."""

from collections import Counter
from itertools import product
from typing import NamedTuple

from sim_core.errors import SimError
from sim_core.gaits.climb_limits import load_climbs, usual_deg
from sim_core.gaits.cycle import SPEED, TURNS, Chain, Cycle, Switches, chain_of, turns_of
from sim_core.gaits.library import Gait, Library, Primitive
from sim_core.gaits.success_counts import SuccessCounts
from sim_core.planning.face_graph import Choice, FaceGraph
from sim_core.planning.floor_planner import ON_COST, START_COST, Floor, Stance, Stride, Strides, Way, chain_shifts
from sim_core.planning.keep_in import KeepIn
from sim_core.planning.travel_learning import MOST_SURE, Experience
from sim_core.structure.roll_classes import class_of
from sim_core.structure.symmetry import CARRIERS
from sim_core.structure.topology import FACES, NEIGHBOURS

MOST_MISSES = 10
"""So many rolls in a row that end elsewhere are enough."""
MOST_CHAINS_MISSED = 3
"""After so many chains in a row that missed, a travel goes on by plain rolls."""
STRAYS_M, LAST_CHAIN_M = 0.6, 0.2
"""Robots differ by some per cent in how far their chains go: from as far or farther one leads so near, and the next one there."""
NEAR_TRIES = 2
"""From near the goal it tries so often to hit it by chains, then three times so by plain rolls: each alone may go in circles."""
LEAST_PROBABILITY, PATIENCE = 0.01, 3
"""A roll that is believed less than this is not worth the actuators' wear, after so many in a row that ended elsewhere."""
EVERY_GAIT_ALIKE, A_TRIFLE = 0.9, 1e-6
"""Probability of every gait where all are alike, for comparison; and by how much less for each trial of its primitive."""


class TravelRules(NamedTuple):
    """When a travel ends.

    Attributes:
        reach_m: distance from the goal that counts as there.
        most_rolls: after which it is given up.
        use_probabilities: gaits differ in reliability, and what misses is believed less; False: all are alike, for comparison.
    """

    reach_m: float
    most_rolls: int
    use_probabilities: bool = True


class Step(NamedTuple):
    """The next roll by a gait, or the next chain of rolls; and the way that begins with it."""

    gait: Gait | Chain
    way: Way


class JourneyEnd(NamedTuple):
    """The travel is over; `reason`: for people."""

    success: bool
    reason: str


class _Alike:
    """Every gait is as likely as any other; of a roll's gaits the one whose primitive was tried least comes first."""

    def __init__(self, tried: Counter[str]):
        self._tried = tried

    def probability(self, gait: Gait) -> float:
        return EVERY_GAIT_ALIKE * (1.0 - A_TRIFLE * self._tried[gait.primitive.name])


class Journey:
    """One travel.

    Attributes:
        area: that it may not leave; None: it may go anywhere.
        rolls: made.
        chained: of these, how many in chains.
        missed: of these, how many ended elsewhere.
        refused: steps that the planner found too unlikely.
        faces: come onto, the first one first.
        path_m: from rest to rest; of a chain from face to face, as planned.
        straight_m: from the goal at the beginning.
    """

    def __init__(
        self,
        floor: Floor,
        library: Library,
        counts: SuccessCounts | None,
        goal_m: tuple[float, float],
        rules: TravelRules,
        area: KeepIn | None = None,
    ):
        """Args: counts: of the library's gaits; None: none are known. area: see Journey."""
        self.area = area
        self._cycle = library.cycles[0] if library.cycles else None
        self._strides = _strides(self._cycle) if self._cycle is not None else {}
        self._floor, self._library, self._goal_m, self._rules = floor, library, goal_m, rules
        known, climbs = FaceGraph(library, counts), load_climbs(library)

        def before(gait: Gait) -> float:
            if _is_of_cycle(gait):
                return gait.primitive.margins["success"]
            return known.probability(gait) * (1.0 if climbs is None else climbs.on_level(gait))

        def climbs_deg(gait: Gait) -> float:
            return usual_deg(gait) if climbs is None or _is_of_cycle(gait) else climbs.of(gait)

        self._climbs_deg = climbs_deg
        self._experience = Experience(before, climbs_deg)
        self._tried: Counter[str] = Counter()
        self._graph = self._believed()
        self._vain = self._chains_missed = self._near = 0
        self._stance: Stance | None = None
        self.rolls = self.chained = self.missed = self.refused = 0
        self.faces: list[str] = []
        self._passed: tuple[Stance, ...] = ()
        self.path_m = 0.0
        self.straight_m = 0.0

    @property
    def left_m(self) -> float:
        """Distance from the goal, where the robot was seen last."""
        return self._stance.distance_m(self._goal_m) if self._stance is not None else 0.0

    def look(self, stance: Stance, longest: int = 0) -> Step | JourneyEnd:
        """What to do from where the robot rests now. `longest`: most rolls of a chain, where one is possible."""
        self._come_to(stance)
        if end := self._end():
            return end
        self._near += self.left_m < LAST_CHAIN_M
        if self._vain or self._chains_missed >= MOST_CHAINS_MISSED or self._near % (4 * NEAR_TRIES) > NEAR_TRIES:
            longest = 0  # after a miss a plain roll tells whether it was the cycle or the ground
        longest = min(longest, self._rules.most_rolls - self.rolls - self.refused) // 2 * 2
        strides = self._believed_strides() if longest else {}
        outside_m = self.area.outside_m if self.area is not None else None
        lean, reach_m = self._experience.lean, self._rules.reach_m
        if strides and self.left_m >= STRAYS_M:
            reach_m = max(reach_m, LAST_CHAIN_M)
        left = f"{100 * self.left_m:.0f} cm from the goal"
        try:
            way = self._floor.way(stance, self._goal_m, self._graph, reach_m, lean, self._climbs_deg, strides, outside_m)
        except SimError as error:
            return JourneyEnd(False, f"gave up {left}: {error}")
        if not way.choices:
            return JourneyEnd(False, f"gave up {left}: no sequence of rolls comes nearer")
        if way.choices[0].probability < LEAST_PROBABILITY and self._vain >= PATIENCE:
            return JourneyEnd(False, f"gave up {left}: after {self._vain} vain tries no roll is left that is likely to work")
        if self._cycle is not None and way.on:
            faces = tuple(place.face for place in way.stances[: 1 + min(way.on, longest)])
            return Step(Chain(self._cycle, faces), way)
        return Step(way.choices[0].gait, way)

    def _end(self) -> JourneyEnd | None:
        left = f"{100 * self.left_m:.0f} cm from the goal"
        if self.left_m <= self._rules.reach_m:
            return JourneyEnd(True, f"rests on {self.faces[-1]}, {left}")
        if self.rolls + self.refused >= self._rules.most_rolls:
            return JourneyEnd(False, f"gave up after {self.rolls} rolls, {left}: the most that was asked for (most_rolls)")
        if self._vain >= MOST_MISSES:
            return JourneyEnd(
                False, f"gave up {left}: the last {self._vain} rolls missed their face or were refused as too unlikely"
            )
        return None

    def _come_to(self, stance: Stance) -> None:
        for place in (*self._passed, stance):
            if self._stance is None:
                self.straight_m = place.distance_m(self._goal_m)
            else:
                self.path_m += place.distance_m((self._stance.x_m, self._stance.y_m))
            self._stance = place
            if not self.faces or self.faces[-1] != place.face:
                self.faces.append(place.face)
        self._passed = ()

    def rolled(self, step: Step, done: int, missed: bool) -> None:
        """So many rolls of the step came onto their face; then one `missed`, or the step was over. None at all: as `refuse`."""
        if not done and not missed:
            self.refuse(step)
            return
        planned = len(step.gait.faces) - 1 if isinstance(step.gait, Chain) else 1
        done = min(done, planned - missed)
        self.rolls += done + missed
        self.missed += missed
        if isinstance(step.gait, Chain):
            self.chained += done + missed
            self._chains_missed = self._chains_missed + 1 if missed else 0
        self._passed = step.way.stances[1 : max(1, done + missed)]
        for number in range(done + missed):
            self._learn(step, number < done, number)

    def refuse(self, step: Step) -> None:
        """The planner did not make it, such as too unlikely on its ensemble."""
        self.refused += 1
        self._learn(step, False)

    def _learn(self, step: Step, success: bool, number: int = 0) -> None:
        gait = step.way.choices[number].gait
        self._tried[gait.primitive.name] += 1
        if self._rules.use_probabilities:
            before, there = step.way.stances[number : number + 2]
            self._experience.add(gait, before.heading_rad(there), success)
        self._vain = 0 if success else self._vain + 1
        self._graph = self._believed()

    def _believed(self) -> FaceGraph:
        return FaceGraph(self._library, self._believes())

    def _believes(self) -> Experience | _Alike:
        return self._experience if self._rules.use_probabilities else _Alike(self._tried)

    def _believed_strides(self) -> Strides:
        believes = self._believes()
        return {
            key: stride._replace(rolls=tuple(Choice(choice.gait, believes.probability(choice.gait)) for choice in stride.rolls))
            for key, stride in self._strides.items()
        }


CYCLE = "cycle "
"""Before the name of one that stands among the primitives."""


def _is_of_cycle(gait: Gait) -> bool:
    return gait.primitive.name.startswith(CYCLE)


def _strides(cycle: Cycle) -> dict[tuple[str, str, str], Stride]:
    """The two rolls from a TC over a TO to the next TC as gaits: from rest, and after the TO before it."""
    counted = cycle.turns or dict.fromkeys(TURNS, Switches(0, 0, 0, 0))
    # of what nobody counted no more is expected than of the surest gait
    success = {turn: 1.0 - counts.miss if counts.rolls else MOST_SURE for turn, counts in counted.items()}
    success[""] = max(success.values())  # from rest it has not turned yet
    speed = {turn: cycle.margins.get(SPEED + turn, 1.0) for turn in counted}
    fastest = max(speed.values())
    costs = {"": ON_COST + START_COST} | {turn: ON_COST * fastest / speed[turn] for turn in speed}
    found = {}
    for tc in (face for face in FACES if face.startswith("TC")):
        for before, to in product(("", *NEIGHBOURS[tc]), NEIGHBOURS[tc]):
            faces = tc, to, _across(to, tc)
            turn = turns_of((_across(before, tc), before, *faces))[0] if before not in ("", to) else ""
            if before == to or turn not in success:
                continue
            one, other = (
                Gait(
                    Primitive(CYCLE + cycle.name, class_of(source), roll.policy, {"success": success[turn]}),
                    source,
                    roll.onto,
                    roll.policy,
                    CARRIERS[tc, to].proper,
                )
                for source, roll in zip(faces, chain_of(cycle, faces), strict=False)
            )
            rolls = tuple(Choice(gait, success[turn]) for gait in (one, other))
            shifts = chain_shifts(cycle, faces)
            found[before, tc, to] = Stride(rolls, costs[turn], shifts if before == "" else (shifts[1], shifts[1]))
    return found


def _across(to: str, tc: str) -> str:
    """The other TC beside a TO."""
    return next(face for face in NEIGHBOURS[to] if face != tc)
