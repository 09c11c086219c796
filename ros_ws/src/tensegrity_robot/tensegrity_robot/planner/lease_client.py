# SPDX-License-Identifier: Apache-2.0
"""The planner's lease of the bridge: asks for it, proves that its holder lives, and gives it back."""

import time
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from hardware_bridge.safety.lease_proof import Prover
from sim_core.printable import NAME_MOST, printable
from tensegrity_interfaces.msg import BridgeState, LeaseProof
from tensegrity_interfaces.srv import Arm, Disarm
from tensegrity_robot.ros.node_process import STEADY
from tensegrity_robot.ros.topics import LEASE

PERIOD_S = 0.1
FRESH_S = 1.5
CALL_TIMEOUT_S = 3.0
"""Longest wait for an answer of the bridge."""
JUDGING_LIMIT_S = 30.0
"""How much longer the bridge may take to answer `arm`: just started, it loads its judge of shapes first."""
CALL_POLL_S = 0.05


class Lease:
    """Serves `arm` and `disarm` by asking the bridge, and proves life on `bridge/lease` while the lease is held.

    Attributes:
        held: the lease; empty: none.
        session: the bridge's, that was armed.
    """

    def __init__(self, node: Node, changed: Callable[[], None], prototype: str = ""):
        """Begin to listen and to prove.

        Args:
            node: the planner's.
            changed: called when the lease was given back.
            prototype: instance of the only virtual prototype that may be armed; empty: whoever arms says, or any robot.
        """
        self._prototype = prototype
        self.held = self.session = ""
        self._prover = Prover("")
        self._node, self._changed = node, changed
        self._holder = ""
        self._seen = False
        self._disarming = False
        self._heard = 0.0
        self._proof = LEASE.publisher(node)
        self._bridge_arm = node.create_client(Arm, "bridge/arm")
        self._bridge_disarm = node.create_client(Disarm, "bridge/disarm")
        waiting = ReentrantCallbackGroup()  # for the bridge's answer; in the node's own group all else would wait with them
        node.create_service(Arm, "arm", self._on_arm, callback_group=waiting)
        node.create_service(Disarm, "disarm", self._on_disarm, callback_group=waiting)
        node.create_timer(PERIOD_S, self._prove_life, clock=STEADY)

    @property
    def unheard_s(self) -> float:
        """How long the bridge has not been heard."""
        return time.monotonic() - self._heard

    def follow(self, state: BridgeState) -> None:
        """The bridge's newest state: who holds the lease."""
        self._heard = time.monotonic()
        if self.held and state.lease_holder == self._holder:
            self._seen = True
        elif self.held and self._seen and not self._disarming:
            self.lose(f"the bridge is {state.state}" + (f", {state.reason}" if state.reason else ""))

    def lose(self, reason: str) -> None:
        """The lease, if there is one, is gone."""
        if self.held:
            self.held = ""
            self._node.get_logger().warning(f"the lease is lost: {reason}")

    async def _on_arm(self, request: Arm.Request, response: Arm.Response) -> Arm.Response:
        request.holder = printable(request.holder, NAME_MOST)  # as the bridge will show it
        if not request.holder:
            request.holder = self._node.get_fully_qualified_name().lstrip("/")
        if self._prototype and request.prototype not in ("", self._prototype):
            response.message = f"this planner is virtual prototype {self._prototype}'s, not {request.prototype}'s: nothing is armed"
            return response
        request.prototype = self._prototype or request.prototype
        answer = await self._call(self._bridge_arm, request, JUDGING_LIMIT_S)
        if answer is None:
            response.message = "the hardware bridge did not answer: start it (ros2 run tensegrity_robot hardware_bridge)"
            return response
        if answer.success:
            self.held, self.session, self._holder, self._seen = answer.lease, answer.session, request.holder, False
            self._prover = Prover(answer.lease)
            self._prove_life()
            self._node.get_logger().info(f"armed for {request.holder}; homing")
        else:
            self._node.get_logger().warning(f"arm refused: {answer.message}")
        return answer

    async def _on_disarm(self, request: Disarm.Request, response: Disarm.Response) -> Disarm.Response:
        request.lease = request.lease or self.held
        self._disarming = True
        answer = await self._call(self._bridge_disarm, request)
        self._disarming = False
        if answer is None:
            response.message = "the hardware bridge did not answer"
            return response
        if answer.success:
            self.held = ""
            self._changed()
        return answer

    async def _call(self, client: Any, request: Any, patience_s: float = 0.0) -> Any:
        """The answer of a service of the bridge, or None after `CALL_TIMEOUT_S`; once asked, after `patience_s` more.

        Asked as soon as the bridge itself is heard: a service also seems ready for seconds after its bridge was killed.
        """
        answered: Future = Future()
        until = time.monotonic() + CALL_TIMEOUT_S
        asked: list[Future] = []

        def attend() -> None:
            if answered.done():
                return
            if time.monotonic() > until + (patience_s if asked else 0.0):
                answered.set_result(None)
            elif not asked and client.service_is_ready() and self.unheard_s < FRESH_S:
                asked.append(client.call_async(request))
                asked[0].add_done_callback(lambda done: answered.done() or answered.set_result(done.result()))

        attend()
        timer = self._node.create_timer(CALL_POLL_S, attend, clock=STEADY)
        try:
            return await answered
        finally:
            self._node.destroy_timer(timer)
            for future in asked:
                client.remove_pending_request(future)

    def _prove_life(self) -> None:
        if self.held:
            counter, proof = self._prover.next()
            self._proof.publish(LeaseProof(stamp=self._node.get_clock().now().to_msg(), counter=counter, proof=list(proof)))
