# SPDX-License-Identifier: Apache-2.0
"""The robot's side of a session: the stack's processes, arming, rolling, and the bag."""

import math
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from hardware_bridge.prototype_client.handshake import Handshake, imu_path, read_handshake
from hardware_bridge.prototype_client.observation import Observation
from hardware_bridge.prototype_client.observer_client import ObserverClient
from sim_core.files.places import temporary_parent
from sim_core.structure.parameters import load_prototype
from sim_core.structure.policy import neutral_lengths
from tensegrity_lab.errors import SessionError, StackError, granted
from tensegrity_lab.session_data.bag_messages import message_of
from tensegrity_lab.session_data.folder import LIBRARY, LOGS, SessionFolder
from tensegrity_lab.session_data.ledger_line import Line
from tensegrity_lab.stack.processes import Stack
from tensegrity_lab.stack.simulation_lag import LateOrders
from tensegrity_lab.stack.virtual_stack import FREE_BYTES, VirtualRobot, start_sensing

ROLL_LIMIT_S = 150.0
"""Robot time that one roll may take, all motions and all settlings."""
LINK_LIMIT_S = 15.0
"""And each roll of a chain, beside that."""
CALM_LIMIT_S = 60.0
"""Robot time within which the robot is seen at rest."""
SENSOR_LIMIT_S = 10.0
"""Robot time after which a sensor that does not know the face is not waited for."""
SILENT_S = 3.0


@dataclass(frozen=True)
class Hardware:
    """How the robot is reached; may differ from start to start of a session.

    Attributes:
        port: device or URL; empty: a virtual prototype is started.
        board, baud: of the servo board.
        calibration: YAML; empty: the virtual prototype's.
        time_scale: of a virtual prototype.
        rested_s, silent_board: the operator's words to the bridge, see its parameters; the first is said of the first start.
        observed: something else than a person tells faces.
        imu_port, mounting: of an inertial sensor that does, alone; no port: its driver runs already, or it is the prototype's.
    """

    port: str
    board: str
    baud: int
    calibration: str
    time_scale: float
    rested_s: float
    silent_board: bool
    observed: bool = False
    imu_port: str = ""
    mounting: str = ""


class Rolled(NamedTuple):
    """How a roll or chain ended: see the action Roll. `faults`: what the bridge complained of meanwhile."""

    success: bool
    completed: bool
    reason: str
    observed_face: str
    faces: tuple[str, ...]
    robot_s: float
    faults: str
    rolls: int = 0
    ended_early: bool = False


class RobotAccess:
    """The stack, and a client of it. Nothing is started before `start`."""

    def __init__(self, session: SessionFolder, hardware: Hardware, *locks: int):
        """Args: locks: descriptors of the session's lock and the ROS domain's, which all its processes keep open."""
        self._session = session
        self._hardware = hardware
        self._locks = locks
        self._stack: Stack | None = None
        self._links: Path | None = None
        self._neutral_m = neutral_lengths(load_prototype()).tolist()
        self._late = LateOrders()
        self._hurried = False
        self._eye: ObserverClient | None = None
        self.operator: Any = None
        self.starts = 0
        self._truth: str | None = None
        self.agreed = self.compared = 0
        self.lifted = False
        """A person has it in their hands: what was told of its face is not so any more."""

    # ---- life -------------------------------------------------------------------------------------------------------

    def start(self, face: str) -> None:
        """Start the processes, a virtual prototype on that face. Nothing is armed. Raises StackError: they do not come up."""
        self.starts += 1
        hardware, settings = self._hardware, self._session.settings
        stamp = time.strftime("%Y%m%d-%H%M%S", time.gmtime())
        self._stack = stack = Stack(self._session.path / LOGS / f"{stamp}-{os.getpid()}-{self.starts}", *self._locks)
        port, meant = (hardware.port, read_handshake(hardware.port)) if hardware.port else self._start_prototype(stack, face)
        prototype = "" if meant is None else meant.instance
        library = (self._session.path / LIBRARY).resolve()
        bridge: dict[str, Any] = {
            "port": port,
            "board": hardware.board,
            "baud": hardware.baud,
            "calibration": hardware.calibration,
            "bag_folder": self._session.bags.resolve(),
            "library": library,
            "rested_s": hardware.rested_s if self.starts == 1 else 0.0,
            "silent_board": hardware.silent_board,
        }
        if hardware.mounting:
            imu = hardware.imu_port or (str(imu_path(Path(port))) if meant is not None else "")
            start_sensing(stack, imu, Path(hardware.mounting))
            bridge |= {"observer": "none"}
        if not hardware.port:
            bridge |= {"time_scale": hardware.time_scale, "state_folder": self._links}
        seat: dict[str, Any] = {"mounting": Path(hardware.mounting).resolve()} if hardware.mounting else {}
        stack.node("twin", start_face=face, **seat)
        confirm = "observed" if hardware.observed else "predicted"  # a person judges in their own time, after the roll
        waits: dict[str, Any] = {"confirm_timeout_s": SENSOR_LIMIT_S} if hardware.mounting else {}
        stack.node("gait_planner", library=library, confirm=confirm, prototype=prototype, **waits)
        stack.node("hardware_bridge", **{name: value for name, value in bridge.items() if value not in ("", 0)})
        from tensegrity_lab.stack.client import StackClient  # rclpy: only once the processes are on their way

        self.operator = StackClient(stack, prototype)
        self.operator.wait_for_stack(hardware.observed and meant is not None)  # a real sensor may not know the face yet
        if self.operator.bridge.virtual_port != settings.virtual_robot:
            kind = "a virtual prototype's" if self.operator.bridge.virtual_port else "a real one"
            raise SessionError(f"port {port} is {kind}, but session {settings.name} is not: begin another session for it")
        if meant is not None:
            self._eye = ObserverClient(meant.observer, self._on_truth)

    def _start_prototype(self, stack: Stack, face: str) -> tuple[str, Handshake]:
        settings, hardware = self._session.settings, self._hardware
        self._links = Path(tempfile.mkdtemp(prefix="sixstrut-trial-", dir=temporary_parent()))
        link = self._links / "prototype"
        robot = VirtualRobot(face, settings.seed, settings.perturbation, hardware.time_scale, hardware.board, settings.actuators)
        if hardware.mounting:
            robot = replace(robot, mounting=Path(hardware.mounting))
        return str(link), robot.start_prototype(stack, link)

    def _on_truth(self, observation: Observation) -> None:
        """What a virtual prototype's observer sees, whether the stack hears of it or not. In another thread."""
        self._late.saw(observation)
        if observation.settled:
            self._truth = observation.face or ""

    def compare(self, face: str) -> str:
        """Count whether a face that a sensor told is the truth, where that is known; a remark if it is not. Raises StackError."""
        if not self._hardware.mounting or self._eye is None:
            return ""
        self._truth = None  # what it saw of the robot at rest before the roll
        self.operator.wait(
            lambda: self._truth is not None, "rest, as the prototype's observer sees it,", 10.0 + CALM_LIMIT_S / self.scale
        )
        self.compared += 1
        self.agreed += face == self._truth
        return "" if face == self._truth else f"the sensor told {face}, the prototype's observer saw {self._truth or 'no face'}"

    def stop(self) -> dict[str, int]:
        """End client and processes in order; exit codes by name. Safe to call twice."""
        eye, self._eye = self._eye, None
        if eye is not None:
            eye.close()
        operator, self.operator = self.operator, None
        stack, self._stack = self._stack, None
        links, self._links = self._links, None
        try:
            if operator is not None:
                operator.close()
        finally:
            codes = stack.stop() if stack is not None else {}
            if links is not None:
                shutil.rmtree(links, ignore_errors=True)
        return codes

    def arm(self, at_mid_stroke: bool) -> None:
        """Energise and home. Args: at_mid_stroke: somebody says that all struts are there. Raises StackError: refused, and why."""
        self.operator.arm(self._neutral_m if at_mid_stroke else [])

    def reset(self) -> None:
        """Leave a latched fault, to DISARMED. Raises StackError."""
        granted(self.operator.trigger("reset"), "reset failed")

    def stop_motion(self) -> None:
        """Stop at once, latched. Raises StackError."""
        granted(self.operator.trigger("stop"), "stop failed")

    def say_face(self, face: str) -> None:
        """A person sees the robot on this face; empty: on none. Raises StackError."""
        self.lifted = False
        self.operator.set_face(face)
        told = lambda: self.operator.observed is not None and self.operator.observed.face == face  # noqa: E731
        self.operator.wait(told, "the bridge's word of the face", 10.0)

    def log(self, line: Line) -> None:
        """Put a line into the bag; on return it is on the disk. Raises StackError."""
        self.operator.log_trial(message_of(line))

    def disarm(self) -> None:
        """Give the lease back, if the stack is there."""
        if self.operator is not None:
            self.operator.disarm()

    # ---- what is known ----------------------------------------------------------------------------------------------

    @property
    def face(self) -> str:
        """The face that the robot was last seen on; empty: on none, or nobody looked."""
        seen = None if self.lifted else self.operator.observed
        return str(seen.face) if seen is not None and seen.settled else ""

    @property
    def scale(self) -> float:
        """Robot seconds per second."""
        return float(self.operator.bridge.time_scale)

    @property
    def watched(self) -> bool:
        """Whether something, not a person, tells the robot's faces."""
        seen = self.operator.observed
        return seen is not None and seen.source != seen.SOURCE_OPERATOR

    def wait_for_rest(self) -> str:
        """Until an observer sees the robot at rest; its face. Raises StackError."""
        seen = lambda: self.operator.observed is not None and self.operator.observed.settled  # noqa: E731
        self.operator.wait(seen, "rest, as the observer sees it,", 10.0 + CALM_LIMIT_S / self.scale)
        return self.face

    def trouble(self) -> str:
        """Why no trial may begin now, as far as link, supervisor and log tell; empty: nothing speaks against it."""
        bridge = self.operator.bridge
        if time.monotonic() - self.operator.heard > SILENT_S:
            return "the hardware bridge is silent"
        if not bridge.link_ok:
            return f"the link is lost: {bridge.reason}"
        if bridge.state != "ARMED":
            return f"the bridge is {bridge.state}{': ' + bridge.reason if bridge.reason else ''}"
        if not bridge.bag:
            return "the bag is not being written"
        free = shutil.disk_usage(self._session.path).free
        if free < FREE_BYTES:
            return f"only {free / 1e6:.0f} MB are free for {self._session.path}: make room"
        return ""

    def wait_for_growing_log(self) -> None:
        """Until the bag has grown. Raises StackError: it does not."""
        before = self.operator.bridge.bag_messages
        self.operator.wait(lambda: self.operator.bridge.bag_messages > before, "growth of the bag", 5.0)

    def bag_place(self, time_ns: int) -> tuple[str, float]:
        """The bag's name, and how long after its first message a time is (s)."""
        bridge = self.operator.bridge
        began_ns = bridge.bag_began.sec * 1_000_000_000 + bridge.bag_began.nanosec
        return Path(bridge.bag).name, (time_ns - began_ns) * 1e-9 if began_ns else math.nan

    # ---- what is done -----------------------------------------------------------------------------------------------

    def rest(self, needed_s: float, watch: Callable[[], None]) -> None:
        """Until every strut may run for so long (robot time). Raises StackError: the duty window is over and it still may not."""
        self.operator.wait_for_duty(needed_s, 30.0 + 700.0 / self.scale, watch)

    def slow_down(self) -> bool:
        """At half the time scale from the next start on, if that may mend the last roll; False: no need, or no way.

        It may if orders came too late, or a chain ended early: waiting for late orders wears out the duty that it has.
        """
        hardware = self._hardware
        if not self._hurried or hardware.port or hardware.time_scale <= 1.0:
            return False
        self._hardware = replace(hardware, time_scale=max(1.0, hardware.time_scale / 2.0))
        return True

    def roll(
        self,
        source: str,
        target: str,
        primitive: str,
        tell: Callable[[Any], None],
        watch: Callable[[], None],
        faces: Sequence[str] = (),
    ) -> Rolled:
        """One roll, or a chain over `faces`, and the return. Raises StackError; what `watch` raises, with the struts held.

        A roll during which a virtual prototype took its orders too late is none: it was not the roll that was asked for.
        """
        before = self.operator.bridge.write_errors
        complaints: list[str] = []

        def look() -> None:
            bridge = self.operator.bridge
            if bridge.state in ("FAULT", "HOLD") and bridge.reason not in complaints:
                complaints.append(bridge.reason)
            watch()

        self._late.forget()
        self._hurried = False
        limit_s = 30.0 + (ROLL_LIMIT_S + LINK_LIMIT_S * len(faces)) / self.scale
        result = self.operator.roll(target, source, primitive, tell=tell, limit_s=limit_s, watch=look, faces=faces)
        errors = self.operator.bridge.write_errors - before
        if errors:
            complaints.append(f"{errors} write errors")
        late = self._late.too_late(self.scale)
        self._hurried = bool(late or result.ended_early)
        if late:
            with suppress(StackError):
                self.wait_for_rest()
        return Rolled(
            bool(result.success) and not late,
            bool(result.completed) and not late,
            late or str(result.reason),
            self.face if late else str(result.observed_face),
            tuple(result.face_sequence),
            float(result.duration_s),
            "; ".join(complaints),
            int(result.rolls),
            bool(result.ended_early),
        )
