# SPDX-License-Identifier: Apache-2.0
"""Where scenarios happen: the stack's real processes around a virtual prototype, somebody before them, and its faults."""

import math
import signal
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from hardware_bridge.prototype_client.fault_client import inject
from hardware_bridge.prototype_client.handshake import read_handshake
from tensegrity_interfaces.msg import BridgeState
from tensegrity_interfaces.srv import Arm, Disarm
from tensegrity_lab.stack.processes import START_LIMIT_S, STOP_LIMIT_S, Process, wait_until
from tests.failures.scenario import expect
from tests.isolated_stack import IsolatedStack
from tests.stack_operator import Operator

MID = (0.234,) * 6
T = TypeVar("T")


@dataclass(frozen=True)
class Setup:
    """A stack.

    Attributes:
        board: Of prototype and bridge.
        time_scale: Robot seconds per second.
        prototype: More words for the virtual prototype.
        rolling: With twin and planner.
        felt: By an inertial sensor, whose nodes tell the faces; nobody sees it.
    """

    board: str = "lsc"
    time_scale: float = 8.0
    prototype: tuple[str, ...] = ("--actuators", "ideal", "--perturbation", "0")
    rolling: bool = False
    felt: bool = False


A_ROLL_S = 6.0
"""So long a strut runs in a roll, at most."""
STRUTS = Setup()
"""Prototype and bridge: struts are moved by hand."""

ROLLING = Setup(prototype=("--seed", "3"), rolling=True)
"""The whole stack, on a perturbed robot with actuators that feel their load."""

FELT = Setup(time_scale=4.0, prototype=("--seed", "3", "--imu", "wt901"), rolling=True, felt=True)
"""The same, as an inertial sensor feels it."""


@dataclass
class Rig:
    """One stack at a time; a scenario that leaves it as it found it lets the next one go on with it.

    Attributes:
        folder: Of everything that the stack writes.
        domain: ROS domain. locks: descriptors that its processes keep open.
    """

    folder: Path
    domain: int
    locks: tuple[int, ...] = ()
    processes: IsolatedStack = field(init=False)
    _operator: Operator | None = None
    _setup: Setup | None = None
    _nodes: dict[str, Process] = field(default_factory=dict)
    _bridge_parameters: Mapping[str, object] = field(default_factory=dict)
    _facts: dict[object, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.processes = IsolatedStack(self.folder, self.domain, self.locks)

    def close(self) -> None:
        """Ends everything."""
        if self._operator is not None:
            self._operator.close()
        self.processes.kill()

    # ---- the stack --------------------------------------------------------------------------------------------------

    @property
    def operator(self) -> Operator:
        """Somebody before the stack, from the first call on."""
        if self._operator is None:
            self._operator = Operator(domain=self.domain)
        return self._operator

    @property
    def link(self) -> Path:
        """The virtual prototype's port."""
        return self.folder / "state" / "prototype"

    def node(self, name: str) -> Process:
        """A process of the stack."""
        return self._nodes[name]

    def use(self, setup: Setup, **bridge: Any) -> Operator:
        """The stack of a setup, with these parameters of the bridge: the running one if it is that, or a new one. Disarmed."""
        if self._setup != setup or any(process.code is not None for process in self._nodes.values()):
            self.spoil()
            self._setup = setup
            words = ("--board", setup.board, "--time-scale", f"{setup.time_scale:g}", *setup.prototype)
            self._nodes["virtual_prototype"] = prototype = self.processes.node("virtual_prototype", *words)
            if setup.rolling:
                self._nodes["twin"] = self.processes.node("twin")
                self._nodes["gait_planner"] = self.processes.node("gait_planner", settle_timeout_s=200.0)
            prototype.says("ready")
            if setup.felt:
                bridge = {"observer": "none", **bridge}
                for name in ("imu_driver", "face_estimator"):
                    self._nodes[name] = self.processes.node(name)
            self.start_bridge(**bridge)
        elif "hardware_bridge" not in self._nodes or dict(bridge) != dict(self._bridge_parameters):
            self.end_bridge()
            self.start_bridge(**bridge)
        self.calm()
        return self.operator

    def start_bridge(self, **parameters: Any) -> Process:
        """The bridge of the setup, until its port is open."""
        assert self._setup is not None
        operator = self.operator
        operator.bridge = operator.observed = None
        handshake = read_handshake(str(self.link))
        expect(handshake is not None, f"no virtual prototype lives at {self.link}")
        operator.prototype = "" if handshake is None else handshake.instance
        operator.sent.clear()
        operator.diagnostics.clear()
        self._bridge_parameters = parameters
        bridge = self.processes.node("hardware_bridge", board=self._setup.board, **parameters)
        self._nodes["hardware_bridge"] = bridge
        bridge.says("DISARMED, nothing moves")
        operator.wait_for_stack() if self._setup.rolling else operator.wait_for_bridge()
        return bridge

    def end_bridge(self, limit_s: float = STOP_LIMIT_S) -> None:
        """Ends the bridge, if one runs, in this time, in which it finishes its bag; the rest of the stack goes on."""
        bridge = self._nodes.pop("hardware_bridge", None)
        if bridge is not None and bridge.code is None:
            bridge.signal(signal.SIGINT)
            expect(bridge.ends(limit_s) == 0, f"the bridge ended with {bridge.code}: {bridge.output}")

    def restart(self, name: str, **parameters: Any) -> Process:
        """A node of the stack that has died, anew."""
        self._nodes[name] = process = self.processes.node(name, **parameters)
        return process

    def spoil(self) -> None:
        """The stack is of no use any more: the next `use` starts another."""
        self._setup = None
        self._nodes.clear()
        self.processes.kill()

    def calm(self) -> None:
        """No fault, no lease, no motion."""
        operator = self.operator
        self.fault("clear")
        lease, operator.lease = operator.lease, ""
        if self._setup is not None and self._setup.rolling:
            operator.call("disarm", Disarm.Request())
        operator.call("bridge/disarm", Disarm.Request(lease=lease))
        if operator.bridge.state == BridgeState.FAULT:
            operator.trigger("reset")
        operator.sees(BridgeState.DISARMED)

    # ---- what is done there -----------------------------------------------------------------------------------------

    def fault(self, name: str, direction: str = "", **numbers: float) -> float:
        """Makes the virtual prototype fail; its robot time in s."""
        return inject(self.link, name, direction, **numbers)

    def arm(self, holder: str = "operator") -> str:
        """Arms the bridge itself and waits for the end of homing; the lease, which is then kept alive."""
        return self.operator.take_lease(holder=holder)

    def refused_arm(self) -> str:
        """Tries to arm the bridge itself; why it was refused."""
        answer = self.operator.call("bridge/arm", Arm.Request(holder="operator", lifted_and_clear=True))
        expect(not answer.success, "arm was not refused")
        return str(answer.message)

    def begin_roll(self) -> Any:
        """A roll onto a neighbouring face, armed and under way."""
        from sim_core.structure.topology import NEIGHBOURS

        operator = self.operator
        wait_until(operator.is_quiet, START_LIMIT_S, "rest on a face")
        assert self._setup is not None
        operator.arm(MID if self._setup.felt else ())  # nobody sees the struts
        wait_until(lambda: operator.bridge.duty_left_s > A_ROLL_S, START_LIMIT_S, "motors that have rested after a long hold")
        goal = operator.begin_roll(NEIGHBOURS[operator.observed.face][0])
        expect(goal.accepted, "the roll was not accepted")
        operator.moves(goal, 0.005)
        return goal

    def frames_sent(self) -> int:
        """Frames that were sent up to now, as the bridge tells it from now on."""
        now_ns = self.operator.bridge.robot_time_ns
        wait_until(lambda: self.operator.bridge.robot_time_ns > now_ns, 10.0, "the bridge's next state")
        return int(self.operator.bridge.frames_sent)

    def remember(self, key: object, find: Callable[[], T]) -> T:
        """What was found once, for the scenarios that share it."""
        if key not in self._facts:
            self._facts[key] = find()
        found: T = self._facts[key]
        return found


def stretched(strut: int, stroke_m: float) -> list[float]:
    """Six rest lengths in m with one strut (from 1) away from mid stroke."""
    return [length + stroke_m * (number == strut) for number, length in enumerate(MID, start=1)]


def percentile(values: list[float], part: float) -> float:
    """The smallest value that at least this part (0..1) of the values does not exceed."""
    return sorted(values)[max(0, math.ceil(part * len(values)) - 1)]


def scratch() -> tempfile.TemporaryDirectory[str]:
    """A folder for a lab; short, because sockets are in it."""
    # the process of a killed bridge's port may write its last records while the folder goes
    return tempfile.TemporaryDirectory(prefix="sixstrut-faults-", ignore_cleanup_errors=True)
