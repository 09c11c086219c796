# SPDX-License-Identifier: Apache-2.0
"""The demonstration of learning, as small as it can be: what it counts adds up, and the hidden robot stays hidden."""

from dataclasses import replace

import pytest

from sim_core.dynamics.model import build_model
from sim_core.gaits.library import load_library
from sim_core.structure.parameters import load_prototype
from sim_core.studies.binomial_intervals import rate_of
from sim_core.studies.ensemble_fit import wins_of
from sim_core.studies.gait_learning import gaits_of, roll_of
from tests.studies.learning import Setting, demonstrate, hidden_robot
from tests.studies.learning_page import page_of

SMALL = Setting(robots=1, trials=12, primitives=1, members=8, rounds=1, searched=0)


@pytest.mark.slow
def test_a_demonstration_counts_what_the_hidden_robot_does():
    model, library = build_model(load_prototype()), load_library("improved")
    titles = []

    def bar(title):
        titles.append(title)
        return lambda done, all_of_it: None

    shown = demonstrate(model, library, SMALL, bar)
    (case,) = shown.cases
    assert (shown.gaits, shown.held_out) == (48, 36)
    assert case.hidden == hidden_robot(SMALL.prior, SMALL.seed, 0)
    assert case.hidden not in case.found.members
    first = {name: [p for p in library.primitives if p.roll_class.name == name][:1] for name in ("TC6-TO5", "TO5-TC6")}
    gaits = gaits_of([p for row in first.values() for p in row])
    possible = int(wins_of(model, [case.hidden], [(roll_of(gait), True) for gait in gaits]).sum())
    assert case.chosen == (possible,) * 3, "with one gait a roll there is no choice"
    assert titles[0] == "hidden robots"
    assert "A library for this robot" not in page_of(shown, model.hash), "none was searched"
    page = page_of(replace(shown, cases=(replace(case, libraries=(rate_of(3, 4), rate_of(4, 4))),)), model.hash)
    assert "| 1 | 3 of 4, 75.0 % | 4 of 4, 100.0 % |" in page
