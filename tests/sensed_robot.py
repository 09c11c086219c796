# SPDX-License-Identifier: Apache-2.0
"""A hidden robot with an inertial sensor in its box, a nominal twin, and the watch that is told of both: without ROS, fast."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hardware_bridge.virtual_prototype.inertial_sensor import InertialSensor
from sim_core.dynamics.model import Model
from sim_core.dynamics.robot import Robot
from sim_core.sensing.face_filter import box_share
from sim_core.sensing.face_watch import FaceWatch, Word
from sim_core.structure.policy import in_stages, lengths_of, neutral_lengths
from sim_core.uncertainty.perturbation_law import inclined, perturb

SAMPLE_S = 0.01
LOOKS = 5
"""Samples between shapes of the twin."""
MOUNTED_RAD = math.radians(1.0)
"""What a calibration leaves of the mounting."""
SETTLE_S = 6.0
Sample = tuple[float, NDArray[np.float64], NDArray[np.float64]]


@dataclass
class SensedRobot:
    """Attributes: words: said by the watch, with their time. faces: that the robot stood on, with the time from which on."""

    nominal: Model
    face: str
    seed: int
    perturbation: float = 0.1
    incline_deg: float = 0.0
    spoil: Callable[[Sample], Sample | None] = lambda sample: sample
    words: list[tuple[float, Word]] = field(default_factory=list)
    faces: list[tuple[float, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        model = perturb(self.nominal, self.perturbation, self.seed) if self.perturbation else self.nominal
        model = inclined(model, self.incline_deg, self.seed) if self.incline_deg else model
        self.robot, self.twin = Robot.resting_on(model, self.face), Robot.resting_on(self.nominal, self.face)
        self.sensor = InertialSensor(self.robot, self.seed, MOUNTED_RAD)
        self.watch = FaceWatch(box_share(self.nominal))
        self.watch.said(self.face)
        self.watch.tell_again()  # and the sensor says so, too
        self.faces.append((0.0, self.face))
        self._measured_s = 0.0
        self._samples, self._per_sample = 0, round(SAMPLE_S * model.steps_per_second)
        self.wait(1.0)

    @property
    def time_s(self) -> float:
        """Since the beginning, one second before anything moved."""
        return self._samples * SAMPLE_S

    @property
    def driven(self) -> bool:
        """Struts are on their way."""
        return bool(np.abs(self.robot.targets_m() - self.robot.rest_lengths_m()).max() > 1e-6)

    def step(self) -> Word | None:
        """One sample on; what the watch says to it."""
        for robot in (self.robot, self.twin):
            robot.advance(self._per_sample)
        self._samples += 1
        if self._samples % LOOKS == 0:
            self.watch.shape(self.twin.joints_m(), self.twin.box_m(), self.twin.quaternions()[-1])
        if (face := self.robot.face_under()) and face != self.faces[-1][1]:
            self.faces.append((self.time_s, face))
        self.watch.struts(self.robot.rest_lengths_m(), self.driven)
        sample = self.spoil((self.time_s, *self.sensor.measure()))
        self._measured_s = self.time_s if sample is not None else self._measured_s
        word = self.watch.measured(*sample) if sample is not None else self.watch.missing(self.time_s - self._measured_s)
        if word is not None:
            self.words.append((self.time_s, word))
        return word

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / SAMPLE_S)):
            self.step()

    def drive(self, policy: Sequence[int] | None, until: str = "", most_s: float = 12.0) -> None:
        """To a policy's lengths, stage by stage, or to neutral (None); `until` this face is said, or the struts are there."""
        prototype = self.nominal.prototype
        stages = [lengths_of(prototype, stage) for stage in in_stages(tuple(policy))] if policy else [neutral_lengths(prototype)]
        for lengths in stages:
            for robot in (self.robot, self.twin):
                robot.set_targets(lengths)
            end_s = self.time_s + most_s
            self.step()
            while self.time_s < end_s and (self.watch.known != until if until else self.driven):
                self.step()

    def rest(self) -> None:
        """As the planner waits: until a word says that it is at rest, or for `SETTLE_S`."""
        end_s = self.time_s + SETTLE_S
        while self.time_s < end_s and not ((word := self.step()) and word.settled):
            pass
        self.wait(0.2)

    def roll(self, policy: Sequence[int]) -> str:
        """A roll from rest to rest in neutral; the face that it stands on then (empty: on none)."""
        self.drive(policy)
        self.wait(2.0)
        self.drive(None)
        self.rest()
        return self.robot.footing().face or ""
