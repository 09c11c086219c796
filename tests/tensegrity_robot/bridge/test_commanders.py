# SPDX-License-Identifier: Apache-2.0
"""One commander at a time, and none of them is a bag."""

import importlib
from pathlib import Path

import pytest

from tensegrity_interfaces.msg import BridgeState, LeaseProof
from tensegrity_interfaces.srv import Arm
from tensegrity_lab.stack.processes import wait_until
from tests.stack_operator import Operator

pytestmark = pytest.mark.ros

MID = [0.234] * 6
EXAMPLE = Path(__file__).parents[3] / "bags" / "example"


@pytest.fixture
def armed(processes, operator):
    """The operator, holding the lease of an armed bridge on the virtual prototype."""
    processes.node("virtual_prototype", "--time-scale", "8").says("ready")
    processes.node("hardware_bridge", record=False).says("DISARMED, nothing moves")
    answer = operator.call("bridge/arm", Arm.Request(holder="first", lifted_and_clear=True, confirmed_lengths_m=MID))
    assert answer.success, answer.message
    operator.lease = answer.lease
    wait_until(lambda: operator.bridge is not None and operator.bridge.state == BridgeState.ARMED, 30.0, "ARMED")
    return operator


@pytest.fixture
def second(domain):
    operator = Operator(domain=domain)
    yield operator
    operator.close()


def message_type(name):
    """The class of `package/msg/Name`."""
    package, _, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), kind)


def frames(operator):
    return [message for message in operator.sent if not message.heartbeat]


@pytest.mark.slow
def test_after_the_first_has_gone_silent_the_second_may_arm(armed, second):
    armed.lease = ""
    wait_until(lambda: armed.bridge.state == BridgeState.HOLD, 10.0, "HOLD")
    answer = second.call("bridge/arm", Arm.Request(holder="second", lifted_and_clear=True))
    assert answer.success, answer.message


@pytest.mark.slow
def test_playing_a_bag_beside_an_armed_bridge_moves_nothing(armed, second):
    from mcap.reader import make_reader

    publishers, played = {}, 0
    with (EXAMPLE / "example.mcap").open("rb") as file:
        reader = make_reader(file)
        for channel in reader.get_summary().channels.values():
            schema = reader.get_summary().schemas[channel.schema_id]
            publishers[channel.topic] = second.node.create_publisher(message_type(schema.name), channel.topic, 100)
        assert publishers
        assert all(topic.startswith("/recorded/") for topic in publishers)
        before, seq = len(frames(armed)), armed.sent[-1].seq
        for _, channel, message in reader.iter_messages():
            publishers[channel.topic].publish(message.data)
            played += 1
    assert played > 1000
    wait_until(lambda: armed.sent[-1].seq > seq + 40, 20.0, "the bridge's heartbeats")
    assert len(frames(armed)) == before
    assert armed.bridge.state == BridgeState.ARMED
    assert armed.bridge.lease_holder == "first"
    for publisher in publishers.values():  # nobody but viewers would even listen
        assert publisher.get_subscription_count() == 0


def test_who_hears_proofs_can_neither_go_on_nor_keep_a_silent_holder_alive(armed, second):
    proofs = second.node.create_publisher(LeaseProof, "bridge/lease", 10)
    heard = []
    second.node.create_subscription(LeaseProof, "bridge/lease", heard.append, 10)
    wait_until(lambda: heard and proofs.get_subscription_count() > 1, 20.0, "the holder's proofs, and the bridge's ear")
    fields = LeaseProof.get_fields_and_field_types()
    assert set(fields) == {"stamp", "counter", "proof"}  # the lease itself is on no topic

    def copy():
        for newest in heard[-3:]:
            for counter in (newest.counter, newest.counter + 1, newest.counter + 1000):
                proofs.publish(LeaseProof(stamp=newest.stamp, counter=counter, proof=newest.proof))

    timer = second.node.create_timer(0.05, copy)
    armed.lease = ""
    wait_until(lambda: armed.bridge.state == BridgeState.HOLD, 10.0, "HOLD")
    assert "first was silent" in armed.bridge.reason
    timer.cancel()
