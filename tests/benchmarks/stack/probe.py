# SPDX-License-Identifier: Apache-2.0
"""The stack's client, with when it heard what."""

import struct
import time
from typing import Self

from diagnostic_msgs.msg import DiagnosticArray

from tensegrity_interfaces.msg import TwinState
from tensegrity_lab.stack.processes import START_LIMIT_S, Stack
from tensegrity_robot.ros import qos
from tensegrity_robot.ros.topics import TWIN_JOINT_STATES
from tests.stack_operator import Operator


class Probe(Operator):
    """A client of a stack that is measured.

    Attributes:
        ticks: (stamp in ns, when heard on the steady clock in ns) of every twin/joint_states.
        states: when each twin/state was heard, on the steady clock in ns.
        log: (when heard in s, messages, most waiting) of the bag, newest diagnostics; None before.
    """

    def __init__(self, stack: Stack):
        self.ticks: list[tuple[int, int]] = []
        self.states: list[int] = []
        self.log: tuple[float, int, int] | None = None
        super().__init__(stack, name="sixstrut_bench")
        TWIN_JOINT_STATES.subscribe(self.node, self._on_tick, qos.STREAM, raw=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *details: object) -> None:
        self.close()

    def _on_tick(self, data: bytes) -> None:
        seconds, nanoseconds = struct.unpack_from("<iI", data, 4)  # the header's stamp, behind the encapsulation
        self.ticks.append((seconds * 1_000_000_000 + nanoseconds, time.monotonic_ns()))

    def _on_twin(self, state: TwinState) -> None:
        self.states.append(time.monotonic_ns())
        super()._on_twin(state)

    @property
    def writes(self) -> list[tuple[int, bool]]:
        """(stamp in ns, heartbeat) of every bridge/struts_sent."""
        return [(self.stamp_ns(sent), sent.heartbeat) for sent in self.sent]

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        super()._on_diagnostics(message)
        if "most waiting" in (values := self.diagnosis("log")):
            self.log = (time.monotonic(), int(values["messages"]), int(values["most waiting"]))

    def meet_stack(self) -> None:
        """Until the bridge's port is open and the twin follows its events."""
        self.wait_for_bridge(observer=False)
        self.wait(lambda: self.bridge.bag, "the bridge's bag", START_LIMIT_S)
        self.wait(lambda: self.twin is not None and self.twin.last_seq > 0, "a twin that follows", START_LIMIT_S)
        self.wait(lambda: self.ticks, "the twin's joint states", START_LIMIT_S)
