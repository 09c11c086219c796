# SPDX-License-Identifier: Apache-2.0
"""The traveller: rolls to a place on the floor, one roll of the planner after another, each chosen from where the robot rests.

It asks the planner for every roll and never the bridge for a motion: what the planner refuses is not done.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import Point, PolygonStamped, Pose, PoseStamped, Quaternion
from nav_msgs.msg import Path as PathMessage
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Header

from sim_core.dynamics.model import build_model
from sim_core.errors import ParameterError
from sim_core.gaits.cycle import Chain
from sim_core.gaits.library import load_library
from sim_core.gaits.success_counts import load_success_counts
from sim_core.planning.floor_planner import REACH_M, Floor, Stance
from sim_core.planning.journey import Journey, JourneyEnd, Step, TravelRules
from sim_core.planning.keep_in import KeepIn
from sim_core.structure.arrays import Array
from sim_core.structure.parameters import load_prototype
from sim_core.twin.live_bridge import FRESH_S, LiveBridge, age_s, is_fresh
from tensegrity_interfaces.action import Roll, Travel
from tensegrity_interfaces.msg import BridgeState, FaceObservation, TwinState
from tensegrity_interfaces.srv import FaceGraph
from tensegrity_robot.planner.told_joints import ToldJoints
from tensegrity_robot.ros import topics
from tensegrity_robot.ros.conversions import frame_prefix
from tensegrity_robot.ros.node_help import About
from tensegrity_robot.ros.node_parameters import declare_parameters, parameter
from tensegrity_robot.ros.node_process import STEADY, EndProcess, run

TICK_S = 0.1
FOUND_LIMIT_S = 10.0
"""Longest wait (wall clock) for planner, twin and bridge, which may just have started."""
ANSWER_LIMIT_S = 5.0
CHAIN_MARGIN_S = 4.0
"""Running time that a chain has to have left beside that of two rolls and the way back, as the planner judges it."""
REST_LIMIT_S = 1_300.0
"""Robot time after which the bridge's duty window is past, twice."""
CALM_LIMIT_S = 90.0
"""Robot time within which the robot is seen at rest on a face."""
NEWS_S = 0.5
"""Wall time after a roll within which joints of before it are told no more."""


@dataclass(frozen=True)
class TravellerParameters:
    """Parameters of the traveller; the descriptions are what `ros2 param describe` shows."""

    library: str = parameter("robust", "gait library, the planner's: a shipped name, or the path of a YAML file")
    odds_file: str = parameter("", "YAML of the gaits' odds, the planner's; empty: the library's shipped ones")
    prototype_file: str = parameter("", "YAML of the robot's numbers; empty: the nominal prototype")
    frame: str = parameter("odom", "frame of goals and places; below a namespace its name gets that prefix: robot1/odom")
    reach_m: float = parameter(
        REACH_M, "distance from a goal that counts as there, unless the goal says otherwise [m]", low=0.02, high=1.0
    )
    most_rolls: int = parameter(60, "rolls after which a travel is given up, unless its goal says otherwise", low=1, high=10_000)
    longest_chain: int = parameter(
        24, "most rolls in a row without a stop, not more than the planner's; 0: it stops after every roll", low=0, high=200
    )
    use_odds: bool = parameter(True, "prefer reliable gaits and learn from misses; false: all gaits are alike, for comparison")


class _Ended(Exception):
    """The travel cannot go on; for people."""


@dataclass(eq=False)
class _Travel:
    """One that is under way."""

    handle: ServerGoalHandle
    journey: Journey
    phase: str = "looking where the robot is"
    step: Step | None = None
    roll: Any = None
    robot_s: float = 0.0
    chain: Roll.Feedback | None = None


class TravellerNode(Node):
    """See the module. Everything runs in one executor thread; planning a way takes it for a second at most."""

    def __init__(self, _end: EndProcess):
        super().__init__("traveller")
        self._settings = p = declare_parameters(self, TravellerParameters)
        self._library = load_library(p.library)
        self._counts = load_success_counts(self._library, Path(p.odds_file) if p.odds_file else None)
        prototype = load_prototype(p.prototype_file or None)
        self._speed_m_s = prototype.actuator_speed_m_s
        self._floor = Floor(build_model(prototype))
        self._bridge: BridgeState | None = None
        self._face: FaceObservation | None = None
        self._twin: TwinState | None = None
        self._area: KeepIn | None = None
        self._area_told = self._felt_once = False
        self._travel: _Travel | None = None
        self._next: PoseStamped | None = None
        self._waiting: list[tuple[Callable[[], object], float, Future]] = []

        self._live = live = LiveBridge(self.get_logger().warning)
        keep = partial(partial, setattr, self)
        topics.BRIDGE_STATE.subscribe(self, self._on_bridge_state)
        topics.BRIDGE_FACE.subscribe(self, lambda event: live.takes(event, self._on_face))
        topics.TWIN_STATE.subscribe(self, keep("_twin"))
        self._told_joints = ToldJoints(self)
        topics.TWIN_JOINTS.subscribe(self, self._told_joints.predict)
        topics.OBSERVED_JOINTS.subscribe(self, self._told_joints.see)
        topics.FACE_ESTIMATE.subscribe(self, self._told_joints.feel)
        topics.KEEP_IN.subscribe(self, self._on_area)
        topics.GOAL_POSE.subscribe(self, self._on_goal_pose)
        self._path = topics.TRAVEL_PATH.publisher(self)
        self._goal = topics.TRAVEL_GOAL.publisher(self)
        self._rolls = ActionClient(self, Roll, "roll")
        self._graph = self.create_client(FaceGraph, "face_graph")
        self._own = ActionClient(self, Travel, "travel")
        self._server = ActionServer(
            self, Travel, "travel", self._execute, goal_callback=self._on_goal, cancel_callback=self._on_cancel
        )
        self.create_timer(TICK_S, self._tick, clock=STEADY)
        self.get_logger().info(
            f"library {self._library.name} ({self._library.hash}); goals on {self.resolve_topic_name('goal_pose')}"
        )

    # ---- process ----------------------------------------------------------------------------------------------------

    def halt(self) -> None:
        """A roll that is under way is cancelled, which holds the struts."""
        if self._travel is not None and self._travel.roll is not None:
            self._travel.roll.cancel_goal_async()

    def close(self) -> None:
        """Ends the action's server and clients."""
        self._server.destroy()
        self._rolls.destroy()
        self._own.destroy()

    # ---- what is known ----------------------------------------------------------------------------------------------

    def _on_bridge_state(self, message: BridgeState) -> None:
        if self._live.hears(message, self.get_clock().now().nanoseconds):
            self._bridge = message

    def _on_face(self, message: FaceObservation) -> None:
        self._face = message
        self._felt_once = self._felt_once or self._felt

    def _on_area(self, message: PolygonStamped) -> None:
        corners = np.array([(point.x, point.y) for point in message.polygon.points])
        try:
            self._area = KeepIn(corners) if len(corners) else None
        except ParameterError as error:
            self.get_logger().warning(f"keep_in ignored: {error}")
            return
        self._area_told = True

    @property
    def _watched(self) -> bool:
        """Something, not a person, tells the robot's face all the time."""
        return self._face is not None and self._face.source != FaceObservation.SOURCE_OPERATOR

    @property
    def _felt(self) -> bool:
        """The face is told by an inertial sensor, which does not see where the robot is."""
        return self._face is not None and self._face.source == FaceObservation.SOURCE_IMU

    def _standing(self) -> str:
        """The face it rests on, as far as it is known; empty: on none, or still moving."""
        if self._face is not None:
            return str(self._face.face) if self._face.settled else ""
        return str(self._twin.face) if self._twin is not None and self._twin.at_rest else ""

    def _joints(self, since: float) -> Array | None:
        """Where the joints are, seen or else predicted, told after `since` (time.monotonic)."""
        return self._told_joints.newest(self._watched, since)

    # ---- goals ------------------------------------------------------------------------------------------------------

    def _on_goal(self, request: Travel.Goal) -> GoalResponse:
        why = self._refusal(request.goal)
        if not why and self._travel is not None:
            why = "another travel is running: cancel it first, or publish the goal on goal_pose, which replaces it"
        if not why and not (math.isfinite(request.reach_m) and request.reach_m >= 0.0):
            why = f"reach_m is {request.reach_m!r}: valid is 0 (the node's) or a distance in m"
        if why:
            self.get_logger().warning(f"travel rejected: {why}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _refusal(self, goal: PoseStamped) -> str:
        """Why a goal cannot be one; empty: it can."""
        frame = frame_prefix(self) + self._settings.frame
        if goal.header.frame_id.lstrip("/") != frame:
            return f"the goal is in frame {goal.header.frame_id!r}: valid is {frame!r}"
        if not (math.isfinite(goal.pose.position.x) and math.isfinite(goal.pose.position.y)):
            return "the goal is no place: x and y must be numbers"
        if why := self._unguarded():
            return why
        place = np.array([(goal.pose.position.x, goal.pose.position.y)])
        if self._area is not None and self._area.outside_m(place) > 0.0:
            corners = ", ".join(f"{x:g} {y:g}" for x, y in self._area.corners_m)
            return f"the goal {place[0, 0]:g}, {place[0, 1]:g} m is outside of the keep-in area, {corners} (keep_in of the planner)"
        return ""

    def _unguarded(self) -> str:
        """Why a real robot that nobody needs to watch may not travel; empty: it may."""
        real = self._bridge is not None and self._bridge.port and not self._bridge.virtual_port
        if not (real and self._felt_once and self._area_told and self._area is None):
            return ""
        return "nobody sees the robot, a sensor feels its face: set an area that it stays in first (keep_in of the planner)"

    def _staleness(self, goal: PoseStamped) -> str:
        """Why a goal of a topic was not meant for now; empty: it was. Recordings are played, and must move nothing."""
        now_ns, stamp = self.get_clock().now().nanoseconds, goal.header.stamp
        if is_fresh(stamp, now_ns):
            return ""
        found = f"it was stamped {age_s(stamp, now_ns):.1f} s ago" if stamp.sec or stamp.nanosec else "it has no stamp"
        return f"{found}, valid is {FRESH_S:g} s (in `ros2 topic pub`: header: auto)"

    def _on_goal_pose(self, goal: PoseStamped) -> None:
        """A click in a viewer: travels there, instead of where it travels now."""
        why = self._refusal(goal) or self._staleness(goal)
        if why:
            self.get_logger().warning(f"goal_pose ignored: {why}")
            return
        self._next = goal
        if self._travel is not None:
            self.get_logger().info("a new goal_pose: the travel under way is ended")
            self._call_off(self._travel)
        else:
            self._take_next()

    def _take_next(self) -> None:
        goal, self._next = self._next, None
        if goal is not None:
            self._own.send_goal_async(Travel.Goal(goal=goal))

    def _on_cancel(self, _goal: ServerGoalHandle) -> CancelResponse:
        if self._travel is None:
            return CancelResponse.REJECT
        self._call_off(self._travel)
        return CancelResponse.ACCEPT

    def _call_off(self, travel: _Travel) -> None:
        travel.phase = "cancelling"
        if travel.roll is not None:
            travel.roll.cancel_goal_async()

    # ---- a travel ---------------------------------------------------------------------------------------------------

    async def _execute(self, handle: ServerGoalHandle) -> Travel.Result:
        if self._travel is not None:  # two goals accepted in one turn of the executor
            handle.abort()
            return Travel.Result(reason="another travel is running")
        request, p = handle.request, self._settings
        rules = TravelRules(request.reach_m or p.reach_m, int(request.most_rolls) or p.most_rolls, p.use_odds)
        place = request.goal.pose.position
        journey = Journey(self._floor, self._library, self._counts, (place.x, place.y), rules)
        self._travel = travel = _Travel(handle, journey)
        self._goal.publish(request.goal)
        self.get_logger().info(f"travel to {place.x:.2f}, {place.y:.2f} m")
        try:
            end = await self._go(travel, bool(request.anyway))
        except _Ended as ended:
            end = JourneyEnd(False, str(ended))
        finally:
            self._travel = None
        self._show(request.goal, None)
        if handle.is_cancel_requested:
            handle.canceled()
        elif end.success:
            handle.succeed()
        else:
            handle.abort()
        self.get_logger().info(f"travel {'ended well' if end.success else 'failed'}: {end.reason}")
        self._take_next()
        return Travel.Result(
            success=end.success,
            reason=end.reason,
            rolls=journey.rolls,
            chained=journey.chained,
            missed=journey.missed,
            left_m=journey.left_m,
            path_m=journey.path_m,
            straight_m=journey.straight_m,
            duration_s=travel.robot_s,
            face_sequence=journey.faces,
        )

    async def _go(self, travel: _Travel, anyway: bool) -> JourneyEnd:
        await self._until(travel, lambda: self._bridge is not None and self._joints(0.0) is not None, FOUND_LIMIT_S, _ALONE)
        await self._same_library(travel)
        travel.journey.area = self._area
        if why := self._refusal(travel.handle.request.goal):
            raise _Ended(why)
        since = 0.0
        while True:
            stance = await self._stance(travel, since)
            found = travel.journey.look(stance, self._settings.longest_chain if self._watched else 0)
            if isinstance(found, JourneyEnd):
                return found
            if why := self._unguarded():
                raise _Ended(why)
            travel.step = found
            self._show(travel.handle.request.goal, found)
            await self._rested(travel, found)
            result = await self._roll(travel, found, anyway)
            since = time.monotonic() + (0.0 if self._watched and not self._felt else NEWS_S)
            if result.unlikely:
                travel.journey.refuse(found)
            elif not result.completed:
                raise _Ended(result.reason)
            else:
                travel.robot_s += result.duration_s
                # what ended early missed nothing
                done = int(result.rolls) if isinstance(found.gait, Chain) else int(result.success)
                travel.journey.rolled(found, done, not (result.success or result.ended_early))
            travel.step = travel.chain = None

    async def _stance(self, travel: _Travel, since: float) -> Stance:
        """Where it rests. Raises _Ended: on no face."""
        travel.phase = "looking where the robot is"
        settled = lambda: bool(self._standing()) and self._joints(since) is not None  # noqa: E731
        await self._until(
            travel,
            settled,
            FOUND_LIMIT_S + CALM_LIMIT_S / self._scale,
            "the robot stands on no face that is known: put it on one, and say so "
            f'(ros2 service call {self.resolve_service_name("set_face")} tensegrity_interfaces/srv/SetFace "{{face: TC6}}")',
        )
        joints = self._joints(since)
        assert joints is not None
        return self._floor.stance(self._standing(), joints)

    async def _rested(self, travel: _Travel, step: Step) -> None:
        """Until the actuators' duty permits the roll."""
        needs_s = step.gait.runs_s(self._speed_m_s) + CHAIN_MARGIN_S * isinstance(step.gait, Chain)
        if self._bridge is not None and self._bridge.duty_left_s < needs_s:
            travel.phase = f"resting: the actuators have run as long as their duty permits; {needs_s:.0f} s are needed"
            rested = lambda: self._bridge is not None and not self._bridge.duty_left_s < needs_s  # noqa: E731
            await self._until(travel, rested, REST_LIMIT_S / self._scale, "the actuators' duty does not permit the next roll")

    async def _roll(self, travel: _Travel, step: Step, anyway: bool) -> Roll.Result:
        """One roll of the planner's. Raises _Ended: it is not there, or does not take it."""
        gait = step.gait
        travel.phase = f"rolling to {gait.target}"
        if not self._rolls.server_is_ready():
            raise _Ended(_ALONE)
        goal = Roll.Goal(source_face=gait.source, anyway=anyway)
        if isinstance(gait, Chain):
            travel.phase = f"rolling on to {gait.target}"
            goal.faces, goal.primitive = list(gait.faces[1:]), gait.cycle.name
        else:
            goal.target_face, goal.primitive = gait.target, gait.primitive.name
        handle = await self._rolls.send_goal_async(goal, feedback_callback=partial(self._on_feedback, travel))
        if not handle.accepted:
            raise _Ended("the planner is busy with another roll: cancel that, then try again")
        travel.roll = handle
        if travel.handle.is_cancel_requested or self._next is not None:
            handle.cancel_goal_async()
        answer = await handle.get_result_async()
        travel.roll = None
        if answer.status == GoalStatus.STATUS_CANCELED:
            raise _Ended("replaced by a new goal_pose" if self._next is not None else "cancelled; the struts hold where they are")
        return answer.result

    def _on_feedback(self, travel: _Travel, message: Any) -> None:
        if travel.step is not None and isinstance(travel.step.gait, Chain):
            travel.chain = message.feedback

    async def _same_library(self, travel: _Travel) -> None:
        """Planner and traveller speak of the same gaits. Raises _Ended with both hashes."""
        travel.phase = "asking the planner for its library"
        await self._until(travel, self._graph.service_is_ready, FOUND_LIMIT_S, _ALONE)
        asked = self._graph.call_async(FaceGraph.Request(source_face="TC6"))
        await self._until(travel, asked.done, ANSWER_LIMIT_S, "the planner does not answer (service face_graph)")
        await self._until(travel, lambda: self._area_told, ANSWER_LIMIT_S, "the planner does not tell its area (topic keep_in)")
        theirs, ours = asked.result().library_hash, self._library.hash
        if theirs != ours:
            raise _Ended(f"the planner's library is {theirs}, the traveller's {ours}: start both with the same library")

    @property
    def _scale(self) -> float:
        return float(self._bridge.time_scale) if self._bridge is not None and self._bridge.time_scale > 0.0 else 1.0

    # ---- waiting and telling ----------------------------------------------------------------------------------------

    async def _until(self, travel: _Travel, condition: Callable[[], object], limit_s: float, why: str) -> None:
        """Until it holds. Raises _Ended: not within the limit (then `why`), or the travel was called off."""
        called_off = lambda: travel.handle.is_cancel_requested or self._next is not None  # noqa: E731
        done: Future = Future()
        self._waiting.append((lambda: condition() or called_off(), time.monotonic() + limit_s, done))
        met = await done
        if called_off():
            raise _Ended("replaced by a new goal_pose" if self._next is not None else "cancelled; nothing was moving")
        if not met:
            raise _Ended(why)

    def _tick(self) -> None:
        still = []
        for condition, end, done in self._waiting:
            met = bool(condition())
            if met or time.monotonic() > end:
                done.set_result(met)
            else:
                still.append((condition, end, done))
        self._waiting = still
        travel = self._travel
        if travel is not None:
            self._tell(travel)

    def _tell(self, travel: _Travel) -> None:
        joints, step = self._joints(0.0), travel.step
        center = joints.mean(axis=0) if joints is not None else np.full(3, math.nan)
        goal = travel.handle.request.goal.pose.position
        travel.handle.publish_feedback(
            Travel.Feedback(
                phase=travel.phase,
                face=self._standing(),
                x_m=float(center[0]),
                y_m=float(center[1]),
                left_m=math.hypot(goal.x - center[0], goal.y - center[1]),
                rolls=travel.journey.rolls + (travel.chain.rolls if travel.chain is not None else 0),
                rolls_left=len(step.way.choices) if step is not None else 0,
                odds=step.way.probability if step is not None else math.nan,
                target_face=_target(travel),
            )
        )

    def _show(self, goal: PoseStamped, step: Step | None) -> None:
        """The way on `travel/path`; none: an empty one."""
        header = Header(stamp=self.get_clock().now().to_msg(), frame_id=goal.header.frame_id)
        stances = step.way.stances if step is not None else ()
        poses = [PoseStamped(header=header, pose=_pose(stance)) for stance in stances]
        self._path.publish(PathMessage(header=header, poses=poses))


_ALONE = "planner, twin or bridge are not heard: start the stack (ros2 launch tensegrity_robot tensegrity.launch.py), then arm"


def _target(travel: _Travel) -> str:
    """The face that is to come."""
    if travel.step is None or travel.roll is None:
        return ""
    return str(travel.chain.next_face) if travel.chain is not None else travel.step.gait.target


def _pose(stance: Stance) -> Pose:
    half = 0.5 * stance.yaw_rad
    return Pose(position=Point(x=stance.x_m, y=stance.y_m), orientation=Quaternion(z=math.sin(half), w=math.cos(half)))


ABOUT = About(
    name="traveller",
    text="rolls to a place on the floor, one roll of the planner after another",
    settings=TravellerParameters,
    gives="travel/path travel/goal travel()",
    takes="bridge/state bridge/face keep_in twin/state twin/joints face_estimate bridge/observed_joints goal_pose roll() "
    "face_graph() travel()",
    example="-p reach_m:=0.1",
)


def main() -> int:
    """The executable `traveller`."""
    return run(TravellerNode, ABOUT)
