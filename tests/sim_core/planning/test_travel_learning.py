# SPDX-License-Identifier: Apache-2.0
"""What a travel learns from its own rolls."""

import math

import numpy as np
import pytest

from sim_core.gaits.library import gait_of, load_library
from sim_core.planning.floor_planner import LEVEL
from sim_core.planning.travel_learning import LEAST_SURE, MOST_SURE, SPREAD_LEAN, Experience
from sim_core.structure.roll_classes import TC_TO

NORTH, SOUTH = math.pi / 2, -math.pi / 2
LIKELY, CLIMBS_DEG = 0.9, 2.0
P, OTHER = [p for p in load_library("robust").primitives if p.roll_class == TC_TO][:2]
GAIT, SAME_ROLL, SAME_PRIMITIVE, UNRELATED = (
    gait_of(primitive, "TC6", target) for primitive, target in ((P, "TO5"), (OTHER, "TO5"), (P, "TO7"), (OTHER, "TO9"))
)


@pytest.fixture
def experience():
    return Experience(lambda gait: LIKELY, lambda gait: CLIMBS_DEG)


def test_before_any_roll_it_is_what_was_known_but_never_quite_sure(experience):
    assert experience.probability(GAIT) == pytest.approx(LIKELY)
    assert experience.lean == LEVEL
    assert Experience(lambda gait: 1.0).probability(GAIT) == pytest.approx(MOST_SURE)
    assert Experience(lambda gait: 0.0).probability(GAIT) == pytest.approx(LEAST_SURE)


def test_a_miss_tells_most_of_its_own_gait_and_something_of_its_kin(experience):
    experience.add(GAIT, NORTH, False)
    likely = [experience.probability(gait) for gait in (GAIT, SAME_PRIMITIVE, UNRELATED, SAME_ROLL)]
    assert likely[0] < likely[1] < likely[2] < LIKELY
    assert likely[0] < likely[3] < likely[2]


def test_misses_one_way_and_rolls_the_other_way_are_a_slope_and_not_the_gaits(experience):
    for _ in range(3):
        for gait in (GAIT, SAME_ROLL, SAME_PRIMITIVE, UNRELATED):
            experience.add(gait, NORTH, False)
            experience.add(gait, SOUTH, True)
    x, y = experience.lean
    assert y < -2.0
    assert abs(x) < 0.1
    likely = experience.probability(GAIT)
    assert 0.3 < likely < LIKELY + 0.05, "on level ground it would still roll"


def test_misses_uphill_of_steep_climbers_tell_of_steeper_ground():
    found = []
    for climbs_deg in (1.0, 4.0):
        one = Experience(lambda gait: LIKELY, lambda gait, deg=climbs_deg: deg)
        for _ in range(4):
            one.add(GAIT, NORTH, False)
            one.add(SAME_PRIMITIVE, SOUTH, True)
        found.append(one.lean[1])
    assert found[1] < found[0] < -1.0


def test_successes_make_it_surer(experience):
    for _ in range(4):
        experience.add(GAIT, 0.3, True)
    assert experience.probability(GAIT) > LIKELY


def test_the_order_of_rolls_does_not_matter():
    rolls = [(GAIT, 0.1, True), (SAME_ROLL, 2.0, False), (GAIT, -1.0, False), (UNRELATED, 0.7, True)]
    found = []
    for order in (rolls, rolls[::-1]):
        one = Experience(lambda gait: LIKELY, lambda gait: CLIMBS_DEG)
        for roll in order:
            one.add(*roll)
        found.append([*one.lean, *(one.probability(gait) for gait, _, _ in rolls)])
    assert np.allclose(*found, atol=1e-6)


def test_the_mode_is_the_posteriors_maximum():
    """One gait, one roll: against the closed form's own condition, effect/σ² = won − p."""
    one = Experience(lambda gait: LIKELY, lambda gait: CLIMBS_DEG)
    one.add(GAIT, NORTH, False)
    p = 1.0 / (1.0 + math.exp(-math.log(one.probability(GAIT) / (1.0 - one.probability(GAIT))) - one.lean[1] / CLIMBS_DEG))
    assert one.lean[1] / SPREAD_LEAN**2 == pytest.approx((0.0 - p) / CLIMBS_DEG, abs=1e-6)
