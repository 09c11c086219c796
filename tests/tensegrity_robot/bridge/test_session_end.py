# SPDX-License-Identifier: Apache-2.0
"""A signal in mid-roll: the struts are held, the bag is whole, and the twin can be had back from it bit for bit."""

import os
import signal
import threading
import tty
from collections import Counter
from importlib.resources import files
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hardware_bridge.boards.lsc import FrameDecoder, Move, decode_move
from hardware_bridge.recording.bag_on_disk import file_of, journal_of
from hardware_bridge.recording.bag_reader import Session, read_session
from sim_core.dynamics.model import build_model
from sim_core.structure.parameters import load_prototype
from sim_core.twin.follower import Follower, Observed, Sent
from tensegrity_interfaces.srv import Arm
from tensegrity_lab.stack.processes import wait_until

pytestmark = [pytest.mark.ros, pytest.mark.slow]
END_OF_LISTENING = b"end of listening"


@pytest.fixture(scope="module")
def interrupted(module_processes, domain):
    """Bags of sessions that were ended in mid-roll, by how."""
    from tests.stack_operator import Operator

    operator = Operator(domain=domain)
    bags: dict[str, tuple[Path, int, str]] = {}
    try:
        module_processes.node("virtual_prototype", "--time-scale", "8", "--seed", "3").says("ready")
        module_processes.node("twin")
        module_processes.node("gait_planner")
        for how, signals in {
            "SIGINT": (signal.SIGINT,),
            "SIGTERM": (signal.SIGTERM,),
            "SIGINT twice": (signal.SIGINT, signal.SIGINT),
        }.items():
            operator.bridge = operator.observed = None
            operator.sent.clear()
            bridge = module_processes.node("hardware_bridge")
            bridge.says("DISARMED, nothing moves")
            operator.wait_for_stack()
            wait_until(lambda: operator.observed.settled and operator.observed.face, 30.0, "rest on a face")
            operator.arm()
            goal = operator.begin_roll(_neighbour(operator.observed.face))
            assert goal.accepted
            operator.moves(goal, 0.01)
            bag = Path(operator.bridge.bag)
            for number in signals:
                bridge.signal(number)
            bags[how] = (bag, bridge.ends(10.0), bridge.output)
            operator.end(goal)
    finally:
        operator.close()
        module_processes.kill()
    return bags


def _neighbour(face: str) -> str:
    from sim_core.structure.topology import NEIGHBOURS

    return NEIGHBOURS[face][0]


HOW = pytest.mark.parametrize("how", ["SIGINT", "SIGTERM", "SIGINT twice"])


@HOW
def test_the_bridge_ends_well(interrupted, how):
    bag, code, output = interrupted[how]
    assert code == 0, output
    assert "Traceback" not in output
    assert file_of(bag).is_file()
    assert not journal_of(bag).exists()


@HOW
def test_the_last_frame_holds_the_struts_where_the_board_is(interrupted, how):
    session = read_session(interrupted[how][0])
    writes = [message for message in session.of("bridge/struts_sent") if not message.heartbeat]
    last, before, earlier = writes[-1], writes[-2], writes[-3]
    # a board that was told two frames in one turn has not come to the first one yet
    in_turn = before.robot_time_ns - earlier.robot_time_ns >= 45_000_000
    lately = writes[-3:-1] if in_turn else writes[-4:-1]
    for held, *sent_lately in zip(last.pulse_us, *(write.pulse_us for write in lately), strict=True):
        sent = sent_lately[-1]
        assert min(sent_lately) - 1 <= held <= max(sent_lately) + 1
        assert abs(held - sent) <= 12, "a frame at the speed limit, and a pulse"
    assert last.duration_ms == before.duration_ms == 55
    # 10 mm off neutral had been sent; the board, where it is held, is up to one frame at the speed limit behind
    assert max(abs(length - 0.234) for length in last.length_m) > 0.0085
    (frame,) = FrameDecoder().feed(bytes(last.frame))
    move = decode_move(frame)
    assert move is not None
    assert sorted(move.pulses_us) == sorted(last.pulse_us)
    assert [m.state for m in session.of("bridge/state")][-1] == "DISARMED"


@HOW
def test_the_bag_is_read_by_readers_that_are_not_ours(interrupted, how):
    bag, _, _ = interrupted[how]
    store = get_typestore(Stores.ROS2_JAZZY)
    by_rosbags: Counter[str] = Counter()
    with Reader(bag) as reader:
        for connection in reader.connections:
            assert connection.topic.startswith("/recorded/")
            own = get_types_from_msg(connection.msgdef.data, connection.msgtype)
            store.register({name: fields for name, fields in own.items() if name not in store.fielddefs})
        for connection, _, data in reader.messages():
            store.deserialize_cdr(data, connection.msgtype)
            by_rosbags[connection.topic] += 1
    with file_of(bag).open("rb") as stream:
        decoded = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        by_mcap = Counter(item.channel.topic for item in decoded)
    assert by_rosbags == by_mcap
    recorded = {topic.removeprefix("/recorded/") for topic in by_mcap}
    assert recorded == {
        "bridge/asked",
        "bridge/struts_sent",
        "bridge/face",
        "bridge/state",
        "bridge/joint_states",
        "bridge/observed_joints",
        "rehearsal",
        "diagnostics",
        "twin/state",
        "twin/face",
        "twin/joint_states",
        "twin/pose",
        "twin/markers",
        "tf",
        "robot_description",
        "keep_in",
    }


@HOW
def test_the_bag_holds_every_event_and_what_made_it(interrupted, how):
    session = read_session(interrupted[how][0])
    numbers = sorted(message.seq for topic in ("bridge/struts_sent", "bridge/face") for message in session.of(topic))
    assert numbers == list(range(1, len(numbers) + 1))
    assert set(session.attachments) == {"prototype.yaml", "calibration.yaml", "library.yaml"}
    assert session.metadata["session"]["time_scale"] == "8"
    assert session.metadata["versions"]["python"]
    (asked,) = session.of("bridge/asked")
    assert asked.joint_names == [f"S{number}" for number in range(1, 7)]


@HOW
def test_a_fresh_twin_fed_with_the_bag_has_the_same_bits(interrupted, how):
    session = read_session(interrupted[how][0])
    states = [message for message in session.of("twin/state") if message.last_seq > 0]
    first_seq = states[-1].first_seq
    states = [message for message in states if message.first_seq == first_seq]
    began_on = states[0].detail.split(",")[0].removeprefix("began on ")
    follower = Follower(build_model(load_prototype()), began_on)
    digests = {}
    for event in _events(session):
        if event.seq >= first_seq:
            follower.apply(event)
            digests[event.seq] = (follower.digest(), follower.step)
    assert len(states) > 2
    assert all((state.digest, state.step) == digests[state.last_seq] for state in states)
    before = [e for e in _events(session) if isinstance(e, Observed) and e.seq < first_seq and e.face]
    assert not before or before[-1].face == began_on


def _events(session: Session) -> list[Sent | Observed]:
    events: list[Sent | Observed] = [
        Sent(m.seq, m.robot_time_ns, tuple(float(length) for length in m.length_m)) for m in session.of("bridge/struts_sent")
    ]
    events += [Observed(m.seq, m.robot_time_ns, m.face or None, m.settled) for m in session.of("bridge/face")]
    return sorted(events, key=lambda event: event.seq)


class Board:
    """A pty of ours, so to the bridge a real port; keeps the moves that were written to it."""

    def __init__(self) -> None:
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        self.port = os.ttyname(self._far)
        self.moves: list[Move] = []
        self._decoder = FrameDecoder()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while data := os.read(self._near, 256):
            if data == END_OF_LISTENING:
                return
            self.moves += [move for frame in self._decoder.feed(data) if (move := decode_move(frame)) is not None]

    def close(self) -> None:
        os.write(self._far, END_OF_LISTENING)
        self._thread.join(5.0)
        os.close(self._near)
        os.close(self._far)


def test_on_a_real_port_the_last_bytes_hold_the_struts(processes, operator):
    board = Board()
    try:
        own = processes.folder / "own.yaml"
        default = (files("hardware_bridge") / "data" / "calibration_default.yaml").read_text(encoding="utf-8")
        own.write_text(
            "robot: of the tests\n" + default.replace("stroke_mm: [-50, 50]", "stroke_mm: [-49, 49]"), encoding="utf-8"
        )  # measured, to all appearance
        bridge = processes.node(
            "hardware_bridge", port=board.port, homing_speed_m_s=0.02, calibration=own, silent_board=True, rested_s=600.0
        )
        bridge.says("a real port")
        wait_until(lambda: operator.bridge is not None and operator.bridge.link_ok, 20.0, "the link")
        assert not operator.bridge.virtual_port
        unknown = operator.call("bridge/arm", Arm.Request(holder="test", lifted_and_clear=True))
        assert "S1: nobody knows its length" in unknown.message
        assert board.moves == []
        known = Arm.Request(holder="test", lifted_and_clear=True, confirmed_lengths_m=[0.234] * 6)
        operator.lease = operator.call("bridge/arm", known).lease
        operator.sees("ARMED")
        motion = operator.begin_motion((20.0, [0.254, *[0.234] * 5]), lease=operator.lease)
        operator.moves(motion, 0.0005)
        bridge.signal(signal.SIGTERM)
        assert bridge.ends(10.0) == 0, bridge.output
    finally:
        board.close()
    earlier, before, last = board.moves[-3:]
    for held, sent, was in zip(last.pulses_us, before.pulses_us, earlier.pulses_us, strict=True):
        assert min(sent, was) - 1 <= held <= max(sent, was) + 1, "where the board is"
    assert last.duration_ms == before.duration_ms
    assert max(last.pulses_us) < 1500 + 20 * 10
