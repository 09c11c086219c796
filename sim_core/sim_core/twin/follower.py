# SPDX-License-Identifier: Apache-2.0
"""A twin that follows what really happened to the robot, bit for bit the same live and from a bag.

The bridge numbers everything that happens to the robot — rest lengths sent to the board, faces observed — in one stream. The
twin's state is a function of that stream alone: each event first brings the model to the event's robot time, in whole steps, then
acts.
"""

import heapq
from dataclasses import dataclass

import numpy as np

from sim_core.dynamics import actuators
from sim_core.dynamics.actuators import PERIOD_S, ActuatorParameters, hash_of
from sim_core.dynamics.model import Model
from sim_core.dynamics.robot import Robot
from sim_core.errors import brief
from sim_core.structure.topology import FACES


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

AT_REST, IN_MOTION = 1, 2
"""Rules of how observations correct a twin, by number: at rest only, as all bags that name none were recorded; in motion too."""
RULE = IN_MOTION
"""Of new streams."""
PATIENCE_NS = 500_000_000
"""Robot time that a moving twin has to come by itself onto a face on which the robot was seen."""
MOST_TIME_SCALE = 1000
"""Robot seconds per second: more than a twin can step, of a fast virtual prototype in a bag that is played fast."""
CREDIT_S = 600.0
"""Robot time that may pass at once: events that waited somewhere come in one burst."""
MOST_ROBOT_TIME_NS = 10 * 365 * 86_400 * 1_000_000_000
MOST_STROKE_M = 0.15
"""As far as a calibration may say that an actuator goes."""
EVENTS_PER_S = 1000
"""More than a bridge ever numbers in a second of robot time."""
SLICE_S = 2.0
"""Robot time that is stepped without a look at anything else."""


def impossible(event: Event, mid_stroke_m: float) -> str:
    """Why no bridge can have told this event of struts of that mid stroke (m); empty: it can have."""
    if not 0 <= event.robot_time_ns <= MOST_ROBOT_TIME_NS:
        return f"robot time {event.robot_time_ns / 1e9:.4g} s is impossible"
    if event.seq < 1:
        return f"event number {event.seq} is impossible"
    if isinstance(event, Sent):
        for number, length in enumerate(event.lengths_m, start=1):
            if not abs(length - mid_stroke_m) <= MOST_STROKE_M:  # also not-a-number
                return f"a length of {length:.4g} m of S{number} is impossible"
    elif event.face is not None and event.face not in FACES:
        return f"a robot has no face {brief(event.face)}"
    return ""


class Pace:
    """Keeps a stream's robot time to the pace of another clock: no number in an event becomes unbounded work."""

    def __init__(self) -> None:
        self._robot_ns: int | None = None
        self._seq = 0
        self._clock_ns = 0
        self._credit_ns = 0

    def refuses(self, event: Event, clock_ns: int) -> str:
        """Why an event cannot follow those before, at a time of that clock (ns); empty: it can, and is taken note of."""
        if self._robot_ns is None:
            self._robot_ns, self._seq, self._clock_ns, self._credit_ns = event.robot_time_ns, event.seq, clock_ns, _ns(CREDIT_S)
            return ""
        ahead_ns = event.robot_time_ns - self._robot_ns
        credit_ns = min(self._credit_ns, _ns(CREDIT_S)) + MOST_TIME_SCALE * max(0, clock_ns - self._clock_ns)
        if ahead_ns > credit_ns:
            return f"robot time jumps by {ahead_ns / 1e9:.4g} s at event {event.seq}, faster than any robot's clock"
        if event.seq - self._seq > EVENTS_PER_S * (1 + max(0, ahead_ns) / 1e9):
            return f"the number of event {event.seq} jumps by {event.seq - self._seq}, farther than any bridge counts"
        self._credit_ns = credit_ns - max(0, ahead_ns)
        self._robot_ns, self._seq = max(self._robot_ns, event.robot_time_ns), max(self._seq, event.seq)
        self._clock_ns = clock_ns
        return ""


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)


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
        corrected_from: the face on which the twin stood when the last event put it on another one; None: that did not.
    """

    def __init__(self, model: Model, face: str = "TC6", parameters: ActuatorParameters | None = None, rule: int = RULE):
        """A twin resting on `face` until the first event. Raises UnknownFaceError.

        `parameters`: of its actuators, for a model of a `following` prototype; None: the solver's own, which feel no load.
        `rule`: of corrections.
        """
        self.model = model
        self.robot = Robot.resting_on(model, face)
        self.first_seq = self.last_seq = 0
        self.robot_time_ns = 0
        self.resets = 0
        self._origin = 0
        self._steps_before_reset = 0
        self._pending: Observed | None = None
        self.corrected_from: str | None = None
        self._rule = rule
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

    def approach(self, event: Event) -> bool:
        """Step towards the event's time, at most SLICE_S of robot time; whether it is reached.

        Slices change no bit. Who has something else to do calls this until it is reached, then `apply`.

        Raises:
            DivergedError.
        """
        at = event.robot_time_ns * self.model.steps_per_second // 1_000_000_000
        if self.first_seq == 0:
            self.first_seq = event.seq
            self._origin = at - self.step
        steps = at - self._origin - self.step
        most = round(SLICE_S * self.model.steps_per_second)
        if steps > 0:
            self._advance(min(steps, most))
        return steps <= most

    def apply(self, event: Event) -> None:
        """Bring the model to the event's time, then act on it. Events must come in the order of their numbers.

        Raises:
            DivergedError.
        """
        while not self.approach(event):
            pass
        self.robot_time_ns = event.robot_time_ns
        if isinstance(event, Sent):
            self._commanded_m = self.model.rest_lengths(np.array(event.lengths_m))
            if self._actuators is None:
                self.robot.set_raw_targets(self._commanded_m)
        else:
            heeds = event.settled or self._rule >= IN_MOTION
            self._pending = event if heeds and event.face is not None else None
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
        """Put the twin where the robot was observed, if it stands elsewhere: once it is itself at rest; in motion, in time."""
        self.corrected_from, seen = None, self._pending
        if seen is None or seen.face is None:
            return
        if seen.settled and not self.robot.is_slow():
            return
        here = self.robot.footing().face if seen.settled else self.robot.face_under()
        if not seen.settled and here != seen.face and self.robot_time_ns - seen.robot_time_ns < PATIENCE_NS:
            return
        self._pending = None
        if here == seen.face:
            return
        self.corrected_from = here or ""
        self.resets += 1
        at, targets = self.robot.center_of_mass_m(), self.robot.targets_m()
        center = float(at[0]), float(at[1])
        self._steps_before_reset = self.step
        if seen.settled:
            self.robot = Robot.resting_on(self.model, seen.face, center)
        else:
            self.robot = Robot.standing_on(self.model, seen.face, self.robot.rest_lengths_m(), center)
        self.robot.set_raw_targets(targets)

    def digest(self) -> str:
        """sha256 of the state, hex: equal for equal event streams."""
        return self.robot.digest()
