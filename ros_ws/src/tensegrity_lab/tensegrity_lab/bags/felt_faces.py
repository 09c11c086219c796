# SPDX-License-Identifier: Apache-2.0
"""What an inertial sensor's measurements in a bag tell of the face, by the estimator of today, beside what was told then."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hardware_bridge.recording.bag_reader import Session, seconds_of
from sim_core.dynamics.robot import Robot
from sim_core.sensing.face_filter import box_share
from sim_core.sensing.face_watch import FaceWatch
from sim_core.structure.rotations import matrix_of

IMU = "imu"
Said = tuple[str, bool]
"""A face, empty: not known; and whether the robot rested on it."""


@dataclass
class FeltFaces:
    """Follows a replay, see `replay`: give it every state of the twin.

    Attributes:
        measurements: in the bag.
        then: what was told live. now: what is told by this replay.
    """

    session: Session
    measurements: int = 0
    then: list[Said] = field(default_factory=list)
    now: list[Said] = field(default_factory=list)
    _watch: FaceWatch | None = None
    _due: Iterator[tuple[float, str, Any]] = field(default_factory=lambda: iter(()))
    _next: tuple[float, str, Any] | None = None

    def __post_init__(self) -> None:
        session = self.session
        sent, measured = list(session.of("bridge/struts_sent")), list(session.of("imu/data"))
        self.measurements = len(measured)
        if not (sent and measured):
            return
        stamps = np.array([seconds_of(m.header.stamp) for m in sent])
        robot_s = np.array([m.robot_time_ns / 1e9 for m in sent])
        origin_s = float(robot_s[0])
        pace = (robot_s[-1] - robot_s[0]) / max(1e-9, stamps[-1] - stamps[0])
        turn = next((np.array(m.mounting) for m in session.of("face_estimate")), np.array((1.0, 0.0, 0.0, 0.0)))
        rotation = matrix_of(turn)
        due: list[tuple[float, str, Any]] = []
        due += [
            (float(at_s), "struts", (list(m.length_m), not m.heartbeat)) for at_s, m in zip(robot_s - origin_s, sent, strict=True)
        ]
        for m in session.of("bridge/face"):
            if m.source == IMU:
                self.then.append((str(m.face), bool(m.settled)))
            elif m.settled:
                due.append((m.robot_time_ns / 1e9 - origin_s, "said", str(m.face)))
        for m in measured:
            rate, up = (rotation @ np.array((told.x, told.y, told.z)) for told in (m.angular_velocity, m.linear_acceleration))
            due.append(((seconds_of(m.header.stamp) - stamps[0]) * pace, "measured", (rate, up)))
        self._due = iter(sorted(due, key=lambda one: one[0]))
        self._next = next(self._due, None)

    def __call__(self, time_s: float, robot: Robot) -> None:
        """The twin at a robot time (s, from the first event): what was measured until then is told of this shape."""
        watch = self._watch = self._watch or FaceWatch(box_share(robot.model))
        watch.shape(robot.joints_m(), robot.box_m(), robot.quaternions()[-1])
        while self._next is not None and self._next[0] <= time_s:
            at_s, kind, told = self._next
            if kind == "struts":
                watch.struts(*told)
            elif kind == "said":
                watch.said(told)
            elif (word := watch.measured(at_s, *told)) is not None:
                self.now.append((word.face, word.settled))
            self._next = next(self._due, None)

    def text(self) -> str:
        """A line for people."""
        count = f"{self.measurements} measurements of the inertial sensor tell"
        if self.now == self.then:
            return f"{count} the same {len(self.now)} faces as then"
        first = next((i for i, pair in enumerate(zip(self.now, self.then, strict=False)) if pair[0] != pair[1]), None)
        first = min(len(self.now), len(self.then)) if first is None else first
        parted = f"they part at number {first + 1}: {_nth(self.now, first)}, then {_nth(self.then, first)}"
        return f"{count} {len(self.now)} faces, then there were {len(self.then)}; {parted}"


def _nth(said: list[Said], number: int) -> str:
    if number >= len(said):
        return "nothing"
    face, settled = said[number]
    return f"{face or 'unknown'}{'' if settled else ', moving'}"
