# SPDX-License-Identifier: Apache-2.0
import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.calibration.pulse_map import Calibration
from hardware_bridge.driver.bridge import Bridge
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.limits import Pacing
from hardware_bridge.virtual_prototype.boards.emulated_board import EmulatedBoard
from hardware_bridge.virtual_prototype.boards.registry import emulate
from hardware_bridge.virtual_prototype.main_loop import VirtualPrototype
from tests.hardware_bridge.helpers import StillBody, Wire


@pytest.fixture
def calibration() -> Calibration:
    return load_calibration()


@pytest.fixture
def rules(calibration: Calibration) -> Rules:
    return Rules(replace(calibration, robot="of the tests"), pacing=Pacing(energise_pause_s=0.0))


@pytest.fixture
def wire() -> Iterator[Wire]:
    wire = Wire()
    yield wire
    wire.cut()


@pytest.fixture
def make_bridge(tmp_path: Path, rules: Rules) -> Iterator[Callable[..., Bridge]]:
    bridges: list[Bridge] = []

    def make(port: str, **options: object) -> Bridge:
        """On wires that only listen, with actuators that have rested: the operator's word for both."""
        options.setdefault("silent_board", True)
        options.setdefault("rested_s", 10_000.0)
        options.setdefault("state_dir", tmp_path / "state")
        bridge = Bridge(port, options.pop("rules", rules), **options)  # type: ignore[arg-type]
        bridges.append(bridge)
        return bridge

    yield make
    for bridge in bridges:
        with contextlib.suppress(Exception):
            bridge.close()


class Running:
    """A virtual prototype with a body without physics, in a thread of this process, behind a real pty."""

    def __init__(self, link: Path, time_scale: float, board: EmulatedBoard) -> None:
        self.link = link
        self.body = StillBody()
        self.board = board
        self.prototype = VirtualPrototype(link, self.body, load_calibration(), board, time_scale)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self.prototype.run, args=(self._ended.is_set,))
        self._thread.start()
        self._alive = True

    def kill(self) -> None:
        if self._alive:
            self._alive = False
            self._ended.set()
            self._thread.join()
            self.prototype.close()


@pytest.fixture
def start_prototype(tmp_path: Path) -> Iterator[Callable[..., Running]]:
    running: list[Running] = []

    def start(time_scale: float = 8.0, name: str = "prototype", board: EmulatedBoard | None = None) -> Running:
        running.append(Running(tmp_path / name, time_scale, emulate("lsc") if board is None else board))
        return running[-1]

    yield start
    for prototype in running:
        prototype.kill()
