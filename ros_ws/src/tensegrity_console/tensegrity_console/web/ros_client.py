# SPDX-License-Identifier: Apache-2.0
"""The console as a ROS node: keeps what the stack tells, and asks it for what an operator wants. No call waits."""

from __future__ import annotations

import json
import math
import os
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Path
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String
from std_srvs.srv import Trigger

from sim_core.printable import NAME_MOST, printable
from sim_core.twin.live_bridge import LiveBridge
from tensegrity_console.web.state import NOWHERE, Facts, rehearsal_of
from tensegrity_interfaces.action import Roll, Travel
from tensegrity_interfaces.msg import BridgeState, FaceObservation, Rehearsal, TwinState
from tensegrity_interfaces.srv import Arm, Disarm, Rehearse, SetFace
from tensegrity_lab.stack.ros_thread import Spinner
from tensegrity_lab.trials.remote_panel import key_text
from tensegrity_robot.ros import topics
from tensegrity_robot.ros.discovery import discovery_changes, loopback_profile

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
    """Two nodes in a context of their own: one for the stop alone, one for all else. Methods may be called from any thread.

    Attributes:
        facts: newest of everything; read it, do not change it.
    """

    def __init__(self) -> None:
        os.environ.update(discovery_changes(os.environ, loopback_profile()))
        self.facts = Facts()
        self._context = Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = node = Node("console", context=self._context)
        subscribe = self._subscribe
        self._live = live = LiveBridge(node.get_logger().warning)
        subscribe(topics.BRIDGE_STATE, self._on_bridge)
        subscribe(topics.BRIDGE_FACE, lambda face: live.takes(face, self._on_face))
        subscribe(topics.TWIN_FACE, self._on_prediction)
        subscribe(topics.TWIN_STATE, self._on_twin)
        subscribe(topics.TWIN_JOINTS, self._on_joints)
        subscribe(topics.OBSERVED_JOINTS, self._on_seen)
        subscribe(topics.DIAGNOSTICS, self._on_diagnostics)
        subscribe(topics.REHEARSAL, self._on_rehearsal)
        subscribe(topics.TRAVEL_PATH, self._on_path)
        subscribe(topics.TRAVEL_GOAL, self._on_goal)
        subscribe(topics.TRIAL_PANEL, self._on_panel)
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
        rclpy.try_shutdown(context=self._context)

    def _subscribe(self, topic: topics.Topic, callback: Callable[[Any], None]) -> None:
        """Listen, but take nothing apart that is larger than such a message ever is: that would hold up the stop."""

        def take(data: bytes) -> None:
            if len(data) <= MOST_BYTES:
                callback(deserialize_message(data, topic.kind))

        topic.subscribe(self._node, take, raw=True)

    # ---- what is heard ----------------------------------------------------------------------------------------------

    def _on_bridge(self, message: BridgeState) -> None:
        if not self._live.hears(message, self._node.get_clock().now().nanoseconds):
            return  # a recording's, or another robot's
        facts = self.facts
        facts.heard = time.monotonic()
        facts.state, facts.reason = printable(message.state, NAME_MOST), printable(message.reason)
        facts.holder = printable(message.lease_holder, NAME_MOST)
        facts.link_ok, facts.virtual, facts.time_scale = message.link_ok, message.virtual_port, message.time_scale
        facts.duty_left_s, facts.battery_v = message.duty_left_s, message.battery_v
        facts.bag, facts.bag_messages = printable(message.bag), int(message.bag_messages)
        facts.lengths_m = np.array(message.length_m, dtype=float)

    def _on_face(self, message: FaceObservation) -> None:
        face, source = printable(message.face, NAME_MOST), printable(message.source, NAME_MOST)
        self.facts.observed, self.facts.settled, self.facts.source = face, bool(message.settled), source

    def _on_prediction(self, message: FaceObservation) -> None:
        self.facts.predicted = printable(message.face, NAME_MOST)

    def _on_twin(self, message: TwinState) -> None:
        facts = self.facts
        facts.twin_heard = time.monotonic()
        forces = (message.tendon_force_n, message.strut_force_n, message.ground_force_n)
        facts.tendon_n, facts.strut_n, facts.ground_n = (np.nan_to_num(np.array(one), posinf=0.0, neginf=0.0) for one in forces)

    def _on_joints(self, message: PoseArray) -> None:
        self.facts.joints_m = _places(message)

    def _on_seen(self, message: PoseArray) -> None:
        self.facts.seen_m = _places(message)[:12]

    def _on_rehearsal(self, message: Rehearsal) -> None:
        self.facts.rehearsal = rehearsal_of(message)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        level = lambda status: status.level[0] if isinstance(status.level, bytes) else int(status.level)  # noqa: E731
        self.facts.diagnostics = [
            (printable(s.name.rpartition(": ")[2], NAME_MOST), level(s), printable(s.message)) for s in message.status[:MOST_PARTS]
        ]

    def _on_path(self, message: Path) -> None:
        way = np.array([(p.pose.position.x, p.pose.position.y) for p in message.poses[:MOST_ROLLS]]).reshape(-1, 2)
        self.facts.way_m = way[np.isfinite(way).all(axis=1)]

    def _on_goal(self, message: PoseStamped) -> None:
        x, y = message.pose.position.x, message.pose.position.y
        self.facts.goal_m = (x, y) if math.isfinite(x) and math.isfinite(y) else None

    def _on_panel(self, message: String) -> None:
        shown = json.loads(message.data) if message.data else None
        self.facts.trial = _panel_of(shown) if isinstance(shown, dict) else None

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
        goal.goal.header.frame_id = "odom"
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
        facts = self.facts

        def show(message: Any) -> None:
            told = {key: getattr(message.feedback, key) for key in message.feedback.get_fields_and_field_types()}
            setattr(facts, name, {key: _plain(value) for key, value in told.items()})

        async def act() -> None:
            handle = await client.send_goal_async(goal, feedback_callback=show)
            if not handle.accepted:
                answer(False, f"the {name} was rejected: another one is running")
                return
            self._running = handle
            facts.last = ""
            answer(True, f"{name} begins")
            result = (await handle.get_result_async()).result
            self._running = None
            setattr(facts, name, None)
            why = printable(result.reason)
            facts.last = f"{name} {'ended well' if result.success else 'failed'}{': ' + why if why else ''}"

        self._executor.create_task(act)

    def _tick(self) -> None:
        for asked in [one for one in self._asked if time.monotonic() > one[1]]:
            self._asked.remove(asked)
            asked[2](False, "no answer")
        for name, client in (("roll", self._rolls), ("travel", self._travels)):
            if getattr(self.facts, name) is not None and not client.server_is_ready():
                self._running = None
                setattr(self.facts, name, None)
                self.facts.last = f"{name} failed: whoever did it has gone; look where the robot is"
        if self.facts.trial is not None and not self._node.count_publishers(topics.TRIAL_PANEL.name):
            self.facts.trial = None  # the session is over, or was killed
        self._keep_rehearsed()

    def _keep_rehearsed(self) -> None:
        """Odds of the neighbours whenever the robot has come to rest on another face, before anybody asks."""
        facts = self.facts
        quiet = facts.roll is None and facts.travel is None and facts.trial is None  # a session's rolls are not to wait for ours
        if not facts.face:
            self._rehearsed = ""
        elif self._rehearsed != facts.face and quiet and time.monotonic() > self._rehearse_at and len(facts.joints_m):
            self._rehearse_at = time.monotonic() + REHEARSE_AGAIN_S
            face = facts.face

            def told(done: bool, words: str) -> None:
                self._rehearsed = face if done else ""
                facts.unrehearsed = "" if done else words

            self.rehearse("", told)


def _places(message: PoseArray) -> np.ndarray:
    places = np.array([(p.position.x, p.position.y, p.position.z) for p in message.poses[:MOST_PLACES]])
    return places if len(places) and np.isfinite(places).all() else NOWHERE


def _panel_of(shown: dict[Any, Any]) -> dict[str, Any]:
    return {printable(key, NAME_MOST): _plain(value) for key, value in list(shown.items())[:MOST_PARTS]}


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 4) if math.isfinite(value) else None
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, list):  # of keys and what they mean
        pairs = [pair for pair in value[:MOST_PARTS] if isinstance(pair, list) and len(pair) == 2]
        return [[printable(word, NAME_MOST) for word in pair] for pair in pairs]
    return value if isinstance(value, (int, bool)) else None
