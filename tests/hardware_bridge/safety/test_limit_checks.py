# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from hardware_bridge.errors import LimitError, ShapeError
from hardware_bridge.safety.homing import homing_path
from hardware_bridge.safety.limit_checks import Rules, check_frame, check_homing, check_trajectory
from hardware_bridge.safety.limits import Limits
from hardware_bridge.safety.trajectory import Trajectory
from tests.hardware_bridge.helpers import MID, MID_M


def one_strut(index: int, stroke_m: float, time_s: float = 10.0) -> Trajectory:
    lengths = np.array(MID)
    lengths[index] += stroke_m
    return Trajectory([time_s], [lengths])


def spread(lengths_m: tuple[float, ...]) -> str | None:
    return "too crooked" if max(lengths_m) - min(lengths_m) > 0.06 else None


def test_a_whole_policy_at_actuator_speed_is_permitted(rules: Rules) -> None:
    strokes = np.array([0.045, -0.045, 0.03, -0.03, 0.0, 0.001])
    knots = sorted({abs(stroke) / 0.015 for stroke in strokes} - {0.0})
    lengths = [MID_M + np.sign(strokes) * np.minimum(np.abs(strokes), 0.015 * time) for time in knots]
    path = check_trajectory(rules, MID, Trajectory(knots, lengths))
    assert path.times_s[0] == 0.0


@pytest.mark.parametrize("stroke_m", [0.0451, -0.0451, 0.2, -0.3])
def test_a_stroke_beyond_the_limit_names_strut_value_and_limit(rules: Rules, stroke_m: float) -> None:
    with pytest.raises(LimitError) as caught:
        check_trajectory(rules, MID, one_strut(2, stroke_m, 100.0))
    error = caught.value
    assert (error.strut, error.quantity, error.unit) == ("S3", "stroke", "mm")
    assert error.value == pytest.approx(stroke_m * 1e3)
    assert error.limit == pytest.approx(45.0 * np.sign(stroke_m))
    assert "S3: stroke" in str(error)


def test_the_calibrations_own_stroke_holds_where_it_is_narrower(rules: Rules) -> None:
    narrow = replace(rules.calibration.struts[5], stroke_mm=(-20.0, 30.0))
    calibration = replace(rules.calibration, struts=(*rules.calibration.struts[:5], narrow))
    with pytest.raises(LimitError) as caught:
        check_trajectory(replace(rules, calibration=calibration), MID, one_strut(5, -0.021))
    assert (caught.value.strut, caught.value.limit) == ("S6", pytest.approx(-20.0))


def test_too_fast_names_strut_speed_and_time(rules: Rules) -> None:
    with pytest.raises(LimitError, match=r"S2: speed 30 mm/s from 0\.000 to 1\.000 s is outside the limit 20 mm/s"):
        check_trajectory(rules, MID, one_strut(1, 0.03, 1.0))


def test_a_step_beyond_the_limit_is_refused_even_if_the_speed_is_not(rules: Rules) -> None:
    brisk = replace(rules, limits=Limits(speed_m_s=0.1, step_m=0.002))
    with pytest.raises(LimitError, match="S2: step of a frame 4 mm"):
        check_trajectory(brisk, MID, one_strut(1, 0.04, 0.5))


def test_a_first_knot_at_time_zero_must_be_where_the_strut_is(rules: Rules) -> None:
    lengths = np.array([MID, MID])
    lengths[0, 3] += 0.001
    with pytest.raises(LimitError, match="S4: jump 1 mm from the present"):
        check_trajectory(rules, MID, Trajectory([0.0, 1.0], lengths))


def test_a_bad_shape_between_good_knots_is_found(rules: Rules) -> None:
    judged = replace(rules, shape_check=lambda lengths: "thin" if abs(lengths[0] - 0.240) < 0.0004 else None)
    ends = Trajectory([0.01, 2.0], [MID, [0.250, *MID[1:]]])
    with pytest.raises(ShapeError, match=r"at .* s is not permitted: thin"):
        check_trajectory(judged, MID, ends)


def test_a_bad_shape_at_a_knot_is_found(rules: Rules) -> None:
    strokes = np.array([0.04, -0.04, 0, 0, 0, 0])
    with pytest.raises(ShapeError, match="too crooked"):
        check_trajectory(replace(rules, shape_check=spread), MID, Trajectory([5.0], [MID_M + strokes]))


def test_homing_may_come_from_beyond_the_policy_bound_but_not_from_beyond_the_actuator(rules: Rules) -> None:
    for pulses in ((2000,) * 6, (1000, 2000, 1500, 1500, 1500, 1500)):
        check_homing(rules, pulses, homing_path(rules, pulses))
    with pytest.raises(LimitError, match="S1: pulse 2001 us"):
        check_homing(rules, (2001,) * 6, homing_path(rules, (2000,) * 6))


def test_homing_through_a_bad_shape_is_refused(rules: Rules) -> None:
    pulses = (1000, 2000, 1500, 1500, 1500, 1500)
    with pytest.raises(ShapeError):
        check_homing(replace(rules, shape_check=spread), pulses, homing_path(rules, pulses))


BEFORE = (1500,) * 6


@pytest.mark.parametrize(
    ("pulses", "before", "duration_ms", "says"),
    [
        ((2001, *BEFORE[1:]), (1995, *BEFORE[1:]), 55, "pulse"),
        ((1952, *BEFORE[1:]), (1950, *BEFORE[1:]), 55, "stroke"),
        ((1525, *BEFORE[1:]), BEFORE, 500, "step of a frame"),
        ((1515, *BEFORE[1:]), BEFORE, 55, "speed"),
        ((1501, *BEFORE[1:]), (None, *BEFORE[1:]), 55, "unknown position"),
    ],
)
def test_the_last_gate_lets_no_bad_frame_through(
    rules: Rules, pulses: tuple[int, ...], before: tuple[int | None, ...], duration_ms: int, says: str
) -> None:
    with pytest.raises(LimitError, match=says) as caught:
        check_frame(rules, range(6), pulses, before, duration_ms, homing=False)
    assert caught.value.strut == "S1"


def test_the_last_gate_judges_the_shape(rules: Rules) -> None:
    with pytest.raises(ShapeError):
        check_frame(replace(rules, shape_check=lambda lengths: "no"), range(6), (1501,) * 6, BEFORE, 55, homing=False)


def test_the_last_gate_lets_a_hold_only_between_where_the_board_is_and_where_it_was_sent(rules: Rules) -> None:
    sent, board = (1700, *BEFORE[1:]), (1690.4, *(1500.0,) * 5)
    for pulse in (1690, 1691, 1700):
        check_frame(rules, range(6), (pulse, *BEFORE[1:]), sent, 55, True, board, True)
    for pulse in (1688, 1702):
        with pytest.raises(LimitError, match="S1: pulse of a hold"):
            check_frame(rules, range(6), (pulse, *BEFORE[1:]), sent, 55, True, board, True)


def test_the_last_gate_measures_from_where_the_board_is_and_not_from_what_was_sent(rules: Rules) -> None:
    sent = (1530, *BEFORE[1:])
    with pytest.raises(LimitError, match="S1: speed"):
        check_frame(rules, range(6), (1531, *BEFORE[1:]), sent, 55, False, (1515.0, *(1500.0,) * 5))
    with pytest.raises(LimitError, match="S1: speed"):
        check_frame(rules, range(6), sent, sent, 20, False, (1515.0, *(1500.0,) * 5))
    check_frame(rules, range(6), (1531, *BEFORE[1:]), sent, 55, False, (1519.5, *(1500.0,) * 5))
    with pytest.raises(LimitError, match="unknown position"):
        check_frame(rules, range(6), (1531, *BEFORE[1:]), sent, 55, False, (None, *(1500.0,) * 5))


def test_the_last_gate_always_lets_struts_be_held_where_they_are(rules: Rules) -> None:
    strict = replace(rules, shape_check=lambda lengths: "no")
    check_frame(strict, range(6), (2000,) * 6, (2000,) * 6, 20, homing=True)


def test_the_last_gate_lets_a_good_frame_through(rules: Rules) -> None:
    check_frame(rules, range(6), (1510, 1490, 1500, 1500, 1500, 1500), BEFORE, 55, homing=False)
