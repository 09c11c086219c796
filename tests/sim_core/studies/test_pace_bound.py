# SPDX-License-Identifier: Apache-2.0
"""What the actuators' speed and stroke alone would allow."""

from dataclasses import replace

import numpy as np
import pytest

from sim_core.dynamics.model import build_model
from sim_core.gaits.cycle import turned
from sim_core.structure.symmetry import CARRIERS
from tests.studies import pace_bound
from tests.studies.pace_bound import pace_bounds

STRAIGHT_M = 0.11


@pytest.fixture
def lever(monkeypatch):
    """One strut takes the centre of mass to both edges, 10 mm away, 1 mm a mm: longer in the first stage, shorter in the second."""
    edges = {"TC6": (0.01, np.eye(6)[0]), "TO5": (0.01, -np.eye(6)[0])}
    monkeypatch.setattr(pace_bound, "_edge", lambda model, source, target: edges[source])
    monkeypatch.setattr(pace_bound, "_straight_m", lambda model, turn: STRAIGHT_M)


@pytest.mark.usefixtures("lever")
def test_it_is_the_way_of_the_lever_at_the_actuators_speed(model):
    for bound in pace_bounds(model):
        # back again, too, if the next two rolls have the same lever
        stays = turned(CARRIERS["TC6", "TO5"], bound.turn).struts[0] == 0
        assert bound.two_rolls_s == pytest.approx((2 if stays else 1) * 0.02 / model.prototype.actuator_speed_m_s)
        assert bound.m_per_min == pytest.approx(60.0 * STRAIGHT_M / bound.two_rolls_s)


@pytest.mark.usefixtures("lever")
def test_twice_the_speed_is_half_the_time_and_a_stroke_too_short_is_none(prototype):
    slow, fast = (pace_bounds(build_model(replace(prototype, actuator_speed_m_s=speed))) for speed in (0.01, 0.02))
    assert [b.two_rolls_s for b in slow] == pytest.approx([2.0 * b.two_rolls_s for b in fast])
    short = pace_bounds(build_model(replace(prototype, policy_limit_mm=5)))
    assert [(b.two_rolls_s, b.m_per_min) for b in short] == [(float("inf"), 0.0)] * 2


def test_the_shipped_robot_tips_by_its_levers(model):
    away_m, influence = pace_bound._edge(model, "TC6", "TO5")
    assert 0.02 < away_m < 0.06
    assert np.abs(influence).max() > 0.2
    assert all(0.3 < bound.m_per_min < 3.0 for bound in pace_bounds(model))
