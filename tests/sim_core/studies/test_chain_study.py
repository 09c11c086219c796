# SPDX-License-Identifier: Apache-2.0
"""Cycles rolled on: what is counted of them, on hand-made trials, and a small study of a real one."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim_core.dynamics.actuators import load_actuators
from sim_core.gaits.cycle import TURNS, Cycle, CycleStage
from sim_core.gaits.library import load_library
from sim_core.studies.local_runner import Cost, Trials
from sim_core.uncertainty.perturbation_law import Law
from tests.studies import chain_study as c

PAIR = Cycle("C1", (CycleStage((7, 44, -19, -17, -45, -45), 0.0, 4.6), CycleStage((-24, -21, -30, -41, 45, 15), 0.0, 4.8)))


def trials(reached, feasible, between_s, driven_s, pace_m_s):
    n = len(reached)
    column = lambda values: np.array(values, dtype=np.float32)  # noqa: E731
    zeros = np.zeros(n, dtype=np.float32)
    return Trials(
        np.array(feasible), zeros, column([0.012] * n), zeros, column([60.0] * n), zeros, column(reached), column(pace_m_s),
        column(between_s), column(driven_s), ("",) * n, (True,) * n, tuple("" if ok else "lost" for ok in feasible), Cost(),
    )  # fmt: skip


def test_a_chain_that_missed_counts_the_roll_that_missed():
    found = c._chains(c._Way("C1", c.RANDOM, "ideal"), trials([12, 3], [True, False], [40, 9], [30, 9], [0.02, 0.02]), 2)
    assert (found.rolls.successes, found.rolls.trials) == (15, 16)
    assert (found.whole.successes, found.whole.trials) == (1, 2)
    assert found.misses == (("lost", 1),)
    assert math.isnan(found.m_per_min)


def test_the_way_in_ten_minutes_is_the_long_chains_for_the_time_that_a_strut_may_run():
    found = c._chains(c._Way("C1", TURNS[0], "ideal"), trials([12, 36], [True, True], [40, 130], [30, 100], [0.02, 0.02]), 1)
    assert found.m_per_min == pytest.approx(1.2)
    assert found.m_per_10min == pytest.approx(0.02 * 130 * 120 / 100)
    assert (found.whole.trials, found.rolls.trials) == (1, 12)


def test_it_never_goes_farther_in_ten_minutes_than_its_speed_permits():
    found = c._chains(c._Way("C1", TURNS[0], "ideal"), trials([12, 36], [True, True], [40, 100], [30, 1], [0.02, 0.02]), 1)
    assert found.m_per_10min == pytest.approx(12.0)


def test_a_small_study_rolls_on_and_stops_and_goes(prototype):
    library = replace(load_library("robust"), cycles=(PAIR,))
    found = c.chain_study(prototype, library, Law(0.02), 5, 2, (("stand-in", load_actuators()),))
    assert [(one.cycle, one.turns) for one in found] == [
        *(("C1", t) for t in (*TURNS, c.RANDOM, c.BLIND)),
        (c.STOP_AND_GO, TURNS[0]),
    ]
    straight, blind, rests = found[0], found[3], found[-1]
    assert (blind.rolls.trials, blind.whole.trials) == (2 * c.BLIND_ROLLS, 2)
    assert straight.rolls.successes == straight.rolls.trials == 24
    assert straight.m_per_min > 2.5 * rests.m_per_min > 0.0
    assert straight.m_per_10min > rests.m_per_10min
