"""A twin that follows what really happened to the robot, bit for bit the same live and from a bag.

The bridge numbers everything that happens to the robot — rest lengths sent to the board, faces observed — in one stream. The
twin's state is a
function of that stream alone: each event first brings the model to the event's robot time, in whole steps, then acts.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np

from sim_core import actuators
from sim_core.actuators import PERIOD_S, ActuatorParameters, hash_of
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

    def __init__(self, model: Model, face: str = "TC6", parameters: ActuatorParameters | None = None):
        """A twin resting on `face` until the first event.

        Args:
            parameters: of its actuators, for a model of a `following` prototype; None: the solver's own, which feel no load.

        Raises:
            UnknownFaceError.
        """
        self.model = model
        self.robot = Robot.resting_on(model, face)
        self.first_seq = self.last_seq = 0
        self.robot_time_ns = 0
        self.resets = 0
        self._origin = 0
        self._steps_before_reset = 0
        self._pending: Observed | None = None
        self._parameters = parameters
        self._commanded_m = self.robot.targets_m()
        self._actuators = self._resting_actuators()

    @property
    def identity(self) -> str:
        """Two followers with the same one give the same bits for the same events: the model's hash, and its actuators'."""
        return self.model.hash if self._parameters is None else f"{self.model.hash}-{hash_of(self._parameters)}"

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
            self._advance(steps)
        self.robot_time_ns = event.robot_time_ns
        if isinstance(event, Sent):
            self._commanded_m = self.model.rest_lengths(np.array(event.lengths_m))
            if self._actuators is None:
                self.robot.set_raw_targets(self._commanded_m)
        else:
            self._pending = event if event.settled and event.face is not None else None
        self.last_seq = event.seq
        self._heed_observation()

    def _advance(self, steps: int) -> None:
        """The actuators look at their load at whole periods since the first event, wherever events cut the time between."""
        if self._parameters is None or self._actuators is None:
            self.robot.advance(steps)
            return
        period = round(PERIOD_S * self.model.steps_per_second)
        while steps > 0:
            if self.step % period == 0:
                self._actuators = actuators.step(
                    self._parameters,
                    self._actuators,
                    self._commanded_m,
                    self.robot.strut_forces_n(),
                    self.model.elements.strut_mid_m,
                    period / self.model.steps_per_second,
                )
                self.robot.set_raw_targets(actuators.lengths_m(self._parameters, self._actuators))
            taken = min(steps, period - self.step % period)
            self.robot.advance(taken)
            steps -= taken

    def _resting_actuators(self) -> actuators.Actuators | None:
        if self._parameters is None:
            return None
        return actuators.at_rest(self._parameters, self.robot.rest_lengths_m(), self.robot.strut_forces_n())

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
