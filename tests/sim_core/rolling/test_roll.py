# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import pytest

from sim_core.dynamics.model import build_model
from sim_core.errors import NotAdjacentError, PolicyError, UnknownFaceError
from sim_core.gaits.library import load_library
from sim_core.rolling.roll import Sample, roll

GOOD = load_library("robust").gaits("TC6", "TO5")[0].policy


def test_a_feasible_roll_lands_and_stays_on_its_target(model):
    trace: list[Sample] = []
    result = roll(model, "TC6", "TO5", GOOD, trace=trace)
    assert result.feasible
    assert result.reason == ""
    assert result.faces[0] == "TC6"
    assert result.faces[-1] == "TO5"
    assert result.actuated.face == result.returned.face == "TO5"
    assert result.margin_m > 0
    assert len(trace) == pytest.approx(100 * result.duration_s, abs=1)
    assert result.travel_m[0] ** 2 + result.travel_m[1] ** 2 > 0.03**2


def test_a_second_stage_follows_the_first_without_a_stop(model):
    once, twice = (roll(model, "TC6", "TO5", policy) for policy in (GOOD, GOOD * 2))
    assert (twice.faces, twice.feasible) == (once.faces, True), "the second stage asks for nothing new"
    there_and_half_back = roll(model, "TC6", "TO5", GOOD + tuple(stroke // 2 for stroke in GOOD))
    assert there_and_half_back.faces[1] == "TO5"
    assert there_and_half_back.actuated.margin_m != once.actuated.margin_m
    away_and_back = roll(model, "TC6", "TO5", GOOD + (0,) * 6)
    assert away_and_back.faces == once.faces, "it rolled in the first stage, and comes to rest in neutral"


def test_doing_nothing_is_no_roll(model):
    result = roll(model, "TC6", "TO5", (0, 0, 0, 0, 0, 0))
    assert not result.feasible
    assert result.reason == "after actuation it stood on TC6"
    assert result.returned is None


def test_too_much_force_is_not_feasible(model):
    weak = build_model(replace(model.prototype, actuator_stall_n=50.0))
    result = roll(weak, "TC6", "TO5", GOOD)
    assert not result.feasible
    assert "allowed are 40.0 N" in result.reason


def test_too_little_clearance_is_not_feasible(model):
    thick = build_model(replace(model.prototype, strut_diameter_m=0.022))
    result = roll(thick, "TC6", "TO5", GOOD)
    assert not result.feasible
    assert "required are 10.0 mm" in result.reason


def test_not_settling_in_time_is_not_feasible(model):
    restless = build_model(replace(model.prototype, rest_timeout_s=0.3))
    assert roll(restless, "TC6", "TO5", GOOD).reason == "not settled within 0.3 s after actuation"


@pytest.mark.parametrize(
    ("source", "target", "policy", "error", "message"),
    [
        ("TC9", "TO5", GOOD, UnknownFaceError, "'TC9'"),
        ("TC6", "TO1", GOOD, NotAdjacentError, "one roll from TC6 reaches TO5, TO7, TO9"),
        ("TC6", "TO5", (0, 0, 0, 46, 0, 0), PolicyError, r"S4 = 46 mm: valid is .* \[-45, 45\]"),
        ("TC6", "TO5", (0, 0, 0.5, 0, 0, 0), PolicyError, r"S3 = 0\.5 mm"),
        ("TC6", "TO5", (0, float("nan"), 0, 0, 0, 0), PolicyError, "S2 = nan"),
        ("TC6", "TO5", (0, 0, 0), PolicyError, "six strokes"),
    ],
)
def test_a_bad_roll_is_refused_before_anything_moves(model, source, target, policy, error, message):
    with pytest.raises(error, match=message):
        roll(model, source, target, policy)
