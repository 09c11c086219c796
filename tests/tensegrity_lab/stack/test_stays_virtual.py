# SPDX-License-Identifier: Apache-2.0
"""What is virtual stays virtual: beside a real robot's bridge, in the domain that the shell exports, it never reaches the board."""

import os
import re
import select
import signal
import threading
import tty
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

import pytest

from hardware_bridge.boards.lsc import Lsc
from hardware_bridge.virtual_prototype.boards.lsc import EmulatedLsc
from tensegrity_interfaces.msg import BridgeState
from tensegrity_lab.stack.processes import Process, wait_until
from tests.isolated_stack import IsolatedStack
from tests.stack_operator import Operator
from tests.tensegrity_lab.terminal import ENTER, Terminal
from tests.tensegrity_robot.conftest import compiled, domain

__all__ = ["compiled", "domain"]
pytestmark = [pytest.mark.ros, pytest.mark.timeout(400)]
QUERY = Lsc().encode_query(()).data
LIMIT_S = 120.0


class RealBoard:
    """An LSC board at a pty that has nothing to do with any prototype; it answers, so that it could be armed.

    Attributes:
        got: every byte that was written to it.
    """

    def __init__(self) -> None:
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        self.port = os.ttyname(self._far)
        self.got = bytearray()
        self._board = EmulatedLsc(9600)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while not self._ended.is_set():
            if select.select([self._near], [], [], 0.1)[0]:
                data = os.read(self._near, 256)
                self.got += data
                os.write(self._near, b"".join(self._board.take(byte, 0.0) for byte in data))

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        os.close(self._near)
        os.close(self._far)


class Lab:
    """A real robot's bridge, running in the domain that the shell of everybody here exports.

    Attributes:
        domain: that one. folder: for what is started beside it.
    """

    def __init__(self, folder: Path, domain: int):
        self.domain, self.folder = domain, folder
        self.board = RealBoard()
        own = folder / "own.yaml"
        default = (files("hardware_bridge") / "data" / "calibration_default.yaml").read_text(encoding="utf-8")
        own.write_text(default.replace("stroke_mm: [-50, 50]", "stroke_mm: [-49, 49]"), encoding="utf-8")  # as if measured
        self._robot = IsolatedStack(folder / "robot", domain)
        self._robot.node("hardware_bridge", port=self.board.port, calibration=own).says("a real port")
        self._operator = Operator(domain=domain)
        wait_until(lambda: self.bridge is not None and self.bridge.link_ok, 30.0, "the real robot's bridge")
        self.beside = IsolatedStack(folder, domain)

    @property
    def bridge(self) -> BridgeState:
        """What the real robot's bridge says of itself, as heard in its domain."""
        return self._operator.bridge

    def was_left_alone(self) -> None:
        """Nothing but liveness queries reached the board, and nobody else is in its domain."""
        state, asked = self.bridge, len(self.board.got)
        wait_until(lambda: len(self.board.got) > asked, 20.0, "the next liveness query")
        assert bytes(self.board.got).replace(QUERY, b"") in [QUERY[:n] for n in range(len(QUERY))]
        assert not state.virtual_port
        assert (state.state, state.lease_holder, state.frames_sent) == (BridgeState.DISARMED, "", 0)
        foreign = {"gait_planner", "twin", "virtual_prototype", "traveller"} & set(self._operator.node.get_node_names())
        assert not foreign

    def close(self) -> None:
        self.beside.kill()
        self._operator.close()
        self._robot.kill()
        self.board.close()


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory, domain: int, compiled: None) -> Iterator[Lab]:
    lab = Lab(tmp_path_factory.mktemp("lab"), domain)
    yield lab
    lab.close()


def armed(command: Process, folder: Path) -> None:
    """Waits until the command's own planner has armed."""

    def told() -> bool:
        return any("armed for operator" in log.read_text(errors="replace") for log in folder.rglob("gait_planner.log"))

    wait_until(lambda: told() or command.code is not None, LIMIT_S, f"arming by {command.name}: {command.output}")
    assert told(), command.output


def interrupted(command: Process) -> None:
    command.signal(signal.SIGINT)
    command.ends(60.0)


@pytest.mark.slow
def test_a_demo(lab: Lab) -> None:
    command = lab.beside.command("demo", "--rolls", "1", "--bags", str(lab.folder / "demo"))
    armed(command, lab.folder / "demo")
    lab.was_left_alone()
    interrupted(command)
    number = own_domain(command)
    assert number != lab.domain
    lab.was_left_alone()


@pytest.mark.slow
def test_a_session_of_virtual_trials(lab: Lab) -> None:
    folder = lab.folder / "trial"
    plan = ("--primitives", "1", "--gaits", "TC6-TO5", "--virtual", "--time-scale", "4")
    command = lab.beside.command("trial", str(folder), *plan)
    armed(command, folder)
    lab.was_left_alone()
    interrupted(command)
    assert own_domain(command) != lab.domain
    lab.was_left_alone()


@pytest.mark.slow
def test_a_travel(lab: Lab) -> None:
    command = lab.beside.command("travel", "0.3,0", "-o", str(lab.folder / "travel"))
    armed(command, lab.folder / "travel")
    lab.was_left_alone()
    interrupted(command)
    assert own_domain(command) != lab.domain
    lab.was_left_alone()


@pytest.mark.slow
@pytest.mark.parametrize("words", [("console", "console: http"), ("foxglove", "Foxglove: open")])
def test_what_a_person_arms_in_a_browser(lab: Lab, words: tuple[str, str]) -> None:
    """Arming is asked of the planner, as page and app do it; in the printed domain, which says that `ros2` joins there, too."""
    command = lab.beside.command(words[0], "--virtual", "--port", "0", "--bags", str(lab.folder / words[0]))
    command.says(words[1], LIMIT_S)
    operator = Operator(domain=own_domain(command), events=True)
    try:
        operator.wait_for_stack()
        assert operator.bridge.prototype
        operator.arm()
    finally:
        operator.close()
    lab.was_left_alone()
    interrupted(command)


def own_domain(command: Process) -> int:
    """The domain that a command says is its own."""
    found = re.search(r"^export ROS_DOMAIN_ID=(\d+)   # to join with ros2 and RViz$", command.output, re.MULTILINE)
    assert found, command.output
    return int(found[1])


def test_practising_to_calibrate(lab: Lab) -> None:
    words = ("calibrate", str(lab.folder / "practice.yaml"), "--virtual", "--time-scale", "6", "--robot", "practice")
    environ = {"ROS_DOMAIN_ID": str(lab.domain), "SIXSTRUT_STATE_DIR": str(lab.folder / "state")}
    person = Terminal(*words, environ=environ, folder=lab.folder)
    try:
        for said in ("in mm [234]:", "[1]:", "all is clear"):
            person.says(said)
            person.press(ENTER)
        person.says("got longer")
        assert person.leaves() == 130
    finally:
        person.close()
    lab.was_left_alone()


@pytest.mark.slow
def test_failures_made_to_happen(lab: Lab) -> None:
    command = lab.beside.command("faults", "--only", "4")
    assert command.ends(LIMIT_S) == 0, command.output
    assert own_domain(command) != lab.domain
    lab.was_left_alone()


def test_an_explicit_domain_is_not_taken_where_a_bridge_answers(lab: Lab) -> None:
    for name in ("demo", "console"):
        words = ("--virtual",) if name == "console" else ()
        command = lab.beside.command(name, *words, "--domain", str(lab.domain), "--bags", str(lab.folder / "none"))
        assert command.ends(60.0) == 1
        assert f"error: ROS domain {lab.domain}" in command.output, command.output
    lab.was_left_alone()
