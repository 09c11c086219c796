# SPDX-License-Identifier: Apache-2.0
"""The bridge's services, but for `stop` (see `port_process`), and the lease's proofs."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import Trigger

from hardware_bridge.errors import BridgeError, Refused
from hardware_bridge.safety.lease_proof import Verifier
from tensegrity_interfaces.msg import FaceObservation, LeaseProof
from tensegrity_interfaces.srv import Arm, Disarm, LogTrial, SetFace
from tensegrity_robot.bridge.recorded_topics import RecordedTopics
from tensegrity_robot.ros.background import elsewhere
from tensegrity_robot.ros.topics import LEASE, TRIAL

if TYPE_CHECKING:
    from tensegrity_robot.bridge.hardware_bridge_node import HardwareBridgeNode


class BridgeCalls:
    """Each service asks the bridge and puts its answer, or its refusal, into words."""

    def __init__(self, node: HardwareBridgeNode, topics: RecordedTopics):
        self._node = node
        self._topics = topics
        self._lease = ""
        self._verifier: Verifier | None = None
        self._serve(Disarm, "bridge/disarm", self._disarm)
        self._serve(SetFace, "set_face", self._set_face)
        # These wait: for the judge of shapes, the port, the disk. In the node's own group everything else would wait with them.
        self._serve(Arm, "bridge/arm", self._arm, ReentrantCallbackGroup())
        self._serve(Trigger, "reset", self._reset, ReentrantCallbackGroup())
        self._serve(LogTrial, "log_trial", self._log_trial, ReentrantCallbackGroup())
        LEASE.subscribe(node, self._on_proof)

    def _serve(self, kind: Any, name: str, act: Callable[[Any, Any], Awaitable[str]], group: Any = None) -> None:
        """Offer a service. `act` does what is asked and says so, or raises BridgeError."""

        async def answer(request: Any, response: Any) -> Any:
            try:
                response.message = await act(request, response)
                response.success = True
            except BridgeError as error:
                response.message = str(error)
            return response

        self._node.create_service(kind, name, answer, callback_group=group)

    def let_go(self) -> None:
        """Ends any motion, struts held, and takes the lease back."""
        lease, self._lease = self._lease, ""
        if not lease:
            return
        try:
            self._node.bridge().disarm(lease)
        except BridgeError as error:
            self._node.get_logger().info(str(error))

    async def _arm(self, request: Arm.Request, response: Arm.Response) -> str:
        bridge = self._node.ready()
        lengths = self._node.confirmed_lengths_m()
        if request.confirmed_lengths_m:
            lengths = list(request.confirmed_lengths_m)
        if request.lifted_and_clear:
            await elsewhere(self._node, lambda: bridge.judge_homing(lengths), "judge homing")
            if self._node.ready() is not bridge:
                raise Refused("the bridge was opened anew meanwhile; arm again")
        holder = request.holder or "somebody"
        self._lease = response.lease = bridge.arm(holder, request.lifted_and_clear, lengths, request.prototype)
        self._verifier = Verifier(self._lease)
        response.session = bridge.snapshot().session
        return "homing has begun; wait for ARMED in bridge/state"

    async def _disarm(self, request: Disarm.Request, _response: Disarm.Response) -> str:
        self._node.ready().disarm(request.lease)
        return "DISARMED; the struts hold"

    async def _reset(self, _request: Trigger.Request, _response: Trigger.Response) -> str:
        bridge = self._node.ready()
        await elsewhere(self._node, bridge.reset, "reset")  # it may have to open the port again, which can take seconds
        return "DISARMED; arm again"

    async def _set_face(self, request: SetFace.Request, _response: SetFace.Response) -> str:
        source = request.source or FaceObservation.SOURCE_OPERATOR
        event = self._node.bridge().observe_face(request.face, source, not request.moving, request.detail or "set_face")
        return f"event {event.seq}: the robot {'comes onto' if request.moving else 'stands on'} {request.face or 'no face'}"

    async def _log_trial(self, request: LogTrial.Request, _response: LogTrial.Response) -> str:
        """A line of a session's ledger, in the bag and on the disk before it is acknowledged."""
        log = self._topics.log
        if log is None or log.path is None:
            raise Refused("the bridge does not record: start it with record:=true")
        self._topics.publish(TRIAL, request.record)
        await elsewhere(self._node, log.sync, "sync the bag")
        return f"in {log.path}"

    def _on_proof(self, message: LeaseProof) -> None:
        if self._verifier is None or not self._verifier.accepts(message.counter, message.proof.tobytes()):
            return
        try:
            self._node.bridge().prove(self._lease)
        except BridgeError as error:
            self._node.get_logger().debug(str(error))
