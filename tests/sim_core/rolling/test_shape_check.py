# SPDX-License-Identifier: Apache-2.0
"""Shapes that the structure may take, and those it must not."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from sim_core.gaits.library import LIBRARIES, load_library
from sim_core.rolling.shape_check import ShapeJudge, ShapeLimits
from sim_core.structure.parameters import load_prototype
from sim_core.structure.policy import in_stages

PROTOTYPE = load_prototype()
MID_M = PROTOTYPE.strut_length_m
NEUTRAL = (MID_M,) * 6


@pytest.fixture(scope="module")
def judge() -> ShapeJudge:
    return ShapeJudge(PROTOTYPE)


def lengths(policy_mm, part=1.0):
    return tuple(MID_M + 1e-3 * part * stroke for stroke in policy_mm)


def test_neutral_is_permitted_and_under_even_load(judge):
    assert judge(NEUTRAL) is None
    shape = judge.shape(NEUTRAL)
    assert shape.slack == ()
    assert shape.forces_n == pytest.approx(np.full(6, shape.forces_n.mean()), rel=0.02), "all struts are alike by symmetry"
    assert shape.forces_n.max() < 0.0, "struts are pressed"


@pytest.mark.slow
@pytest.mark.parametrize("library", sorted(path.stem for path in LIBRARIES.glob("*.yaml")))
def test_every_shipped_policy_is_permitted_on_all_its_way_there_and_back(judge, library):
    for primitive in load_library(library).primitives:
        for start, end in pairwise([(0,) * 6, *in_stages(primitive.policy), (0,) * 6]):
            furthest_mm = max(abs(b - a) for a, b in zip(start, end, strict=True))
            for part in np.linspace(0.0, 1.0, furthest_mm + 1):
                assert judge(lengths(np.array(start) + part * np.subtract(end, start))) is None, primitive.name


@pytest.mark.parametrize("stroke_mm", [-40, -50])
def test_six_short_struts_leave_the_tendons_slack(judge, stroke_mm):
    problem = judge(lengths([stroke_mm] * 6))
    assert problem is not None
    assert "tendons are slack (T1, " in problem
    assert problem.endswith("the limit is 6")


def test_after_a_refusal_good_shapes_are_good_again(judge):
    assert judge(lengths([-50] * 6)) is not None
    assert judge(NEUTRAL) is None


def test_a_force_beyond_the_limit_names_the_strut():
    weak = ShapeJudge(replace(PROTOTYPE, actuator_stall_n=40.0))
    assert weak(NEUTRAL) is None
    problem = weak(lengths([40] * 6))
    assert problem is not None
    assert problem.startswith("S")
    assert "is outside the limit ±32.0 N" in problem


def test_a_gap_below_the_limit_names_the_struts():
    limits = ShapeLimits.of(PROTOTYPE)
    wide = ShapeJudge(PROTOTYPE, replace(limits, clearance_m=0.1))
    problem = wide(NEUTRAL)
    assert problem is not None
    assert problem.split(":")[0].count("S") == 2
    assert "is below the limit 100.0 mm" in problem


def test_a_shape_does_not_depend_on_the_way_to_it_by_more_than_a_newton(judge):
    policy = (-32, 45, -26, -19, -45, -22)
    judge(NEUTRAL)
    at_once = judge.shape(lengths(policy))
    judge(NEUTRAL)
    for part in np.linspace(0.0, 1.0, 46):
        step_by_step = judge.shape(lengths(policy, part))
    assert step_by_step.forces_n == pytest.approx(at_once.forces_n, abs=1.0)
    assert step_by_step.clearance_m == pytest.approx(at_once.clearance_m, abs=2e-4)
