# SPDX-License-Identifier: Apache-2.0
"""The console as a ROS node: keeps what the stack tells, and asks it for what an operator wants. No call waits."""

import json
import math
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped, PoseArray, PoseStamped
from nav_msgs.msg import Path
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_msgs.msg import String
from std_srvs.srv import Trigger

from sim_core.printable import NAME_MOST, printable
from sim_core.twin.live_bridge import LiveBridge
from tensegrity_console.web.state import NOWHERE, Facts, rehearsal_of
from tensegrity_interfaces.action import Roll, Travel
from tensegrity_interfaces.msg import BridgeState, FaceObservation, TwinState
from tensegrity_interfaces.srv import Arm, Disarm, Rehearse, SetFace
from tensegrity_lab.stack.ros_thread import Spinner
from tensegrity_lab.trials.remote_panel import key_text
from tensegrity_robot.ros import topics
from tensegrity_robot.ros.conversions import frame_prefix
from tensegrity_robot.ros.node_process import own_context

Answer = Callable[[bool, str], None]
"""Told once whether something was done, and in words how it went."""
ANSWER_LIMIT_S = 5.0
STOP_LIMIT_S = 1.0
"""The bridge answers within milliseconds; after this a person must know that it did not."""
STOP_AGAIN_S = 0.25
REHEARSE_AGAIN_S = 3.0
ARM_LIMIT_S = 40.0
"""A bridge just started loads its judge of shapes before it answers."""
TICK_S = 0.1
MOST_BYTES = 256 * 1024
MOST_PLACES, MOST_ROLLS, MOST_PARTS = 13, 500, 50
"""Of what a message may hold, that which is looked at."""


class RosSide:
    """Two nodes in a context of their own: one for the stop alone, one for all else. Methods may be called from any thread."""

    def __init__(self) -> None:
        self.facts = Facts()  # to be read, not changed
        self._context = own_context()
        self._node = node = Node("console", context=self._context)
        self._live = LiveBridge(node.get_logger().warning)
        self._subscribe(topics.BRIDGE_STATE, self._on_bridge)
        self._subscribe(topics.BRIDGE_FACE, lambda face: self._live.takes(face, self._on_face))
        for topic, facts_of in KEPT:
            self._subscribe(topic, partial(self._keep_of, facts_of))
        self._keys = topics.TRIAL_KEY.publisher(node)
        kinds = {"arm": Arm, "disarm": Disarm, "reset": Trigger, "set_face": SetFace, "rehearse": Rehearse}
        self._services: dict[str, Any] = {name: node.create_client(kind, name) for name, kind in kinds.items()}
        self._rolls = ActionClient(node, Roll, "roll")
        self._travels = ActionClient(node, Travel, "travel")
        self._running: Any = None
        self._asked: list[tuple[Any, float, Answer]] = []
        self._rehearsed, self._rehearse_at = "", 0.0
        node.create_timer(TICK_S, self._tick)
        self._spinner = Spinner(node, self._context)
        self._executor = self._spinner.executor
        stopping = Node("console_stop", context=self._context)
        self._stop = stopping.create_client(Trigger, "stop")
        self._stopper = Spinner(stopping, self._context)

    def close(self) -> None:
        """Leave ROS."""
        self._spinner.close()
        self._stopper.close()
        self._context.try_shutdown()

    def _subscribe(self, topic: topics.Topic, callback: Callable[[Any], None]) -> None:
        """Listen, but take nothing apart that is larger than such a message ever is: that would hold up the stop."""

        def take(data: bytes) -> None:
            if len(data) <= MOST_BYTES:
                callback(deserialize_message(data, topic.kind))

        topic.subscribe(self._node, take, raw=True)

    # ---- what is heard ----------------------------------------------------------------------------------------------

    def _keep(self, **facts: Any) -> None:
        vars(self.facts).update(facts)

    def _keep_of(self, facts_of: Callable[[Any], dict[str, Any]], message: Any) -> None:
        self._keep(**facts_of(message))

    def _on_bridge(self, message: BridgeState) -> None:
        if not self._live.hears(message, self._node.get_clock().now().nanoseconds):
            return  # a recording's, or another robot's
        self._keep(
            heard=time.monotonic(),
            state=printable(message.state, NAME_MOST),
            reason=printable(message.reason),
            holder=printable(message.lease_holder, NAME_MOST),
            link_ok=message.link_ok,
            virtual=message.virtual_port,
            duty_left_s=message.duty_left_s,
            battery_v=message.battery_v,
            bag=printable(message.bag.rpartition("/")[2]),
            bag_messages=int(message.bag_messages),
            lengths_m=np.array(message.length_m, dtype=float),
            last="" if message.state == BridgeState.HOMING != self.facts.state else self.facts.last,  # a new beginning
        )

    def _on_face(self, message: FaceObservation) -> None:
        face, source = printable(message.face, NAME_MOST), printable(message.source, NAME_MOST)
        self._keep(observed=face, settled=bool(message.settled), source=source, detail=printable(message.detail))

    # ---- what is asked ----------------------------------------------------------------------------------------------

    def stop(self, answer: Answer) -> None:
        """Stop, latched; says when it took effect. Roll and travel under way end by that."""
        if not self._stop.service_is_ready():
            answer(False, "NOT STOPPED: nobody offers stop; use the power switch")
            return
        began, told = time.monotonic(), threading.Event()

        def over(done: Any) -> None:
            if told.is_set():
                return
            told.set()
            took, result = f"{1e3 * (time.monotonic() - began):.0f} ms", done.result()
            if result.success:
                answer(True, f"stopped: in force {took} after the call")
            else:
                answer(False, f"NOT STOPPED: {result.message}; use the power switch")

        def ask() -> None:  # again and again: a request to a bridge that has not met this node yet is lost
            if told.is_set():
                return
            if time.monotonic() - began > STOP_LIMIT_S:
                told.set()
                answer(False, f"NOT STOPPED: the bridge has not answered for {STOP_LIMIT_S:g} s; use the power switch")
                return
            self._stop.call_async(Trigger.Request()).add_done_callback(over)
            timer = threading.Timer(STOP_AGAIN_S, ask)
            timer.daemon = True
            timer.start()

        ask()

    def arm(self, answer: Answer) -> None:
        """Arm for the console; whoever presses says that the robot is lifted and clear."""
        self._call("arm", Arm.Request(holder="console", lifted_and_clear=True), answer, ARM_LIMIT_S)

    def disarm(self, answer: Answer) -> None:
        """Give the lease back."""
        self._call("disarm", Disarm.Request(), answer)

    def reset(self, answer: Answer) -> None:
        """Leave FAULT."""
        self._call("reset", Trigger.Request(), answer)

    def set_face(self, face: str, answer: Answer) -> None:
        """Say where the robot stands, as a person sees it."""
        self._call("set_face", SetFace.Request(face=face, source=FaceObservation.SOURCE_OPERATOR), answer)

    def rehearse(self, target: str, answer: Answer) -> None:
        """Odds of a roll and of those to the other neighbours; they come with `Facts.rehearsal`."""
        self._call("rehearse", Rehearse.Request(target_face=target), answer, ARM_LIMIT_S)

    def roll(self, target: str, anyway: bool, answer: Answer) -> None:
        """Roll onto a neighbouring face."""
        self._act(self._rolls, "roll", Roll.Goal(target_face=target, anyway=anyway), answer)

    def travel(self, place_m: tuple[float, float], answer: Answer) -> None:
        """Travel to a place on the floor."""
        goal = Travel.Goal()
        goal.goal.header.frame_id = frame_prefix(self._node) + "odom"
        goal.goal.header.stamp = self._node.get_clock().now().to_msg()
        goal.goal.pose.position.x, goal.goal.pose.position.y = place_m
        self._act(self._travels, "travel", goal, answer)

    def cancel(self, answer: Answer) -> None:
        """End the roll or travel of this console; struts are held."""
        running = self._running
        if running is None:
            answer(False, "nothing of this console is under way")
        else:
            self._executor.create_task(running.cancel_goal_async)
            answer(True, "cancelling")

    def press(self, key: str, panel: str) -> None:
        """A key for the session that runs, as the answer to what its panel showed."""
        self._keys.publish(String(data=key_text(key, panel)))

    # ---- calls ------------------------------------------------------------------------------------------------------

    def _call(self, name: str, request: Any, answer: Answer, limit_s: float = ANSWER_LIMIT_S) -> None:
        client = self._services[name]
        if not client.service_is_ready():
            answer(False, f"nobody offers {name}: is the stack running, in this ROS domain?")
            return

        def ask() -> None:
            future = client.call_async(request)
            asked = (future, time.monotonic() + limit_s, answer)
            self._asked.append(asked)
            future.add_done_callback(lambda done: self._answered(asked))

        self._executor.create_task(ask)

    def _answered(self, asked: tuple[Any, float, Answer]) -> None:
        if asked in self._asked:
            self._asked.remove(asked)
            result = asked[0].result()
            asked[2](bool(result.success), str(result.message))

    def _act(self, client: ActionClient, name: str, goal: Any, answer: Answer) -> None:
        if not client.server_is_ready():
            answer(False, f"nobody offers the action {name}: is the stack running, in this ROS domain?")
            return

        def show(message: Any) -> None:
            told = message.feedback
            self._keep(**{name: {key: _plain(getattr(told, key)) for key in told.get_fields_and_field_types()}})

        async def act() -> None:
            handle = await client.send_goal_async(goal, feedback_callback=show)
            if not handle.accepted:
                answer(False, f"the {name} was rejected: another one is running")
                return
            self._running = handle
            self.facts.last = ""
            answer(True, f"{name} begins")
            result = (await handle.get_result_async()).result
            self._running = None
            why = printable(result.reason)
            self._keep(**{name: None}, last=f"{name} {'ended well' if result.success else 'failed'}{': ' + why if why else ''}")

        self._executor.create_task(act)

    def _tick(self) -> None:
        for asked in [one for one in self._asked if time.monotonic() > one[1]]:
            self._asked.remove(asked)
            asked[2](False, "no answer")
        for name, client in (("roll", self._rolls), ("travel", self._travels)):
            if getattr(self.facts, name) is not None and not client.server_is_ready():
                self._running = None
                self._keep(**{name: None}, last=f"{name} failed: whoever did it has gone; look where the robot is")
        if self.facts.trial is not None and not self._node.count_publishers(topics.TRIAL_PANEL.name):
            self.facts.trial = None  # the session is over, or was killed
        self._keep_rehearsed()

    def _keep_rehearsed(self) -> None:
        """Odds of the neighbours whenever the robot has come to rest on another face, before anybody asks."""
        facts = self.facts
        quiet = facts.roll is None and facts.travel is None and facts.trial is None  # a session's rolls are not to wait for ours
        if not facts.face:
            self._rehearsed = facts.unrehearsed = ""
        elif self._rehearsed != facts.face and quiet and time.monotonic() > self._rehearse_at and len(facts.joints_m):
            self._rehearse_at = time.monotonic() + REHEARSE_AGAIN_S
            face, facts.unrehearsed = facts.face, facts.unrehearsed or "rehearsing …"

            def told(done: bool, words: str) -> None:
                self._rehearsed = face if done else ""
                facts.unrehearsed = "" if done else words

            self.rehearse("", told)


def _places(message: PoseArray) -> dict[str, Any]:
    places = np.array([(p.position.x, p.position.y, p.position.z) for p in message.poses[:MOST_PLACES]])
    return {"joints_m": places if len(places) and np.isfinite(places).all() else NOWHERE}


def _forces(message: TwinState) -> dict[str, Any]:
    forces = {"tendon_n": message.tendon_force_n, "strut_n": message.strut_force_n, "ground_n": message.ground_force_n}
    found = {name: np.nan_to_num(np.array(force), posinf=0.0, neginf=0.0) for name, force in forces.items()}
    return found | {"twin_heard": time.monotonic()}


def _health(message: DiagnosticArray) -> dict[str, Any]:
    level = lambda status: status.level[0] if isinstance(status.level, bytes) else int(status.level)  # noqa: E731
    parts = [
        (printable(s.name.rpartition(": ")[2], NAME_MOST), level(s), printable(s.message)) for s in message.status[:MOST_PARTS]
    ]
    return {"diagnostics": parts}


def _way(message: Path) -> dict[str, Any]:
    way = np.array([(p.pose.position.x, p.pose.position.y) for p in message.poses[:MOST_ROLLS]]).reshape(-1, 2)
    return {"way_m": way[np.isfinite(way).all(axis=1)]}


def _area(message: PolygonStamped) -> dict[str, Any]:
    corners = np.array([(point.x, point.y) for point in message.polygon.points[:MOST_ROLLS]]).reshape(-1, 2)
    return {"keep_in_m": corners[np.isfinite(corners).all(axis=1)]}


def _goal(message: PoseStamped) -> dict[str, Any]:
    x, y = message.pose.position.x, message.pose.position.y
    return {"goal_m": (x, y) if math.isfinite(x) and math.isfinite(y) else None}


def _panel(message: String) -> dict[str, Any]:
    shown = json.loads(message.data) if message.data else None
    if not isinstance(shown, dict):
        return {"trial": None}
    return {"trial": {printable(key, NAME_MOST): _plain(value) for key, value in list(shown.items())[:MOST_PARTS]}}


def _plain(value: Any) -> Any:
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, list):  # of keys and what they mean
        pairs = [pair for pair in value[:MOST_PARTS] if isinstance(pair, list) and len(pair) == 2]
        return [[printable(word, NAME_MOST) for word in pair] for pair in pairs]
    return value if isinstance(value, int) or (isinstance(value, float) and math.isfinite(value)) else None


KEPT: tuple[tuple[topics.Topic, Callable[[Any], dict[str, Any]]], ...] = (
    (topics.TWIN_FACE, lambda message: {"predicted": printable(message.face, NAME_MOST)}),
    (topics.TWIN_STATE, _forces),
    (topics.TWIN_JOINTS, _places),
    (topics.DIAGNOSTICS, _health),
    (topics.REHEARSAL, lambda message: {"rehearsal": rehearsal_of(message)}),
    (topics.TRAVEL_PATH, _way),
    (topics.TRAVEL_GOAL, _goal),
    (topics.KEEP_IN, _area),
    (topics.TRIAL_PANEL, _panel),
)
"""Topics, and the facts that follow from their messages."""
