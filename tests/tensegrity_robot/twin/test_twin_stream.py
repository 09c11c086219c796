# SPDX-License-Identifier: Apache-2.0
"""A real twin and numbers that nobody would send: it goes on following, and it ends when it is told to."""

import signal
import threading

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from tensegrity_interfaces.msg import StrutsSent, TwinState
from tensegrity_lab.stack.processes import wait_until
from tensegrity_robot.ros import qos

pytestmark = pytest.mark.ros
BEAT_S = 0.05


class Bridge:
    """What a bridge tells a twin: heartbeats of a session, and whatever else a test sends."""

    def __init__(self, domain: int):
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node("a_bridge", context=self._context)
        self._publisher = self.node.create_publisher(StrutsSent, "bridge/struts_sent", qos.STREAM)
        self.states: list[TwinState] = []
        self.node.create_subscription(TwinState, "twin/state", self.states.append, qos.STATES)
        self.node.create_timer(BEAT_S, self._beat)
        self.seq, self.beating, self.session = 0, True, "live"
        self._lock = threading.Lock()
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._executor.spin)
        self._thread.start()

    def _beat(self) -> None:
        with self._lock:
            if self.beating:
                self.seq += 1
                self.send(self.seq, self.seq * round(BEAT_S * 1e9))

    def send(self, seq: int, robot_time_ns: int, lengths_m=(0.234,) * 6, session: str | None = None) -> None:
        message = StrutsSent(seq=seq, robot_time_ns=robot_time_ns, length_m=list(lengths_m))
        message.header.stamp = self.node.get_clock().now().to_msg()
        message.session = self.session if session is None else session
        self._publisher.publish(message)

    def forge(self, **what) -> None:
        """Between two heartbeats, with the next one's number if none is given."""
        with self._lock:
            self.send(**{"seq": self.seq + 1, "robot_time_ns": (self.seq + 1) * round(BEAT_S * 1e9), **what})

    @property
    def last(self) -> TwinState | None:
        return self.states[-1] if self.states else None

    def follows(self, since_seq: int) -> bool:
        return self.last is not None and self.last.last_seq > since_seq

    def close(self) -> None:
        self._executor.shutdown()
        self._thread.join()
        self._context.try_shutdown()


@pytest.fixture
def bridge(domain):
    bridge = Bridge(domain)
    yield bridge
    bridge.close()


@pytest.mark.slow
def test_a_twin_follows_its_bridge_through_forged_events_and_ends_when_told(processes, bridge):
    twin = processes.node("twin")
    wait_until(lambda: bridge.follows(0), 30.0, "a twin that follows")
    assert bridge.last.session == "live"
    bridge.forge(robot_time_ns=2**62, session="")
    bridge.forge(robot_time_ns=2**62)
    bridge.forge(seq=2**64 - 1)
    bridge.forge(lengths_m=(1e300,) * 6)
    bridge.forge(lengths_m=(float("nan"),) * 6)
    bridge.forge(session="a stranger")
    wait_until(lambda: bridge.follows(bridge.states[0].last_seq + 40), 30.0, "a twin that goes on")
    wait_until(lambda: "5 impossible events refused, 1 events of other sessions" in bridge.last.detail, 10.0, "the counts")
    assert "6 impossible" not in bridge.last.detail
    assert bridge.last.robot_time_ns < 1000 * 10**9
    assert twin.output.count("is refused:") == twin.output.count("are ignored:") == 1
    bridge.beating = False
    bridge.forge(seq=bridge.seq + 1, robot_time_ns=bridge.seq * round(BEAT_S * 1e9) + 599 * 10**9)  # a pause to be stepped through
    twin.signal(signal.SIGINT)
    assert twin.ends() == 0


@pytest.mark.slow
def test_a_twin_that_slept_while_its_bridge_went_on_catches_up(processes, bridge):
    twin = processes.node("twin")
    wait_until(lambda: bridge.follows(0), 30.0, "a twin that follows")
    first = bridge.last.first_seq
    twin.signal(signal.SIGSTOP)
    with bridge._lock:
        bridge.seq += 12_000 - bridge.seq % 100  # ten minutes of heartbeats that nobody heard
    twin.signal(signal.SIGCONT)
    wait_until(lambda: bridge.follows(12_000), 60.0, "a twin that has caught up")
    assert bridge.last.first_seq == first
    assert "impossible" not in bridge.last.detail
