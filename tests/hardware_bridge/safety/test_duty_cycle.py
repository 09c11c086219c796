# SPDX-License-Identifier: Apache-2.0
"""The budget of running time, counted spell by spell."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.errors import DutyError
from hardware_bridge.safety.duty_cycle import Duty, check_duty, returns
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.limits import Limits
from hardware_bridge.safety.trajectory import Trajectory
from tests.hardware_bridge.helpers import MID, MID_M

LIMITS = Limits(duty_fraction=0.2, duty_window_s=60.0)
CALIBRATION = load_calibration()
RULES = Rules(CALIBRATION, LIMITS)
FIRST = (True, *(False,) * 5)


def out(stroke_m: float = 0.02, time_s: float = 2.0) -> Trajectory:
    return Trajectory([0.0, time_s], [MID, [MID_M + stroke_m, *MID[1:]]])


def test_only_struts_that_moved_have_run() -> None:
    duty = Duty().ran(FIRST, 0.05, 0.0, LIMITS)
    assert list(duty.used_s(0.0, LIMITS)) == [0.05, 0, 0, 0, 0, 0]
    assert duty.left_s(0.0, LIMITS) == pytest.approx(11.95)


def test_a_window_later_everything_is_forgotten() -> None:
    duty = Duty().ran(FIRST, 12.0, 0.0, LIMITS)
    assert duty.left_s(59.9, LIMITS) == 0.0
    assert duty.left_s(61.1, LIMITS) == pytest.approx(12.0)


def test_the_refusal_says_how_long_to_wait_and_that_is_enough() -> None:
    duty = Duty()
    for second in range(12):
        duty = duty.ran(FIRST, 0.95, float(second), LIMITS)
    with pytest.raises(DutyError) as caught:
        check_duty(duty, out(), 20.0, RULES)
    assert caught.value.strut == "S1"
    assert caught.value.wait_s is not None
    check_duty(duty, out(), 20.0 + caught.value.wait_s, RULES)
    with pytest.raises(DutyError):
        check_duty(duty, out(), 20.0 + caught.value.wait_s - 1.1, RULES)


def test_a_motion_longer_than_the_budget_cannot_be_waited_for() -> None:
    with pytest.raises(DutyError, match="make the motion shorter") as caught:
        check_duty(Duty(), out(0.04, 13.0), 0.0, RULES)
    assert caught.value.wait_s is None


def test_struts_that_rest_in_a_long_motion_need_nothing() -> None:
    check_duty(Duty(), Trajectory([0.0, 2.0, 500.0], [MID, [0.24, *MID[1:]], [0.24, *MID[1:]]]), 0.0, RULES)


@pytest.mark.parametrize(
    ("lengths_m", "back"),
    [
        ([0.254, 0.234], True),
        ([0.254, 0.244, 0.236], True),
        ([0.214, 0.234], True),
        ([0.234, 0.234], True),
        ([0.234, 0.254], False),
        ([0.254, 0.220], False),
        ([0.254, 0.260, 0.234], False),
        ([0.254, 0.234, 0.244], False),
    ],
)
def test_the_way_back_only_nears_mid_stroke(lengths_m: list[float], back: bool) -> None:
    path = Trajectory(np.arange(len(lengths_m)), [[length, *MID[1:]] for length in lengths_m])
    assert returns(path, CALIBRATION) is back


@given(st.lists(st.tuples(st.floats(0.0, 5.0), st.lists(st.booleans(), min_size=6, max_size=6)), max_size=200))
def test_nothing_within_the_window_is_ever_forgotten(frames: list[tuple[float, list[bool]]]) -> None:
    duty, now_s, history = Duty(), 0.0, []
    for pause_s, moved in frames:
        now_s += pause_s
        duty = duty.ran(moved, 0.05, now_s, LIMITS)
        history.append((now_s, moved))
    recent = [moved for at_s, moved in history if at_s > now_s - LIMITS.duty_window_s]
    wanted = 0.05 * np.array(recent, dtype=float).reshape(-1, 6).sum(axis=0)
    assert (duty.used_s(now_s, LIMITS) >= wanted - 1e-9).all()
