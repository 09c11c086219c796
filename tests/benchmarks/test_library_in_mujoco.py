# SPDX-License-Identifier: Apache-2.0
"""A library's counts in the other engine; the engine itself is not among the packages of the tests."""

import numpy as np

from sim_core.gaits.library import load_library
from tests.benchmarks.solver.library_in_mujoco import Tried, text_of


def test_rolls_for_which_some_gait_works_are_counted_class_by_class():
    library = load_library("robust")
    wins = np.ones((40, 24), dtype=bool)
    first = [p.roll_class.name == library.primitives[0].roll_class.name for p in library.primitives]
    wins[first, 3] = False  # none of this class works for one roll
    wins[-1, :] = False
    tried = Tried(library, wins)
    assert tried.possible == (47, 48)
    assert tried.rates[-1].value == 0.0
    assert tried.rates[0].value == 23 / 24
    text = text_of(tried)
    assert "some gait works for 47 of 48 rolls" in text
    assert "19 at 100 %, 39 above 80 %, 39 at or above 50 %, of 40" in text
