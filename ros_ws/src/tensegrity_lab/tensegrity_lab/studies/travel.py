# SPDX-License-Identifier: Apache-2.0
"""One travel of a virtual prototype through the whole stack: real processes, real bytes."""

import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import Any

from hardware_bridge.prototype_client.observation import Observation
from hardware_bridge.prototype_client.observer_client import ObserverClient
from sim_core.structure.parameters import load_prototype
from sim_core.structure.policy import neutral_lengths
from tensegrity_lab.errors import StackError
from tensegrity_lab.stack.processes import Stack
from tensegrity_lab.stack.simulation_lag import LateOrders
from tensegrity_lab.stack.virtual_stack import VirtualRobot, recorded_bag, running
from tensegrity_lab.terminal.leaving import uninterrupted

ROLL_LIMIT_S, REST_LIMIT_S = 60.0, 1_300.0
"""Robot time that a roll may take, and all resting."""
POINTS = 200
"""Of a path that is kept."""


@dataclass(frozen=True)
class Trip:
    """A travel that is over; see the action Travel.

    Attributes:
        goal_m: place.
        library: name.
        use_odds: reliable gaits were preferred.
        late_s: how late the virtual prototype took its orders at worst (s of robot time).
        time_scale: robot seconds per second.
        path_m: how far its centre went from rest to rest.
        places_m: where that was seen, (n, 2).
        seed, incline_deg, perturbation: of the robot.
        bag: file.
        chained: rolls of chains.
        stands: faces that it was seen at rest on, each with (x, y) of its centre in [m].
        seen_left_m: from the goal to where it was seen at the end; `left_m` is what the traveller knew.
    """

    goal_m: tuple[float, float]
    library: str
    use_odds: bool
    seed: int
    incline_deg: float
    perturbation: float
    success: bool
    reason: str
    rolls: int
    missed: int
    left_m: float
    path_m: float
    straight_m: float
    robot_s: float
    faces: tuple[str, ...]
    late_s: float
    time_scale: float
    places_m: tuple[tuple[float, float], ...]
    bag: str
    stands: tuple[tuple[str, float, float], ...] = ()
    chained: int = 0
    seen_left_m: float = math.nan

    @property
    def ratio(self) -> float:
        """Length of the path over the distance that was won; 1 is straight."""
        won = self.straight_m - self.left_m
        return self.path_m / won if won > 0.0 else float("inf")

    @property
    def speed_m_min(self) -> float:
        """Distance that was won a minute of rolling, in [m/min]."""
        return 60.0 * (self.straight_m - self.left_m) / self.robot_s if self.robot_s > 0.0 else 0.0


def travel(
    robot: VirtualRobot,
    goal_m: tuple[float, float],
    tell: Callable[[str], None],
    reach_m: float = 0.0,
    most_rolls: int = 0,
    use_odds: bool = True,
    domain: int | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> Trip:
    """Start a stack, arm, travel, end it all.

    Args:
        robot: the virtual robot and its stack.
        goal_m: (x, y) on the floor, in [m].
        tell: told what goes on.
        reach_m: how near is there, in [m]; 0: the traveller's own.
        most_rolls: rolls after which it gives up; 0: the traveller's own.
        use_odds: plan by the library's probabilities; else all gaits count alike.
        domain: of ROS; None: any that is free.
        say: told a line for people that is to stay.

    Raises:
        StackError: the stack does not come up, or a process of it dies.
        KeyboardInterrupt: with the struts held and the bag closed.
    """
    late = LateOrders()
    witness = _Witness(late)
    tell("starting virtual prototype, bridge, planner, traveller and twin")
    with (
        running(robot, "travel", say, domain, {"use_odds": use_odds}) as (stack, handshake),
        closing(ObserverClient(handshake.observer, witness.saw)),
    ):
        result = _operate(stack, handshake.instance, robot, late, goal_m, reach_m, most_rolls, tell)
    recorded = recorded_bag(stack)
    if recorded is None:
        raise StackError(f"the bridge recorded nothing; its log is in {robot.bags / 'logs'}")
    bag = str(recorded)
    known = goal_m, robot.library, use_odds, robot.seed, robot.incline_deg, robot.perturbation
    end = bool(result.success), str(result.reason), int(result.rolls), int(result.missed)
    ways = float(result.left_m), float(result.path_m), float(result.straight_m), float(result.duration_s)
    places_m = tuple(witness.places_m[:: max(1, len(witness.places_m) // POINTS)])
    faces, seen = tuple(result.face_sequence), (tuple(witness.stands), int(result.chained), witness.left_m(goal_m))
    return Trip(*known, *end, *ways, faces, late.worst_s, robot.time_scale, places_m, bag, *seen)


def _operate(
    stack: Stack,
    prototype: str,
    robot: VirtualRobot,
    late: LateOrders,
    goal_m: tuple[float, float],
    reach_m: float,
    most_rolls: int,
    tell: Callable[[str], None],
) -> Any:
    """The action's result."""
    from tensegrity_lab.stack.client import StackClient  # rclpy: only once the processes are on their way

    operator = StackClient(stack, prototype)
    try:
        operator.wait_for_stack()
        tell("arming: the struts are energised one by one, then go to mid stroke")
        operator.arm(neutral_lengths(load_prototype()).tolist())

        def show(feedback: Any) -> None:
            where = f"on {feedback.face or 'no face'} at {feedback.x_m:+.2f}, {feedback.y_m:+.2f} m"
            tell(f"roll {feedback.rolls + 1}: {feedback.phase}; {where}, {100 * feedback.left_m:.0f} cm from the goal")

        limit_s = 120.0 + ((most_rolls or 60) * ROLL_LIMIT_S + REST_LIMIT_S) / robot.time_scale
        late.forget()  # while the stack starts, a computer is always busy
        result = operator.travel(goal_m, reach_m, most_rolls, show, limit_s)
        operator.disarm()
        return result
    finally:
        with uninterrupted():
            operator.close()


class _Witness:
    """What the virtual prototype's observer sees, whether anybody in the stack hears of it or not. Comes in another thread."""

    def __init__(self, late: LateOrders):
        self._late = late
        self.places_m: list[tuple[float, float]] = []
        self.stands: list[tuple[str, float, float]] = []

    def saw(self, observation: Observation) -> None:
        self._late.saw(observation)
        x, y = (round(float(value), 4) for value in observation.joints_m.mean(axis=0)[:2])
        self.places_m.append((x, y))
        if observation.settled and observation.face and (not self.stands or observation.face != self.stands[-1][0]):
            self.stands.append((observation.face, x, y))

    def left_m(self, goal_m: tuple[float, float]) -> float:
        """From a goal to where it was seen last."""
        return math.dist(goal_m, self.places_m[-1]) if self.places_m else math.nan
