# SPDX-License-Identifier: Apache-2.0
"""The gait planner: holds the bridge's lease and rolls the robot from face to face."""

import concurrent.futures
import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from hardware_bridge.errors import may_be_sent_again
from sim_core.errors import RollRefused, SimError
from sim_core.gaits.cycle import Chain
from sim_core.gaits.library import Gait, load_library, wanted_chain
from sim_core.gaits.roll_sequence import (
    Lengths,
    Link,
    Move,
    Phase,
    RollOutcome,
    RollPlan,
    RollRules,
    RollSequence,
    Seen,
    View,
    known_face,
)
from sim_core.gaits.strut_motion import Knot, constant_speed_knots
from sim_core.gaits.success_counts import load_success_counts
from sim_core.names import STRUT_NAMES
from sim_core.planning.face_graph import FaceGraph
from sim_core.rolling.warm_up import Stage, is_warm
from sim_core.structure.parameters import load_prototype
from sim_core.structure.policy import in_stages, lengths_of, neutral_lengths
from sim_core.structure.topology import require_adjacent
from sim_core.studies.rehearsal import DEFAULT_SEED
from sim_core.twin.live_bridge import LiveBridge
from sim_core.uncertainty.perturbation_law import MAX_INCLINE_DEG, MAX_SCALE, Law
from tensegrity_interfaces.action import ExecuteStruts, Roll
from tensegrity_interfaces.msg import BridgeState, FaceObservation, Rehearsal, StrutsSent, TwinState
from tensegrity_robot.planner.chain_area import ChainArea
from tensegrity_robot.planner.lease_client import CALL_TIMEOUT_S, Lease
from tensegrity_robot.planner.rehearsal_worker import Rehearser, Rehearsing, rehearsal_message
from tensegrity_robot.planner.services import serve_face_graph, serve_rehearse, wanted_gait
from tensegrity_robot.ros import qos, topics
from tensegrity_robot.ros.event_filters import EventTimes
from tensegrity_robot.ros.node_help import About
from tensegrity_robot.ros.node_parameters import declare_parameters, parameter
from tensegrity_robot.ros.node_process import STEADY, EndProcess, run

TICK_S = 0.1
MOST_SENDS = 5
"""How often one motion is sent. The bridge judges shapes that are new to it, which may take longer than a stamp is good for, and
remembers them: sent again, the same motion is accepted at once."""
MOST_BLIND = 6
"""Rolls of a chain that nobody sees: after so many its face is not known well enough to be predicted."""
DUTY_MARGIN_S = 2.0
"""Running time that is left over for the way back when a chain ends for want of it."""
_REMEDY = "let the struts rest, charge the supply"
SILENT_S = 3.0
"""A bridge that publishes no state for this long is gone; it does at 2 Hz."""
LONG_AGO = -1
"""Robot time of what was seen under an earlier bridge."""


@dataclass(frozen=True)
class PlannerParameters:
    """Parameters of the planner; the descriptions are what `ros2 param describe` shows."""

    library: str = parameter("robust", "gait library: a shipped name, or the path of a YAML file")
    odds_file: str = parameter(
        "", "YAML of how often each gait worked, from `sixstrut robustness --odds`; empty: the library's shipped ones"
    )
    prototype: str = parameter("", "arm only the bridge of this virtual prototype, see bridge/state; empty: any robot")
    prototype_file: str = parameter("", "YAML of the robot's numbers; empty: the nominal prototype")
    confirm: str = parameter(
        "observed", "what a roll's outcome needs: an observed face, or the twin's prediction", choices=("observed", "predicted")
    )
    settle_timeout_s: float = parameter(30.0, "longest wait for rest after a motion [s of robot time]", low=1.0, high=600.0)
    confirm_timeout_s: float = parameter(
        60.0, "longest wait for set_face where nobody observes all the time [s of robot time]", low=1.0, high=3600.0
    )
    rehearse_members: int = parameter(
        24, "perturbed twins on which every roll is tried before the robot does it; 0: no rehearsal", low=0, high=512
    )
    rehearse_scale: float = parameter(0.1, "how far these twins are off, 0.1 for ±10 %", low=0.0, high=MAX_SCALE)
    rehearse_incline_deg: float = parameter(
        0.0, "incline of the ground under these twins, downhill all round [degrees]", low=0.0, high=MAX_INCLINE_DEG
    )
    longest_chain: int = parameter(24, "most rolls in a row without a stop", low=2, high=200)
    keep_in: str = parameter(
        "",
        "area that chains and travels stay in: 3 or more corners, x and y in m in frame odom, such as -1 -1, 2 -1, 2 1.5; it is "
        "their convex hull; empty: anywhere",
    )
    least_odds: float = parameter(
        0.0,
        "a roll that rehearsal finds less likely than this is refused unless its goal says anyway",
        low=0.0,
        high=1.0,
    )


@dataclass(eq=False)
class _Running:
    """A roll that is under way."""

    goal: ServerGoalHandle
    sequence: RollSequence
    asked_at: float = field(default_factory=time.monotonic)
    done: Future = field(default_factory=Future)
    begun: bool = False
    cancelled_at: float | None = None
    gait: Gait | Chain | None = None
    rehearsal: concurrent.futures.Future[Rehearsing] | None = None
    probability: float = math.nan  # as rehearsed; NaN: not yet, or nobody asked
    unlikely: bool = False  # and refused for that
    motion: Any = None
    move: Move | None = None
    motions: int = 0  # that were asked for: what an older one still has to say does not matter
    sends: int = 0  # of `move`
    motion_asked: float | None = None  # when the bridge was asked for the motion that is under way
    motion_began_ns: int = 0
    motion_s: float = 0.0
    rolled_on_from: tuple[int, float, float] | None = None  # robot time, x, y of the twin when the chain began


class GaitPlannerNode(Node):
    """See the module. Everything runs in one executor thread; no callback waits."""

    def __init__(self, _end: EndProcess):
        super().__init__("gait_planner")
        self._settings = p = declare_parameters(self, PlannerParameters)
        self._library = load_library(p.library)
        self._graph = FaceGraph(self._library, load_success_counts(self._library, Path(p.odds_file) if p.odds_file else None))
        self._prototype = load_prototype(p.prototype_file or None)
        self._rules = RollRules(
            tuple(float(length) for length in neutral_lengths(self._prototype)),
            p.confirm == "observed",
            p.settle_timeout_s,
            p.confirm_timeout_s,
        )
        self._bridge: BridgeState | None = None
        self._sent: StrutsSent | None = None
        self._twin: TwinState | None = None
        self._twin_newest: TwinState | None = None
        self._observed: FaceObservation | None = None
        self._seen = self._felt = False
        self._blind_ns: int | None = None  # robot time of a chain that nobody saw: what was known before is not known since
        self._events = EventTimes()
        self._live = LiveBridge(self.get_logger().warning, self._forget_times)
        self._roll: _Running | None = None

        topics.BRIDGE_STATE.subscribe(self, self._on_bridge_state)
        live = self._live.takes
        topics.STRUTS_SENT.subscribe(self, lambda event: live(event, self._on_sent), qos.STATES)
        topics.BRIDGE_FACE.subscribe(self, lambda event: live(event, self._on_face))
        topics.TWIN_STATE.subscribe(self, self._on_twin)
        self._area = ChainArea(self, p.keep_in, self._prototype)
        self._lease = Lease(self, self._look, p.prototype)
        self._struts = ActionClient(self, ExecuteStruts, "execute_struts")
        self._rehearsals = topics.REHEARSAL.publisher(self)
        self._rehearser = (
            Rehearser(self._prototype, Law(p.rehearse_scale, incline_deg=p.rehearse_incline_deg), p.rehearse_members, DEFAULT_SEED)
            if p.rehearse_members
            else None
        )
        self._server = ActionServer(self, Roll, "roll", self._execute, goal_callback=self._on_goal, cancel_callback=self._on_cancel)
        serve_face_graph(self, self._graph)
        serve_rehearse(self, self._graph, self._rehearser)
        self.create_timer(TICK_S, self._tick, clock=STEADY)
        if self._rehearser is not None and not is_warm([Stage.BATCH]):
            self.get_logger().info("compiling the solver for rehearsal, once for these sources: a first roll waits for it")
        names = ", ".join(primitive.name for primitive in self._library.primitives)
        self.get_logger().info(f"library {self._library.name} ({self._library.hash}): {names}")

    # ---- process ----------------------------------------------------------------------------------------------------

    def halt(self) -> None:
        """The bridge holds the struts when the lease falls silent; asking for it is quicker."""
        roll = self._roll
        if roll is not None and roll.motion is not None:
            roll.motion.cancel_goal_async()

    def close(self) -> None:
        """Ends the action's server and client, and the rehearsals."""
        if self._rehearser is not None:
            self._rehearser.close()
        self._server.destroy()
        self._struts.destroy()

    # ---- what is known ----------------------------------------------------------------------------------------------

    def _on_bridge_state(self, message: BridgeState) -> None:
        if not self._live.hears(message, self.get_clock().now().nanoseconds):
            return
        self._bridge = message
        self._lease.follow(message)
        self._look()

    def _on_sent(self, message: StrutsSent) -> None:
        self._sent = message
        self._events.add(message.seq, message.robot_time_ns)

    def _forget_times(self) -> None:
        """Another bridge, another clock: what was known stays known, but nothing of it is newer than a motion of now."""
        self._events, self._twin, self._sent = EventTimes(), None, None
        if self._observed is not None:
            self._observed.robot_time_ns = LONG_AGO

    def _on_face(self, message: FaceObservation) -> None:
        self._observed = message
        self._events.add(message.seq, message.robot_time_ns)
        if message.source == FaceObservation.SOURCE_IMU:  # one that does not know the face is no observer
            self._felt = bool(message.face)
        elif message.source != FaceObservation.SOURCE_OPERATOR:
            self._seen = True
        if self._rehearser is not None and self._roll is None and message.settled and message.face:  # not beside a motion
            self._rehearser.prepare(message.face)
        self._look()

    def _on_twin(self, message: TwinState) -> None:
        self._twin_newest = message
        self._look()

    def _view(self) -> View:
        newest = self._twin_newest
        if newest is not None and newest.session == self._live.session and self._events.has(newest.last_seq, newest.robot_time_ns):
            self._twin = newest  # it follows this bridge, and no further than we know ourselves
        sent, twin, seen = self._sent, self._twin, self._observed
        if self._blind_ns is not None:
            if seen is not None and seen.robot_time_ns > self._blind_ns:
                self._blind_ns = None
            else:
                twin = seen = None
        return View(
            robot_time_ns=sent.robot_time_ns if sent else 0,
            lengths_m=_lengths(sent.length_m) if sent else (),
            predicted=Seen(twin.face or None, twin.at_rest, twin.robot_time_ns, "predicted") if twin else None,
            observed=Seen(seen.face or None, seen.settled, seen.robot_time_ns, seen.source) if seen else None,
            observer=self._observer,
        )

    @property
    def _observer(self) -> bool:
        """Something, not a person, tells the face all the time."""
        return self._seen or self._felt

    def face_at_rest(self) -> str:
        """Where the robot stands, for a rehearsal. Raises RollRefused: nobody knows, or a roll is running."""
        if self._roll is not None:
            raise RollRefused("a roll is running: ask again when it is over")
        return known_face(self._view())

    def _trouble(self) -> str:
        """Why the struts may not be moved; nothing if they may, or may soon."""
        state = self._bridge
        if state is None or self._silent():
            return "the hardware bridge is silent: start it (ros2 run tensegrity_robot hardware_bridge)"
        if not state.port:
            return f"the bridge has no port: {state.reason}"
        if state.state == BridgeState.FAULT:
            reset = f"ros2 service call {self.resolve_service_name('reset')} std_srvs/srv/Trigger"
            return f"the bridge is in FAULT ({state.reason}): remove the cause, then {reset}, then {self._arm_call()}"
        if not self._lease.held:
            if state.lease_holder:
                return f"{state.lease_holder} holds the bridge's lease: it must be given back first (disarm)"
            because = f" ({state.reason})" if state.reason else ""
            return f"the robot is not armed{because}: {self._arm_call()}"
        return ""

    def _silent(self) -> bool:
        return self._bridge is None or self._lease.unheard_s > SILENT_S

    def _homing(self) -> bool:
        """Homing goes on, or is about to: `arm` may answer before the bridge's state says so."""
        return self._bridge is None or self._bridge.state in (BridgeState.DISARMED, BridgeState.HOMING)

    def _arm_call(self) -> str:
        return f'ros2 service call {self.resolve_service_name("arm")} tensegrity_interfaces/srv/Arm "{{lifted_and_clear: true}}"'

    # ---- the roll's action ------------------------------------------------------------------------------------------

    def _on_goal(self, _request: Roll.Goal) -> GoalResponse:
        if self._roll is not None:
            self.get_logger().warning("roll rejected: another one is running")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _on_cancel(self, _goal: ServerGoalHandle) -> CancelResponse:
        roll = self._roll
        if roll is None:
            return CancelResponse.REJECT
        roll.cancelled_at = time.monotonic()
        if roll.motion is not None:
            roll.motion.cancel_goal_async()
        return CancelResponse.ACCEPT

    async def _execute(self, goal: ServerGoalHandle) -> Roll.Result:
        if self._roll is not None:  # two goals accepted in one turn of the executor
            goal.abort()
            return Roll.Result(reason="another roll is running")
        request = goal.request
        self._roll = roll = _Running(goal, RollSequence(self._rules, lambda face: self._plan(request, face)))
        try:
            self._look()
            outcome: RollOutcome = await roll.done
            return self._result(roll, outcome)
        finally:
            self._roll = None

    def _plan(self, request: Roll.Goal, source: str) -> RollPlan:
        """The gait from the face known now. Raises SimError, naming what is valid."""
        roll = self._roll
        assert roll is not None
        if request.faces:
            return self._plan_chain(roll, request, source)
        require_adjacent(request.source_face or source, request.target_face)
        self._require_source(request, source)
        roll.gait = gait = wanted_gait(self._graph, source, request.target_face, request.primitive)
        *via, last = (_lengths(lengths_of(self._prototype, stage)) for stage in in_stages(gait.policy))
        return RollPlan(source, request.target_face, last, tuple(via))

    def _plan_chain(self, roll: _Running, request: Roll.Goal, source: str) -> RollPlan:
        """The chain from the face known now. Raises SimError, naming what is valid."""
        self._require_source(request, source)
        if request.target_face not in ("", request.faces[-1]):
            raise RollRefused(
                f"target_face is {request.target_face}, the last of faces is {request.faces[-1]}: leave the former empty"
            )
        if len(request.faces) > self._settings.longest_chain:
            raise RollRefused(
                f"{len(request.faces)} faces are more than longest_chain {self._settings.longest_chain}: roll in parts"
            )
        roll.gait = chain = wanted_chain(self._graph.library, source, request.faces, request.primitive)
        blind = self._rules.observe and not self._observer
        if blind and not len(request.faces) <= request.blind_rolls <= MOST_BLIND:
            raise RollRefused(
                f"nobody observes the robot, and blind_rolls {request.blind_rolls} allows less than these {len(request.faces)} "
                f"rolls (at most {MOST_BLIND}): give an observer, say blind_rolls, or roll face by face"
            )
        links = tuple(Link(_lengths(lengths_of(self._prototype, r.policy)), r.onto, r.dwell_s, r.time_s) for r in chain.rolls)
        short = self._short_of(chain)
        if short:
            raise RollRefused(f"{short} (bridge/state): {_REMEDY}")
        self._area.require_inside(chain, self._observer)
        return RollPlan(source, chain.target, (), links=links, blind=blind)

    def _short_of(self, chain: Chain) -> str:
        """What there is not enough of for two rolls more and the way back; empty: there is."""
        left_s, needs_s = self._duty_left_s(), chain.runs_s(self._prototype.actuator_speed_m_s) + DUTY_MARGIN_S
        if left_s < needs_s:
            return f"the struts may run for {left_s:.0f} s yet, two rolls and the way back need {needs_s:.0f} s"
        state = self._bridge
        if state is not None and state.battery_v < state.supply_low_v:
            return f"servo supply is {state.battery_v:.2f} V, the limit is {state.supply_low_v:g} V"
        return ""

    def _duty_left_s(self) -> float:
        left_s = math.inf if self._bridge is None else float(self._bridge.duty_left_s)
        return math.inf if math.isnan(left_s) else left_s

    def _require_source(self, request: Roll.Goal, source: str) -> None:
        if request.source_face and request.source_face != source:
            raise RollRefused(
                f"the robot is known to stand on {source}, not on {request.source_face}: leave source_face empty, or say where it "
                "stands with set_face"
            )

    def _result(self, roll: _Running, outcome: RollOutcome) -> Roll.Result:
        if roll.cancelled_at is not None and roll.goal.is_cancel_requested:
            roll.goal.canceled()
        elif outcome.success:
            roll.goal.succeed()
        else:
            roll.goal.abort()
        gait = roll.gait
        self.get_logger().info(f"roll {'ended well' if outcome.success else 'failed'}: {outcome.reason or outcome.faces}")
        return Roll.Result(
            success=outcome.success,
            completed=outcome.completed,
            reason=outcome.reason,
            rolls=outcome.rolls,
            ended_early=outcome.ended_early,
            primitive=gait.cycle.name if isinstance(gait, Chain) else gait.primitive.name if gait else "",
            gait=gait.name if gait else "",
            predicted_face=outcome.predicted_face,
            observed_face=outcome.observed_face,
            face_sequence=list(outcome.faces),
            duration_s=outcome.duration_s,
            odds=roll.probability,
            unlikely=roll.unlikely,
        )

    # ---- the roll's steps -------------------------------------------------------------------------------------------

    def _tick(self) -> None:
        if self._silent():
            self._lease.lose("the hardware bridge is silent")
        self._look()
        roll = self._roll
        if roll is None or roll.done.done():
            return
        view = self._view()
        known = view.observed if view.observer else view.predicted
        roll.goal.publish_feedback(
            Roll.Feedback(
                phase=str(roll.sequence.phase) if roll.begun else "rehearsing" if roll.rehearsal else "homing",
                face=(known.face or "") if known is not None else "",
                next_face=roll.sequence.next_face,
                rolls=roll.sequence.rolls,
                m_per_min=self._m_per_min(roll),
                duty_left_s=self._duty_left_s(),
                progress=self._progress(roll, view),
                length_m=view.lengths_m,
                odds=roll.probability,
            )
        )

    def _m_per_min(self, roll: _Running) -> float:
        """How fast a chain goes, by the twin; NaN before it goes."""
        if roll.sequence.phase is not Phase.ROLL_ON or self._twin is None:
            return math.nan
        now = (self._twin.robot_time_ns, self._twin.center_of_mass.x, self._twin.center_of_mass.y)
        began = roll.rolled_on_from = roll.rolled_on_from or now
        seconds = (now[0] - began[0]) * 1e-9
        return 60.0 * math.hypot(now[1] - began[1], now[2] - began[2]) / seconds if seconds > 0.0 else math.nan

    def _progress(self, roll: _Running, view: View) -> float:
        """Part of the gait's time that is over: each of its two motions is one half."""
        plan = roll.sequence.plan
        if plan is not None and plan.links and roll.sequence.phase is Phase.ROLL_ON:
            return roll.sequence.rolls / (len(plan.links) + 1)
        halves = {Phase.ACTUATE: 0.0, Phase.ACTUATE_SETTLE: 0.5, Phase.RETURN: 0.5, Phase.RETURN_SETTLE: 1.0, Phase.CONFIRM: 1.0}
        half = halves.get(roll.sequence.phase, 0.0)
        if roll.sequence.phase in (Phase.ACTUATE, Phase.RETURN) and roll.motion_s > 0.0:
            half += 0.5 * min(1.0, (view.robot_time_ns - roll.motion_began_ns) * 1e-9 / roll.motion_s)
        return half

    def _look(self) -> None:
        """Something is known anew, or time has passed."""
        roll = self._roll
        if roll is None or roll.done.done():
            return
        if not roll.begun and self._silent() and time.monotonic() - roll.asked_at < CALL_TIMEOUT_S:
            return  # a bridge just started is heard of later than a goal
        trouble = self._trouble()
        if trouble:
            self._end_with(roll, trouble)
        elif not roll.begun:
            self._begin(roll)
        elif roll.cancelled_at is not None:
            if roll.motion_asked is None or time.monotonic() - roll.cancelled_at > CALL_TIMEOUT_S:
                self._end_with(roll, "cancelled; the struts hold where they are")
        elif roll.motion is None and roll.motion_asked is not None and time.monotonic() - roll.motion_asked > CALL_TIMEOUT_S:
            self._end_with(roll, "the bridge does not answer (action execute_struts)")
        else:
            self._watch_strength(roll)
            try:
                step = self._area.watch(roll.sequence, self._view()) or roll.sequence.look(self._view())
            except SimError as error:
                self._end_with(roll, str(error))
                return
            if isinstance(step, RollOutcome):
                self._close(step)
            elif step is not None:
                self._do(step)

    def _watch_strength(self, roll: _Running) -> None:
        """A chain ends in neutral before duty or supply is spent."""
        if isinstance(roll.gait, Chain) and roll.sequence.phase is Phase.ROLL_ON:
            short = self._short_of(roll.gait)
            if short:
                roll.sequence.end_early(short)

    def _begin(self, roll: _Running) -> None:
        """The first motion, as soon as homing is over and the struts' lengths are known."""
        view = self._view()
        if roll.cancelled_at is not None:
            self._end_with(roll, "cancelled before it began")
        elif not self._homing() and view.lengths_m:
            try:
                if self._rehearsed(roll, view):
                    roll.begun = True
                    self._do(roll.sequence.begin(view))
            except SimError as error:
                self._end_with(roll, str(error))

    def _rehearsed(self, roll: _Running, view: View) -> bool:
        """Whether the rehearsal of a roll is over, or not wanted. Raises SimError: the roll cannot be, or is too unlikely."""
        if self._rehearser is None or not math.isnan(roll.probability):
            return True
        if roll.rehearsal is None:
            self._plan(roll.goal.request, known_face(view))
            assert roll.gait is not None
            roll.rehearsal = self._rehearser.rehearse(roll.gait, self._graph)
        if not roll.rehearsal.done():
            return False
        try:
            found = roll.rehearsal.result()
        except SimError as error:
            raise RollRefused(f"the roll cannot be rehearsed: {error}; rehearse_members:=0 rolls without") from error
        self.tell_rehearsal(found)
        roll.probability = found.wanted.rate.value
        if roll.probability < self._settings.least_odds and not roll.goal.request.anyway:
            roll.unlikely = True
            raise RollRefused(_unlikely(found, self._settings.least_odds))
        return True

    def tell_rehearsal(self, found: Rehearsing) -> Rehearsal:
        """Publishes what was found; the message."""
        assert self._rehearser is not None
        message = rehearsal_message(found, self._rehearser.law)
        message.header.stamp = self.get_clock().now().to_msg()
        self._rehearsals.publish(message)
        return message

    def _end_with(self, roll: _Running, reason: str) -> None:
        if roll.motion is not None:
            roll.motion.cancel_goal_async()
        self._close(roll.sequence.end(self._view(), reason))

    def _close(self, outcome: RollOutcome) -> None:
        roll = self._roll
        if roll is not None and not roll.done.done():
            if roll.sequence.plan is not None and roll.sequence.plan.blind and roll.motions:
                self._blind_ns = self._view().robot_time_ns
            roll.done.set_result(outcome)

    def _do(self, move: Move) -> None:
        """Ask the bridge for a motion."""
        roll = self._roll
        assert roll is not None
        roll.sends = roll.sends + 1 if move is roll.move else 1
        roll.move = move
        roll.motions += 1
        number, view = roll.motions, self._view()
        knots = constant_speed_knots(view.lengths_m, *move.via, move.lengths_m, speed_m_s=self._prototype.actuator_speed_m_s)
        if not knots:
            roll.sequence.moved(view)
            return
        roll.motion_asked = time.monotonic()
        roll.motion_began_ns, roll.motion_s = view.robot_time_ns, knots[-1].time_s
        goal = ExecuteStruts.Goal(
            trajectory=self._trajectory(knots),
            lease=self._lease.held,
            library_hash=self._library.hash,
            session=self._lease.session,
            overtake=move.overtakes,
        )
        self._struts.send_goal_async(goal).add_done_callback(lambda future: self._on_motion_answer(roll, number, future))

    def _trajectory(self, knots: tuple[Knot, ...]) -> JointTrajectory:
        after = lambda time_s: Duration(nanoseconds=round(time_s * 1e9)).to_msg()  # noqa: E731
        points = [JointTrajectoryPoint(positions=list(knot.lengths_m), time_from_start=after(knot.time_s)) for knot in knots]
        return JointTrajectory(header=Header(stamp=self.get_clock().now().to_msg()), joint_names=STRUT_NAMES, points=points)

    def _on_motion_answer(self, roll: _Running, number: int, future: Future) -> None:
        handle = future.result()
        if not handle.accepted:
            self._motion_over(roll, number, False, "the bridge rejected the motion: another one is running")
            return
        if number == roll.motions:
            roll.motion = handle
        if roll.cancelled_at is not None or roll.done.done():
            handle.cancel_goal_async()
        handle.get_result_async().add_done_callback(
            lambda done: self._motion_over(roll, number, done.result().result.success, done.result().result.reason)
        )

    def _motion_over(self, roll: _Running, number: int, success: bool, reason: str) -> None:
        if number != roll.motions:
            return  # overtaken
        roll.motion = roll.motion_asked = None
        if roll.done.done():
            return
        if roll.cancelled_at is not None:
            self._end_with(roll, "cancelled; the struts hold where they are")
        elif not success and may_be_sent_again(reason) and roll.move is not None and roll.sends < MOST_SENDS:
            self._do(roll.move)
        elif not success and roll.sequence.phase is Phase.ROLL_ON and not self._trouble():
            self._do(roll.sequence.give_up(f"the bridge ended the motion: {reason}", missed=False))
        elif not success:
            self._end_with(roll, f"the bridge ended the motion: {reason}")
        else:
            roll.sequence.moved(self._view())
            self._look()


def _unlikely(found: Rehearsing, least: float) -> str:
    rate, ends = found.wanted.rate, ", ".join(f"{face} {count}" for face, count in found.wanted.outcomes.items())
    best = max(found.gaits, key=lambda rehearsed: rehearsed.rate.value)
    instead = f"; likelier: {best.gait.name}, {best.rate.successes} of {best.rate.trials}" if best is not found.wanted else ""
    return (
        f"{rate.successes} of {rate.trials} rehearsals of {found.wanted.gait.name} succeeded (they ended on {ends}), less than "
        f"least_odds {least:g}{instead}; to roll it nevertheless, say anyway in the goal"
    )


def _lengths(values: Any) -> Lengths:
    return tuple(float(value) for value in values)


ABOUT = About(
    name="gait_planner",
    text="holds the bridge's lease and rolls the robot from face to face",
    settings=PlannerParameters,
    gives="rehearsal keep_in bridge/lease roll() arm() disarm() face_graph() rehearse()",
    takes="bridge/state bridge/struts_sent bridge/face bridge/observed_joints twin/state twin/joints face_estimate "
    "execute_struts() bridge/arm() bridge/disarm()",
    example="-p library:=improved",
)


def main() -> int:
    """The executable `gait_planner`."""
    return run(GaitPlannerNode, ABOUT)
