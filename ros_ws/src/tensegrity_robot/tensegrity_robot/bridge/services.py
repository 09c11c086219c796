# SPDX-License-Identifier: Apache-2.0
"""The bridge's services: each asks the bridge and puts its answer, or its refusal, into words."""

from __future__ import annotations

from typing import Protocol

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.lifecycle import LifecycleNode
from std_srvs.srv import Trigger

from hardware_bridge.driver.remote_bridge import RemoteBridge
from hardware_bridge.errors import BridgeError, Refused
from hardware_bridge.safety.lease_proof import Verifier
from tensegrity_interfaces.msg import FaceObservation, LeaseProof
from tensegrity_interfaces.srv import Arm, Disarm, SetFace
from tensegrity_robot.ros.background import elsewhere
from tensegrity_robot.ros.topics import LEASE


class Owner(Protocol):
    """Who has the bridge."""

    def bridge(self) -> RemoteBridge:
        """The open bridge. Raises Refused: there is none, with what to do."""

    def ready(self) -> RemoteBridge:
        """The bridge, if commands are taken. Raises Refused."""

    def confirmed_lengths_m(self) -> list[float | None] | None:
        """What is known about struts of unknown length. Raises Refused: this robot must not be armed now, and why."""


class BridgeCalls:
    """Services of a node, but for `stop` (see `bridge_process`), and the lease's proofs."""

    def __init__(self, node: LifecycleNode, owner: Owner):
        self._node = node
        self._owner = owner
        self._lease = ""
        self._verifier: Verifier | None = None
        node.create_service(Disarm, "bridge/disarm", self._on_disarm)
        # These wait, for the judge of shapes and for the port; in the node's own group everything else would wait with them.
        node.create_service(Arm, "bridge/arm", self._on_arm, callback_group=ReentrantCallbackGroup())
        node.create_service(Trigger, "reset", self._on_reset, callback_group=ReentrantCallbackGroup())
        node.create_service(SetFace, "set_face", self._on_set_face)
        LEASE.subscribe(node, self._on_proof)

    def let_go(self) -> None:
        """Ends any motion, struts held, and takes the lease back."""
        lease, self._lease = self._lease, ""
        if not lease:
            return
        try:
            self._owner.bridge().disarm(lease)
        except BridgeError as error:
            self._node.get_logger().info(str(error))

    async def _on_arm(self, request: Arm.Request, response: Arm.Response) -> Arm.Response:
        try:
            bridge = self._owner.ready()
            lengths = self._owner.confirmed_lengths_m()
            if request.confirmed_lengths_m:
                lengths = list(request.confirmed_lengths_m)
            if request.lifted_and_clear:
                await elsewhere(self._node, lambda: bridge.judge_homing(lengths), "judge homing")
                if self._owner.ready() is not bridge:
                    raise Refused("the bridge was opened anew meanwhile; arm again")
            holder = request.holder or "somebody"
            self._lease = response.lease = bridge.arm(holder, request.lifted_and_clear, lengths, request.prototype)
            self._verifier = Verifier(self._lease)
            response.session = bridge.snapshot().session
            response.success, response.message = True, "homing has begun; wait for ARMED in bridge/state"
        except BridgeError as error:
            response.message = str(error)
        return response

    def _on_disarm(self, request: Disarm.Request, response: Disarm.Response) -> Disarm.Response:
        try:
            self._owner.ready().disarm(request.lease)
            response.success, response.message = True, "DISARMED; the struts hold"
        except BridgeError as error:
            response.message = str(error)
        return response

    async def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            bridge = self._owner.ready()
            await elsewhere(self._node, bridge.reset, "reset")  # it may have to open the port again, which can take seconds
            response.success, response.message = True, "DISARMED; arm again"
        except BridgeError as error:
            response.message = str(error)
        return response

    def _on_set_face(self, request: SetFace.Request, response: SetFace.Response) -> SetFace.Response:
        try:
            source = request.source or FaceObservation.SOURCE_OPERATOR
            event = self._owner.bridge().observe_face(request.face, source, True, "set_face")
            response.success, response.message = True, f"event {event.seq}: the robot stands on {request.face or 'no face'}"
        except BridgeError as error:
            response.message = str(error)
        return response

    def _on_proof(self, message: LeaseProof) -> None:
        if self._verifier is None or not self._verifier.accepts(message.counter, message.proof.tobytes()):
            return
        try:
            self._owner.bridge().prove(self._lease)
        except BridgeError as error:
            self._node.get_logger().debug(str(error))
