# SPDX-License-Identifier: Apache-2.0
"""One robot through one watched roll, sample by sample: `roll_monitor` and `quasi_static` for a single robot."""

from __future__ import annotations

import numpy as np

from sim_core.dynamics.robot import Robot
from sim_core.rolling import quasi_static as q
from sim_core.rolling import roll_monitor as w
from sim_core.structure.elements import PREVIOUS
from sim_core.structure.policy import neutral_lengths


class RollStepper:
    """Watches a robot roll.

    Attributes:
        record: (RECORD,) the roll's course, see `roll_monitor`.
    """

    def __init__(self, robot: Robot, rules: w.Rules, source: int, aim: int, tolerance: float):
        """The record begins now. Set the robot's targets after this, and before the first `step`.

        Args:
            robot: the robot that rolls; stepped in place.
            rules: what is judged by.
            source: number of the face it stands on.
            aim: number of the wanted face; −1: whatever it lands on.
            tolerance: of a quasi-static step's net force, squared.
        """
        self.robot, self.record = robot, np.zeros(w.RECORD)
        self._rules, self._tolerance = rules, tolerance
        self._track = np.zeros(q.TRACK_ROWS) if robot.model.kind == PREVIOUS else None
        self._begun = False
        state, work = robot.arrays()
        neutral = robot.model.rest_lengths(neutral_lengths(robot.model.prototype))
        w.begin(state, work, self.record, rules, robot.model.layout.struts, source, aim, neutral)

    @property
    def going_on(self) -> bool:
        """Whether the roll is not over yet."""
        return bool(self.record[w.PHASE] in (w.ACTUATING, w.RETURNING))

    def step(self, steps: int) -> None:
        """One sample: so many steps of the solver and a look; of the previous model, a piece of relaxation and a look.

        May send the struts back to neutral.
        """
        m = self.robot.model
        state, work = self.robot.arrays()
        if self._track is None:
            self.robot.advance(steps)
            w.look(state, work, self.record, self._rules, m.layout.struts)
            return
        if not self._begun:
            q.step_lengths(state, m.layout.struts)
            self._begun = True
        q.relax(state, m.par, work, self._track, m.assembly, m.dt_s, m.reach_m, q.LOOK_STEPS)
        self.robot.step += q.LOOK_STEPS
        q.look(state, work, self._track, self.record, self._rules, m.layout.struts, self._tolerance)
