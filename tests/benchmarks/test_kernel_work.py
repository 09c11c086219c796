# SPDX-License-Identifier: Apache-2.0
"""A step's work, counted: a slower kernel is found here, whatever the computer does meanwhile. No clock decides a test."""

import numpy as np
import pytest

from sim_core.dynamics import vfife
from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.structure.parameters import load_prototype
from tests.benchmarks.kernel_work import ARITHMETIC, MEMORY, compiled_operations, count_step

# Most that one robot's step may cost (eight robots in a vector share each operation). Lower them when the kernel gets leaner.
MOST_ARITHMETIC = {"in the air": 6000, "at rest": 6300}
MOST_DIVISIONS_AND_ROOTS = {"in the air": 145, "at rest": 148}
MOST_MEMORY = {"in the air": 2900, "at rest": 3150}


@pytest.fixture(scope="module")
def model():
    return build_model(load_prototype())


@pytest.fixture
def robot(model, where):
    if where == "at rest":
        return Robot.resting_on(model, "TC6")
    robot = Robot(model)
    robot.place(np.eye(3), np.array([0.0, 0.0, 1.0]))
    return robot


both = pytest.mark.parametrize("where", ["in the air", "at rest"])


@both
def test_a_step_stays_within_its_budget(model, robot, where):
    tally = count_step(model, *robot.rows())
    assert sum(tally[kind] for kind in ARITHMETIC) <= MOST_ARITHMETIC[where], tally
    assert tally["divide"] + tally["root"] <= MOST_DIVISIONS_AND_ROOTS[where], tally
    assert sum(tally[kind] for kind in MEMORY) <= MOST_MEMORY[where], tally


@both
def test_what_is_counted_is_what_is_compiled(model, robot, where):
    m, (state, work) = model, robot.rows()
    count_step(m, state, work)
    own_state, own_work = robot.rows()
    vfife.advance(own_state, m.par, own_work, m.assembly, m.dt_s, m.elements.zeta_1_s, m.reach_m, 1)
    assert state.tobytes() == own_state.tobytes()
    assert work.tobytes() == own_work.tobytes()


def test_eight_robots_cost_the_instructions_of_one(model):
    found = compiled_operations(model)
    packed, single = (sum(found[width].values()) for width in ("packed", "single"))
    assert packed > 500  # the formulas are there ...
    assert single < 20  # ... and what is left for single numbers are the step's own constants
