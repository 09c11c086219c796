# SPDX-License-Identifier: Apache-2.0
"""What several tests of the bridge share."""

import contextlib
import os
import threading
import time
import tty
from collections.abc import Callable, Iterator

import numpy as np

from hardware_bridge.boards.lsc import CMD_BATTERY, Frame, FrameDecoder, Move, decode_move, encode_battery_reply
from hardware_bridge.link.transport import SerialTransport
from hardware_bridge.prototype_client.observation import Observation

MID_M = 0.234
MID = (MID_M,) * 6
LIMIT_S = 20.0


def wait_for(condition: Callable[[], bool], what: str, limit_s: float = LIMIT_S) -> None:
    """Waits until `condition` holds; fails, saying `what`, after the limit."""
    deadline = time.monotonic() + limit_s
    pause = threading.Event()
    while not condition():
        assert time.monotonic() < deadline, f"waited {limit_s} s in vain for {what}"
        pause.wait(0.002)


def read_exactly(transport: SerialTransport, count: int, limit_s: float = LIMIT_S) -> bytes:
    """`count` bytes, or what has come when the limit is over."""
    data, deadline = b"", time.monotonic() + limit_s
    while len(data) < count and time.monotonic() < deadline:
        data += transport.read_available(count - len(data))
    return data


class Wire:
    """The far end of a pty: a board that only listens, or also answers battery queries."""

    def __init__(self, answers: bool = False) -> None:
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        os.set_blocking(self._near, False)
        self.port = os.ttyname(self._far)
        self.answers = answers
        self._decoder = FrameDecoder()
        self.frames: list[Frame] = []
        self._open = True

    def listen(self) -> list[Frame]:
        """All frames so far, battery queries among them."""
        while self._open:
            try:
                data = os.read(self._near, 4096)
            except (BlockingIOError, OSError):
                break
            for frame in self._decoder.feed(data):
                self.frames.append(frame)
                if self.answers and frame.command == CMD_BATTERY:
                    os.write(self._near, encode_battery_reply(7400))
        return self.frames

    def moves(self) -> list[Move]:
        """All moves so far."""
        return [move for frame in self.listen() if (move := decode_move(frame)) is not None]

    def fill(self) -> None:
        """Puts bytes on the line, as if they came from a program that knows no lock, until it takes no more."""
        descriptor = os.open(self.port, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
        for size in (4096, 1):
            with contextlib.suppress(BlockingIOError):
                while True:
                    os.write(descriptor, bytes(size))
        os.close(descriptor)

    def cut(self) -> None:
        """The link dies."""
        if self._open:
            self._open = False
            os.close(self._near)
            os.close(self._far)


@contextlib.contextmanager
def attended(answers: bool) -> Iterator[Wire]:
    """A wire whose far end is attended to while the block lasts; `answers` can be changed meanwhile."""
    wire, ended = Wire(answers), threading.Event()

    def live() -> None:
        while not ended.wait(0.002):
            wire.listen()

    thread = threading.Thread(target=live)
    thread.start()
    try:
        yield wire
    finally:
        ended.set()
        thread.join()
        wire.cut()


class StillBody:
    """A body without physics: its struts have the length that they are told, at once.

    It stands in for the simulated robot, so that these tests judge bytes, time and order only, and quickly.
    """

    def __init__(self) -> None:
        self.time_s = 0.0
        self.lengths_m = np.full(6, MID_M)
        self.history: list[tuple[float, np.ndarray]] = []
        self.supply_v: float | None = None
        self.brown_out = False

    def set_targets(self, lengths_m: np.ndarray) -> None:
        new = np.where(np.isnan(lengths_m), self.lengths_m, lengths_m)
        if not np.array_equal(new, self.lengths_m):
            self.lengths_m = new
            self.history.append((self.time_s, new.copy()))

    def advance_to(self, time_s: float) -> None:
        self.time_s = time_s

    def take_brown_out(self) -> bool:
        was, self.brown_out = self.brown_out, False
        return was

    def observe(self) -> Observation:
        return Observation(int(self.time_s * 1e9), "TC6", "TC6", True, np.zeros((12, 3)), np.zeros(3))
