# SPDX-License-Identifier: Apache-2.0
"""A bridge in a process of its own: same calls, same errors, and whichever of the two processes dies, the struts are held."""

import os
import signal
import sys
import threading

import pytest

from hardware_bridge.boards.lsc import Lsc
from hardware_bridge.driver.events import SentEvent
from hardware_bridge.driver.remote_bridge import HostProcess
from hardware_bridge.errors import LimitError, PortMissing, StateError
from hardware_bridge.link.transport import SerialTransport
from hardware_bridge.safety.supervisor_messages import Mode
from hardware_bridge.safety.trajectory import Trajectory
from tests.hardware_bridge.helpers import MID, MID_M, wait_for

HOST = (
    sys.executable,
    "-c",
    "import os, sys; from multiprocessing.connection import Connection; from hardware_bridge.driver.bridge_host import BridgeHost; "
    "BridgeHost(Connection(int(sys.argv[-1]))).serve(); os._exit(0)",
)
AWAY = Trajectory([6.0], [[MID_M + 0.02, *MID[1:]]])


class Remote:
    """A host process, a bridge in it on a wire that answers, and what it told."""

    def __init__(self, wire, rules, folder):
        self.wire, self.rules, self.folder = wire, rules, folder
        self.ends, self.events, self.shapes = [], [], 0
        self.host = HostProcess(HOST, self.ends.append)
        self.bridge = None

    def judge(self, lengths_m):
        self.shapes += 1
        return "too long" if max(lengths_m) > MID_M + 0.03 else None

    def open(self, **options):
        from dataclasses import replace

        rules = replace(self.rules, shape_check=self.judge)
        self.bridge = self.host.open(
            options.pop("port", self.wire.port),
            rules,
            board=Lsc(),
            state_dir=self.folder,
            silent_board=True,
            rested_s=600.0,
            on_sent=self.events.append,
            on_face=self.events.append,
            on_state=self.events.append,
            **options,
        )
        return self.bridge

    def armed(self):
        bridge = self.open()
        lease = bridge.arm("test", True, MID)
        proving = threading.Event()

        def prove():
            while not proving.wait(0.1):
                bridge.prove(lease)
                self.wire.listen()

        threading.Thread(target=prove, daemon=True).start()
        self.prove_no_more = proving.set
        wait_for(lambda: bridge.snapshot().mode is Mode.ARMED, "ARMED")
        return bridge, lease


@pytest.fixture
def remote(wire, rules, tmp_path):
    wire.answers = True
    remote = Remote(wire, rules, tmp_path)
    yield remote
    if hasattr(remote, "prove_no_more"):
        remote.prove_no_more()
    remote.host.close()


def test_a_motion_goes_through_with_progress_and_events_in_order(remote):
    bridge, lease = remote.armed()
    motion = bridge.execute(Trajectory([0.5], [[MID_M + 0.005, *MID[1:]]]), lease)
    assert motion.wait(20.0)
    assert motion.result().success
    assert motion.progress().fraction == 1.0
    assert bridge.snapshot().lengths_m[0] == pytest.approx(MID_M + 0.005, abs=1e-4)
    assert remote.shapes > 0  # judged at this end
    sent = [event for event in remote.events if isinstance(event, SentEvent)]
    assert [event.seq for event in sent] == sorted(event.seq for event in sent)
    assert {event.session for event in sent} == {bridge.snapshot().session}
    # a snapshot comes after its frame
    wait_for(lambda: len(remote.wire.moves()) == bridge.snapshot().frames_sent, "a snapshot that counts the last frame")


def test_errors_come_over_with_their_data(remote):
    bridge, lease = remote.armed()
    with pytest.raises(LimitError) as refused:
        bridge.execute(Trajectory([60.0], [[MID_M + 0.05, *MID[1:]]]), lease)
    assert (refused.value.strut, refused.value.quantity) == ("S1", "stroke")
    with pytest.raises(PortMissing):
        remote.open(port="/dev/nothing-of-that-name")


def test_every_opening_is_another_session(remote):
    first = remote.open().snapshot().session
    remote.bridge.close()
    assert remote.open().snapshot().session not in ("", first)


def test_when_this_end_is_gone_the_struts_are_held_and_the_port_is_free(remote):
    bridge, lease = remote.armed()
    bridge.execute(AWAY, lease)
    before = len(remote.wire.moves())
    wait_for(lambda: len(remote.wire.moves()) > before + 3, "motion")
    assert remote.host.close() == 0
    remote.prove_no_more()
    *_, moved, held = remote.wire.moves()
    assert held.pulses_us[0] <= moved.pulses_us[0]  # the last one holds: it goes nowhere new
    transport = SerialTransport(remote.wire.port)
    transport.open()
    transport.close()
    assert not remote.ends  # it did not end by itself


def test_a_host_that_is_killed_is_told_and_every_call_ends(remote):
    bridge, lease = remote.armed()
    motion = bridge.execute(AWAY, lease)
    os.kill(remote.host.pid, signal.SIGKILL)
    wait_for(lambda: remote.ends == ["signal 9"], "the end of the host")
    with pytest.raises(StateError, match="signal 9"):
        bridge.disarm(lease)
    assert motion.result() is None  # nobody can say how it ended


def test_stop_bars_frames_at_once(remote):
    bridge, lease = remote.armed()
    motion = bridge.execute(AWAY, lease)
    wait_for(lambda: motion.progress().fraction > 0.02, "motion")
    bridge.stop()
    wait_for(lambda: bridge.snapshot().mode is Mode.FAULT, "FAULT")
    assert motion.wait(5.0)
    sent = len(remote.wire.moves())
    heard = len(remote.events)
    wait_for(lambda: len(remote.events) > heard + 5, "heartbeats")
    assert len(remote.wire.moves()) == sent
