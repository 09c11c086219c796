# SPDX-License-Identifier: Apache-2.0
"""The real judge of shapes behind the real bridge rules: what is accepted is good all the way, what is bad is refused whole."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.errors import ShapeError
from hardware_bridge.safety.homing import homing_path
from hardware_bridge.safety.limit_checks import Rules, check_homing, check_trajectory
from hardware_bridge.safety.limits import Limits
from hardware_bridge.safety.shape_cache import ShapeMemory
from hardware_bridge.safety.trajectory import Trajectory
from sim_core.gaits.library import LIBRARIES, load_library
from sim_core.rolling.shape_check import ShapeJudge, ShapeLimits
from sim_core.structure.parameters import load_prototype
from sim_core.structure.policy import in_stages
from tests.hardware_bridge.helpers import MID, MID_M
from tests.scale import examples

PROTOTYPE = load_prototype()
SPEED_M_S = 0.015


@pytest.fixture(scope="module")
def judging() -> Rules:
    return Rules(load_calibration(), Limits(stroke_m=0.05), shape_check=ShapeMemory(ShapeJudge(PROTOTYPE), 6e-4).judge)


@pytest.fixture(scope="module")
def second_judge() -> ShapeJudge:
    """With other limits: a verdict may differ by the last newton with the way on which a shape is come to."""
    limits = ShapeLimits.of(PROTOTYPE)
    return ShapeJudge(PROTOTYPE, replace(limits, force_n=limits.force_n + 1.0, clearance_m=limits.clearance_m - 1e-4))


def out(policy_mm: tuple[int, ...]) -> Trajectory:
    """From mid stroke, each strut at its speed until it is there; stage by stage, if the policy has two."""
    times, lengths, before, began_s = list[float](), list[np.ndarray](), np.zeros(6), 0.0
    for stage in in_stages(policy_mm):
        ways = 1e-3 * np.array(stage) - before
        stops = sorted({round(abs(way) / SPEED_M_S, 6) for way in ways if way} or {0.1})
        times += [began_s + stop for stop in stops]
        lengths += [MID_M + before + np.sign(ways) * np.minimum(abs(ways), SPEED_M_S * stop) for stop in stops]
        before, began_s = before + ways, times[-1]
    return Trajectory(times, lengths)


@pytest.mark.slow
@pytest.mark.parametrize("library", sorted(path.stem for path in LIBRARIES.glob("*.yaml")))
def test_every_shipped_policy_is_accepted_and_so_is_the_way_back(judging: Rules, library: str) -> None:
    for primitive in load_library(library).primitives:
        check_trajectory(judging, MID, out(primitive.policy))
        for stage in in_stages(primitive.policy):
            pulses = judging.calibration.pulses_us([MID_M + 1e-3 * stroke for stroke in stage])
            check_homing(judging, pulses, homing_path(judging, pulses))


def test_six_struts_at_their_shortest_are_refused(judging: Rules) -> None:
    with pytest.raises(ShapeError, match=r"tendons are slack .* the limit is 6") as caught:
        check_trajectory(judging, MID, out((-50,) * 6))
    assert -0.045 < caught.value.lengths_m[0] - MID_M < -0.030, "where the tendons go slack, not only at the end"


def test_homing_from_a_collapsed_robot_is_refused(judging: Rules) -> None:
    pulses = judging.calibration.pulses_us([MID_M - 0.05] * 6)
    with pytest.raises(ShapeError, match="tendons are slack"):
        check_homing(judging, pulses, homing_path(judging, pulses))


@settings(max_examples=examples(12), deadline=None)
@given(st.tuples(*[st.integers(-50, 50)] * 6) | st.tuples(*[st.integers(-45, -25)] * 6) | st.tuples(*[st.integers(40, 50)] * 6))
def test_what_is_accepted_is_good_in_every_frame(judging: Rules, second_judge: ShapeJudge, policy_mm: tuple[int, ...]) -> None:
    try:
        path = check_trajectory(judging, MID, out(policy_mm))
    except ShapeError:
        return
    second_judge(MID)
    for time_s in np.arange(0.0, path.duration_s, 0.05):
        assert second_judge(path.at(time_s)) is None
