"""A twin that follows what really happened to the robot, bit for bit the same live and from a bag.

The bridge numbers everything that happens to the robot — rest lengths sent to the board, faces observed — in one stream. The
twin's state is a
function of that stream alone: each event first brings the model to the event's robot time, in whole steps, then acts.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np

from sim_core.model import Model
from sim_core.robot import Robot


@dataclass(frozen=True)
class Sent:
    """Rest lengths (m, S1..S6) that the board was told at a robot time (ns)."""

    seq: int
    robot_time_ns: int
    lengths_m: tuple[float, ...]


@dataclass(frozen=True)
class Observed:
    """A face that somebody saw the robot standing on at a robot time (ns); None: on no face."""

    seq: int
    robot_time_ns: int
    face: str | None
    settled: bool


Event = Sent | Observed


class Order:
    """Puts events that arrive on several channels back into the order of their numbers."""

    def __init__(self, patience: int = 200):
        """Args: patience: events held back for a missing one before it is given up as lost."""
        self._waiting: list[tuple[int, Event]] = []
        self._next: int | None = None
        self._patience = patience
        self.lost = 0

    def add(self, event: Event) -> list[Event]:
        """Take one event in; return those that are now due, in order. Events older than those given out are dropped."""
        if self._next is None:
            self._next = event.seq
        if event.seq < self._next:
            return []
        heapq.heappush(self._waiting, (event.seq, event))
        due = self._take()
        if not due and len(self._waiting) > self._patience:
            self.lost += self._waiting[0][0] - self._next
            self._next = self._waiting[0][0]
            due = self._take()
        return due

    def _take(self) -> list[Event]:
        due = []
        while self._waiting and self._waiting[0][0] == self._next:
            due.append(heapq.heappop(self._waiting)[1])
            self._next += 1
        return due


class Follower:
    """Steps a robot along the event stream.

    Attributes:
        robot: the twin's robot, at the last event.
        first_seq, last_seq: first and last event applied; 0 before any.
        robot_time_ns: of the last event.
        resets: how often an observation contradicted the twin and put it on another face.
    """

    def __init__(self, model: Model, face: str = "TC6"):
        """A twin resting on `face` until the first event. Raises UnknownFaceError."""
        self.model = model
        self.robot = Robot.resting_on(model, face)
        self.first_seq = self.last_seq = 0
        self.robot_time_ns = 0
        self.resets = 0
        self._origin = 0
        self._steps_before_reset = 0
        self._pending: Observed | None = None

    @property
    def step(self) -> int:
        """Steps since the first event, across resets."""
        return self._steps_before_reset + self.robot.step

    def apply(self, event: Event) -> None:
        """Bring the model to the event's time, then act on it. Events must come in the order of their numbers."""
        at = event.robot_time_ns * self.model.steps_per_second // 1_000_000_000
        if self.first_seq == 0:
            self.first_seq = event.seq
            self._origin = at - self.step
        steps = at - self._origin - self.step
        if steps > 0:
            self.robot.advance(steps)
        self.robot_time_ns = event.robot_time_ns
        if isinstance(event, Sent):
            self.robot.set_targets(np.array(event.lengths_m))
        else:
            self._pending = event if event.settled and event.face is not None else None
        self.last_seq = event.seq
        self._heed_observation()

    def _heed_observation(self) -> None:
        """Once the twin is itself at rest, put it where it was observed, if it stands elsewhere."""
        seen = self._pending
        if seen is None or seen.face is None or not self.robot.is_slow():
            return
        self._pending = None
        if self.robot.footing().face == seen.face:
            return
        targets = self.robot.targets_m()
        at = self.robot.center_of_mass_m()
        self._steps_before_reset = self.step
        self.robot = Robot.resting_on(self.model, seen.face, (float(at[0]), float(at[1])))
        self.robot.set_raw_targets(targets)
        self.resets += 1

    def digest(self) -> str:
        """sha256 of the state, hex: equal for equal event streams."""
        return self.robot.digest()
