# SPDX-License-Identifier: Apache-2.0
"""Every transition of the bridge's life, with a device that fails at the worst moment."""

import contextlib
import math
import os
import threading
import tty

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from std_srvs.srv import Trigger

from hardware_bridge.boards.lsc import FrameDecoder, decode_move
from tensegrity_interfaces.msg import BridgeState
from tensegrity_interfaces.srv import Arm
from tensegrity_lab.stack.processes import wait_until
from tensegrity_robot.ros.topics import BRIDGE_JOINT_STATES

pytestmark = pytest.mark.ros

MID = [0.234] * 6


class Board:
    """A board that listens on a pty and can be unplugged. To the bridge it is a real port, whose name stays."""

    def __init__(self, link):
        self.link = link
        self.moves = []
        self.plug()

    def plug(self):
        self._near, far = os.openpty()
        tty.setraw(far)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(far))
        self._far = far
        threading.Thread(target=self._listen, args=(self._near,), daemon=True).start()

    def _listen(self, near):
        decoder = FrameDecoder()
        try:
            while data := os.read(near, 4096):
                self.moves += [move for frame in decoder.feed(data) if (move := decode_move(frame)) is not None]
        except OSError:
            return

    def unplug(self):
        self.link.unlink(missing_ok=True)
        os.close(self._far)
        os.close(self._near)


class Life:
    """The lifecycle calls of a bridge that does not start itself."""

    def __init__(self, processes, operator, board, tmp_path):
        calibration = tmp_path / "calibration.yaml"
        calibration.write_text(OWN_CALIBRATION)
        self.operator, self.board = operator, board
        self.calibration = calibration
        self.process = processes.node(
            "hardware_bridge", autostart=False, port=board.link, calibration=calibration, silent_board=True
        )
        self._change = operator.node.create_client(ChangeState, "hardware_bridge/change_state")
        self._get = operator.node.create_client(GetState, "hardware_bridge/get_state")
        wait_until(lambda: self._change.service_is_ready() and self._get.service_is_ready(), 30.0, "lifecycle services")

    def go(self, transition):
        request = ChangeState.Request()
        request.transition.id = transition
        return self.operator.result(self._change.call_async(request), "change_state").success

    @property
    def state(self):
        return self.operator.result(self._get.call_async(GetState.Request()), "get_state").current_state.id

    def arm(self, confirmed=MID):
        return self.operator.call("bridge/arm", Arm.Request(lifted_and_clear=True, confirmed_lengths_m=confirmed))

    def active(self):
        assert self.go(Transition.TRANSITION_CONFIGURE)
        assert self.go(Transition.TRANSITION_ACTIVATE)

    def unplugged_while_homing(self):
        """Active, with the device gone and the fault noticed."""
        self.active()
        assert self.arm().success
        wait_until(lambda: self.board.moves, 10.0, "the first strut under power")
        self.board.unplug()
        wait_until(lambda: self.operator.bridge.state == BridgeState.FAULT, 10.0, "the fault")


@pytest.fixture
def board(tmp_path):
    board = Board(tmp_path / "board")
    yield board
    with contextlib.suppress(OSError):
        board.unplug()


@pytest.fixture
def life(processes, operator, board, tmp_path):
    return Life(processes, operator, board, tmp_path)


def test_configure_fails_without_a_device_and_succeeds_once_it_is_there(life):
    life.board.unplug()
    assert not life.go(Transition.TRANSITION_CONFIGURE)
    assert life.state == State.PRIMARY_STATE_UNCONFIGURED
    life.process.says("does not exist; start the virtual prototype, or power the robot")
    life.board.plug()
    assert life.go(Transition.TRANSITION_CONFIGURE)
    assert life.state == State.PRIMARY_STATE_INACTIVE
    assert not life.board.moves


@pytest.mark.slow
def test_a_device_lost_while_inactive_is_a_fault_and_activation_does_not_arm_it(life):
    assert life.go(Transition.TRANSITION_CONFIGURE)
    life.board.unplug()
    wait_until(lambda: life.operator.bridge is not None and life.operator.bridge.state == BridgeState.FAULT, 10.0, "the fault")
    assert life.go(Transition.TRANSITION_ACTIVATE)
    refused = life.arm()
    assert not refused.success
    assert "then call reset" in refused.message


@pytest.mark.slow
def test_deactivate_with_a_lost_device_goes_through_and_the_fault_stays(life):
    life.unplugged_while_homing()
    assert life.go(Transition.TRANSITION_DEACTIVATE)
    assert life.state == State.PRIMARY_STATE_INACTIVE
    assert life.operator.bridge.state == BridgeState.FAULT
    assert life.go(Transition.TRANSITION_ACTIVATE)
    assert not life.arm().success


def test_a_fault_outlives_cleanup_and_only_reset_leaves_it(life):
    life.unplugged_while_homing()
    reason = life.operator.bridge.reason
    assert life.go(Transition.TRANSITION_DEACTIVATE)
    assert life.go(Transition.TRANSITION_CLEANUP)
    assert life.state == State.PRIMARY_STATE_UNCONFIGURED
    assert not life.go(Transition.TRANSITION_CONFIGURE), "the device is gone"
    life.board.plug()
    life.active()
    wait_until(lambda: life.operator.bridge.state == BridgeState.FAULT, 10.0, "the fault of before")
    assert life.operator.bridge.reason == reason
    refused = life.arm()
    assert not refused.success
    assert reason in refused.message
    assert life.operator.call("reset", Trigger.Request()).success
    assert life.arm().success


@pytest.mark.slow
def test_a_calibration_that_is_swapped_while_the_bridge_lives_knows_no_positions(life):
    """A4: cleanup and configure take the new file; what was sent with the old one says nothing of it."""
    for confirmed in (MID, []):  # the same file: where it was left is known
        life.active()
        count = len(life.board.moves)
        assert life.arm(confirmed).success
        wait_until(lambda count=count: len(life.board.moves) > count, 10.0, "a strut under power")
        assert life.go(Transition.TRANSITION_DEACTIVATE)
        assert life.go(Transition.TRANSITION_CLEANUP)
    life.calibration.write_text(OWN_CALIBRATION.replace("trim_us: 0", "trim_us: 10"))
    life.active()
    count = len(life.board.moves)
    refused = life.arm([])
    assert not refused.success
    assert "S1: nobody knows its length: the last pulses are of robot 'of the tests' with calibration" in refused.message
    assert len(life.board.moves) == count
    assert life.arm().success, "the operator has looked"


@pytest.mark.slow
def test_shutdown_with_a_lost_device_ends_the_process_well(life):
    life.unplugged_while_homing()
    life.go(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert life.process.ends() == 0


def test_deactivate_in_motion_holds_every_strut_and_takes_the_lease(life):
    life.active()
    assert life.arm().success
    wait_until(lambda: len(life.board.moves) >= 3, 10.0, "three struts under power")
    assert life.go(Transition.TRANSITION_DEACTIVATE)
    wait_until(lambda: life.operator.bridge.state == BridgeState.DISARMED, 10.0, "DISARMED")
    assert not life.operator.bridge.lease_holder
    count = len(life.board.moves)
    seq = life.operator.sent[-1].seq
    wait_until(lambda: life.operator.sent[-1].seq > seq + 10, 10.0, "ten heartbeats")
    assert len(life.board.moves) == count, "nothing moves any more"
    assert "inactive" in life.arm().message


def test_a_length_that_nobody_knows_is_no_number(life):
    seen = []
    BRIDGE_JOINT_STATES.subscribe(life.operator.node, seen.append)
    life.active()
    wait_until(lambda: seen, 10.0, "joint states")
    assert all(math.isnan(length) for length in seen[0].position)
    assert life.arm().success
    wait_until(lambda: not any(math.isnan(length) for length in seen[-1].position), 30.0, "lengths, once they are confirmed")


@pytest.mark.slow
def test_diagnostics_tell_what_a_person_needs(life):
    seen = {}

    def keep(message):
        seen.update({status.name: status for status in message.status})

    life.operator.node.create_subscription(DiagnosticArray, "/diagnostics", keep, 10)
    life.active()
    names = {f"hardware_bridge: {what}" for what in ("link", "supervisor", "frames", "duty", "battery", "board", "log")}
    wait_until(lambda: names <= set(seen), 10.0, f"diagnostics of {names}")
    link = {pair.key: pair.value for pair in seen["hardware_bridge: link"].values}
    assert {f"latency of {of}, {part} [ms]" for of in ("writes", "replies") for part in ("median", "95 %", "99 %")} <= set(link)
    assert {"write errors", "times opened again", "questions asked again", "bad replies"} <= set(link)
    assert "free space [MB]" in {pair.key for pair in seen["hardware_bridge: log"].values}
    assert {pair.key for pair in seen["hardware_bridge: duty"].values} == {"duty left [s]", "duty budget [s]"}
    life.board.unplug()
    wait_until(lambda: seen["hardware_bridge: link"].message.startswith("lost"), 10.0, "a lost link in the diagnostics")


OWN_CALIBRATION = "robot: of the tests\nmid_stroke_length_m: 0.234\nstruts:\n" + "".join(
    f"  S{n}: {{channel: {n}, pulse_at_zero_us: 1500, us_per_mm: 10.0, direction: 1, trim_us: 0, "
    "stroke_mm: [-49, 49], pulse_us: [1000, 2000]}\n"
    for n in range(1, 7)
)
