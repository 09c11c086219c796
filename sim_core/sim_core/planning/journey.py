# SPDX-License-Identifier: Apache-2.0
"""Where to roll next on the way to a place on the floor, and when to give up. Knows no ROS and no clock."""

from collections import Counter
from typing import NamedTuple

from sim_core.errors import SimError
from sim_core.gaits.climb_limits import load_climbs, usual_deg
from sim_core.gaits.library import Gait, Library
from sim_core.gaits.success_counts import SuccessCounts
from sim_core.planning.face_graph import FaceGraph
from sim_core.planning.floor_planner import Floor, Stance, Way
from sim_core.planning.travel_learning import Experience

MOST_MISSES = 10
"""So many rolls in a row that end elsewhere are enough."""
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
    """The next roll: a gait, and the way that it is the first roll of."""

    gait: Gait
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
        rolls: made.
        missed: of these, how many ended elsewhere.
        refused: steps that the planner found too unlikely.
        faces: rested on, the first one first.
        path_m: from rest to rest.
        straight_m: from the goal at the beginning.
    """

    def __init__(
        self, floor: Floor, library: Library, counts: SuccessCounts | None, goal_m: tuple[float, float], rules: TravelRules
    ):
        self._floor, self._library, self._goal_m, self._rules = floor, library, goal_m, rules
        known, climbs = FaceGraph(library, counts), load_climbs(library)

        def before(gait: Gait) -> float:
            return known.probability(gait) * (1.0 if climbs is None else climbs.on_level(gait))

        self._climbs_deg = usual_deg if climbs is None else climbs.of
        self._experience = Experience(before, self._climbs_deg)
        self._tried: Counter[str] = Counter()
        self._graph = self._believed()
        self._vain = 0
        self._stance: Stance | None = None
        self.rolls = self.missed = self.refused = 0
        self.faces: list[str] = []
        self.path_m = 0.0
        self.straight_m = 0.0

    @property
    def left_m(self) -> float:
        """Distance from the goal, where the robot was seen last."""
        return self._stance.distance_m(self._goal_m) if self._stance is not None else 0.0

    def look(self, stance: Stance) -> Step | JourneyEnd:
        """What to do from where the robot rests now."""
        if self._stance is None:
            self.straight_m = stance.distance_m(self._goal_m)
        else:
            self.path_m += stance.distance_m((self._stance.x_m, self._stance.y_m))
        self._stance = stance
        if not self.faces or self.faces[-1] != stance.face:
            self.faces.append(stance.face)
        left = f"{100 * self.left_m:.0f} cm from the goal"
        if self.left_m <= self._rules.reach_m:
            return JourneyEnd(True, f"rests on {stance.face}, {left}")
        if self.rolls + self.refused >= self._rules.most_rolls:
            return JourneyEnd(False, f"gave up after {self.rolls} rolls, {left}: the most that was asked for (most_rolls)")
        if self._vain >= MOST_MISSES:
            return JourneyEnd(
                False, f"gave up {left}: the last {self._vain} rolls missed their face or were refused as too unlikely"
            )
        try:
            lean = self._experience.lean
            way = self._floor.way(stance, self._goal_m, self._graph, self._rules.reach_m, lean, self._climbs_deg)
        except SimError as error:
            return JourneyEnd(False, f"gave up {left}: {error}")
        if not way.choices:
            return JourneyEnd(False, f"gave up {left}: no sequence of rolls comes nearer")
        if way.choices[0].probability < LEAST_PROBABILITY and self._vain >= PATIENCE:
            return JourneyEnd(False, f"gave up {left}: after {self._vain} vain tries no roll is left that is likely to work")
        return Step(way.choices[0].gait, way)

    def rolled(self, step: Step, success: bool) -> None:
        """The roll was made; it ended on its target, or elsewhere."""
        self.rolls += 1
        self.missed += not success
        self._learn(step, success)

    def refuse(self, step: Step) -> None:
        """The planner did not make it: too unlikely on its ensemble."""
        self.refused += 1
        self._learn(step, False)

    def _learn(self, step: Step, success: bool) -> None:
        self._tried[step.gait.primitive.name] += 1
        if self._rules.use_probabilities:
            self._experience.add(step.gait, self._floor.heading_rad(step.way.stances[0], step.gait.target), success)
        self._vain = 0 if success else self._vain + 1
        self._graph = self._believed()

    def _believed(self) -> FaceGraph:
        return FaceGraph(self._library, self._experience if self._rules.use_probabilities else _Alike(self._tried))
