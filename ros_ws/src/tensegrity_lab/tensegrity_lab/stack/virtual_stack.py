# SPDX-License-Identifier: Apache-2.0
"""A whole stack on a virtual prototype: its processes, started together. For demo, travel and console."""

import os
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from hardware_bridge.boards.registry import parse_board
from hardware_bridge.prototype_client.handshake import Handshake, imu_path, read_handshake
from sim_core.dynamics.actuators import require_actuators
from sim_core.files.places import folder_problem, temporary_parent
from sim_core.gaits.library import load_library
from sim_core.rolling.warm_up import Stage
from sim_core.structure.topology import require_face
from tensegrity_lab.errors import StackError
from tensegrity_lab.stack.processes import Stack, wait_until
from tensegrity_lab.stack.ros_domain import private_domain
from tensegrity_lab.terminal.compile_notice import compile_first
from tensegrity_lab.terminal.leaving import uninterrupted

FREE_BYTES = 200_000_000
"""Room on the disk without which no robot is started: with less the bridge refuses motions."""
_RECORDING = re.compile(r", recording (.+); ")
"""As `hardware_bridge_node` says it."""
START_LIMIT_S = 180.0
"""The first time on a machine its kernels are compiled."""


def start_prototype(stack: Stack, link: Path, words: Mapping[str, object]) -> Handshake:
    """Start a virtual prototype; returned as soon as it has proven that the pty at its link is its own.

    Args:
        stack: starts and watches the processes.
        link: where its pty is linked.
        words: its options, without dashes.

    Raises:
        StackError: it does not come up.
    """
    given = [word for name, value in words.items() for word in (f"--{name}", str(value))]
    command: list[str | Path] = [sys.executable, "-m", "hardware_bridge.virtual_prototype", "--link", link, *given]
    prototype = stack.start("virtual_prototype", command)
    found: list[Handshake] = []

    def ready() -> bool:
        shake = read_handshake(str(link))
        if shake is not None and shake.pid == prototype.pid:
            found.append(shake)
        return bool(found)

    wait_until(ready, START_LIMIT_S, "the virtual prototype's port", stack)
    return found[0]


def start_sensing(stack: Stack, port: str, mounting: Path) -> None:
    """Start the driver of an inertial sensor, unless it has no port: then it runs already; and what tells the face by it."""
    if port:
        stack.node("imu_driver", port=port)
    stack.node("face_estimator", mounting=mounting.resolve())


def recorded_bag(stack: Stack) -> Path | None:
    """What the newest bridge of a stack recorded, by its log: on a busy computer its word of it may not be heard. None: nothing."""
    logs = sorted(stack.folder.glob("hardware_bridge*.log"), key=lambda log: log.stat().st_mtime)
    told = _RECORDING.findall(logs[-1].read_text(encoding="utf-8", errors="replace")) if logs else []
    return Path(told[-1]) if told else None


@dataclass(frozen=True)
class VirtualRobot:
    """A virtual prototype, and what drives it.

    Attributes:
        face: it starts on.
        seed, perturbation, incline_deg: of the hidden robot and its ground.
        time_scale: robot seconds per second.
        board, actuators, library: names or files.
        bags: folder.
        mounting: of an inertial sensor in its box, which alone tells its faces; None: its observer does.
    """

    face: str = "TC6"
    seed: int = 1
    perturbation: float = 0.05
    time_scale: float = 8.0
    board: str = "lsc"
    actuators: str = "stand-in"
    library: str = "robust"
    bags: Path = Path("bags")
    incline_deg: float = 0.0
    mounting: Path | None = None

    def require(self) -> None:
        """Raises SimError, BridgeError: something that cannot be, before anything is started."""
        if problem := folder_problem(self.bags, FREE_BYTES, locks=True):
            raise StackError(f"{problem}: choose another folder for the bags")
        require_face(self.face)
        parse_board(self.board)
        require_actuators(self.actuators)
        load_library(self.library)

    @staticmethod
    def compile() -> None:
        """Compile the solver first, once for all processes, instead of each for itself; the planner rehearses in batches."""
        compile_first(Stage.ROBOT, Stage.BATCH)

    @property
    def describe(self) -> str:
        """For people."""
        pace = "real time" if self.time_scale == 1.0 else f"{self.time_scale:g} times real time"
        eyes = "" if self.mounting is None else "; an inertial sensor tells its faces, nobody sees it"
        ground = f", ground inclined by {self.incline_deg:g} degrees" if self.incline_deg else ""
        return (
            f"virtual prototype, board {self.board}, actuators {self.actuators}, perturbed by ±{100 * self.perturbation:g} % "
            f"(seed {self.seed}){ground}; {pace}{eyes}; every roll here is virtual"
        )

    def start_prototype(self, stack: Stack, link: Path) -> Handshake:
        """Start the virtual prototype alone, its pty linked there. Raises StackError: it does not come up."""
        words = {
            "face": self.face,
            "seed": self.seed,
            "perturbation": self.perturbation,
            "incline": self.incline_deg,
            "time-scale": self.time_scale,
            "board": self.board,
            "actuators": self.actuators,
        }
        if self.mounting is not None:
            words["imu"] = "wt901"
        return start_prototype(stack, link, words)

    def start(self, stack: Stack, folder: Path, traveller: Mapping[str, Any] | None) -> Handshake:
        """Start the processes; the link and the bridge's state are in `folder`. Nothing but this prototype can be armed by them.

        Args:
            stack: starts and watches the processes.
            folder: for links and state.
            traveller: its parameters; None: none is started.

        Returns:
            the prototype's handshake.

        Raises:
            StackError: the virtual prototype does not come up.
        """
        link = folder / "prototype"
        handshake = self.start_prototype(stack, link)
        mounting: dict[str, Any] = {} if self.mounting is None else {"mounting": self.mounting.resolve()}
        stack.node("twin", start_face=self.face, **mounting)
        stack.node("gait_planner", library=self.library, prototype=handshake.instance)
        observer: dict[str, Any] = {}
        if self.mounting is not None:
            start_sensing(stack, str(imu_path(link)), self.mounting)
            observer = {"observer": "none"}
        if traveller is not None:
            stack.node("traveller", library=self.library, **traveller)
        stack.node(
            "hardware_bridge",
            port=link,
            board=self.board,
            time_scale=self.time_scale,
            bag_folder=self.bags.resolve(),
            state_folder=folder,
            library=self.library,
            **observer,
        )
        return handshake


@contextmanager
def running(
    robot: VirtualRobot,
    name: str,
    told: Callable[[str], None],
    domain: int | None = None,
    traveller: Mapping[str, Any] | None = MappingProxyType({}),
) -> Iterator[tuple[Stack, Handshake]]:
    """A whole stack in a ROS domain of its own, while somebody watches; however that ends, struts are held and the bag is closed.

    Args:
        robot: the virtual robot and its stack.
        name: of whoever watches, for the folder of logs.
        told: a line for people.
        domain: this one; None: any that is free.
        traveller: its parameters; None: none is started.

    Raises:
        SimError, BridgeError: something that cannot be.
        StackError: the virtual prototype does not come up.
        KeyboardInterrupt: when all has ended, also if the interruption came only then.
    """
    robot.require()
    robot.bags.mkdir(parents=True, exist_ok=True)
    scratch = tempfile.TemporaryDirectory(prefix=f"sixstrut-{name}-", dir=temporary_parent())
    with private_domain(domain) as own, scratch as folder:
        told(robot.describe)
        told(own.describe)
        robot.compile()
        logs = robot.bags / "logs" / f"{time.strftime('%Y%m%d-%H%M%S')}-{name}-{os.getpid()}"
        processes = Stack(logs, *own.locks)
        try:
            yield processes, robot.start(processes, Path(folder), traveller)
        except KeyboardInterrupt:
            told("stopping: the struts are held, the bag is being closed")
            raise
        finally:
            with uninterrupted() as came:
                processes.stop()
            if came:
                raise KeyboardInterrupt
