# SPDX-License-Identifier: Apache-2.0
"""The budget of running time, counted spell by spell."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.errors import DutyError
from hardware_bridge.safety.duty_cycle import Duty, check_duty, returns, run_times_s
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.limits import Limits
from hardware_bridge.safety.trajectory import Trajectory
from tests.hardware_bridge.helpers import MID, MID_M

BOTH = Limits(duty_fraction=0.2, duty_window_s=60.0, burst_fraction=0.5, burst_window_s=10.0)
LIMITS = Limits(duty_fraction=0.2, duty_window_s=60.0)
CALIBRATION = load_calibration()
RULES = Rules(CALIBRATION, LIMITS)
FIRST_RAN = np.eye(6)[0]
pasts = st.lists(st.tuples(st.floats(0.0, 4.0), st.integers(0, 5), st.floats(0.0, 0.5)), max_size=60)


def times_of(past: list[tuple[float, int, float]]) -> list[tuple[float, int, float]]:
    """(when, which strut ran, how long) of (pause, which, how long)."""
    ends = np.cumsum([pause_s for pause_s, _, _ in past])
    return [(float(end), strut, run_s) for end, (_, strut, run_s) in zip(ends, past, strict=True)]


def after(past: list[tuple[float, int, float]], rest_s: float) -> tuple[Duty, float]:
    """What counts then, and the time, after a past and a rest."""
    duty, now_s = Duty(), 0.0
    for at_s, strut, run_s in times_of(past):
        duty, now_s = duty.ran(run_s * np.eye(6)[strut], at_s, BOTH), at_s
    return duty, now_s + rest_s


def out(stroke_m: float = 0.02, time_s: float = 2.0) -> Trajectory:
    return Trajectory([0.0, time_s], [MID, [MID_M + stroke_m, *MID[1:]]])


def test_only_struts_that_moved_have_run() -> None:
    duty = Duty().ran(FIRST_RAN * 0.05, 0.0, LIMITS)
    assert list(duty.used_s(0.0, 60.0)) == [0.05, 0, 0, 0, 0, 0]
    assert duty.left_s(0.0, LIMITS) == pytest.approx(11.95)


def test_a_window_later_everything_is_forgotten() -> None:
    duty = Duty().ran(FIRST_RAN * 12.0, 0.0, LIMITS)
    assert duty.left_s(59.9, LIMITS) == 0.0
    assert duty.left_s(61.1, LIMITS) == pytest.approx(12.0)


def test_the_refusal_says_how_long_to_wait_and_that_is_enough() -> None:
    duty = Duty()
    for second in range(12):
        duty = duty.ran(FIRST_RAN * 0.95, float(second), LIMITS)
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


@given(st.lists(st.tuples(st.floats(0.0, 5.0), st.lists(st.booleans(), min_size=6, max_size=6)), max_size=300))
def test_nothing_within_a_window_is_ever_forgotten_and_little_else_is_remembered(frames: list[tuple[float, list[bool]]]) -> None:
    duty, now_s, history = Duty(), 0.0, []
    for pause_s, moved in frames:
        now_s += pause_s
        duty = duty.ran([0.05 * move for move in moved], now_s, BOTH)
        history.append((now_s, moved))
    for window_s, longer_s in ((BOTH.duty_window_s, 6.0), (BOTH.burst_window_s, 2.0)):
        used_s = duty.used_s(now_s, window_s)
        for over_s, holds in ((0.0, used_s.__ge__), (longer_s, used_s.__le__)):
            recent = [moved for at_s, moved in history if at_s > now_s - window_s - over_s]
            ran_s = 0.05 * np.array(recent, dtype=float).reshape(-1, 6).sum(axis=0)
            assert holds(ran_s + (1e-9 if over_s else -1e-9)).all()
    assert len(duty.spells) <= 25 + 130


@given(past=pasts, now_s=st.floats(0.0, 60.0))
def test_what_is_left_may_be_run_at_once_and_no_more(past: list[tuple[float, int, float]], now_s: float) -> None:
    duty, now_s = after(past, now_s)
    left_s = duty.left_s(now_s, BOTH)
    assert 0.0 <= left_s <= BOTH.duty_windows[1][1]
    step_s = 0.05
    for strut in range(6):
        runs_s = np.zeros((round(BOTH.duty_windows[1][1] / step_s), 6))
        runs_s[: int(left_s / step_s), strut] = step_s
        for window_s, budget_s in BOTH.duty_windows:
            used_s = duty.used_s(now_s, window_s)[strut]
            assert duty.most_used_s(runs_s, step_s, now_s, window_s)[strut] <= max(budget_s, used_s) + 1e-6
    most_s = [
        duty.most_used_s(np.full((math.ceil(left_s / step_s) + 2, 6), step_s), step_s, now_s, window_s).max() - budget_s
        for window_s, budget_s in BOTH.duty_windows
    ]
    assert max(most_s) > 0.0


@given(
    past=pasts,
    now_s=st.floats(0.0, 60.0),
    ways=st.lists(st.tuples(st.floats(-0.04, 0.04), st.floats(0.0, 20.0)), min_size=1, max_size=8),
)
def test_a_path_that_is_permitted_exceeds_no_window_anywhere(
    past: list[tuple[float, int, float]], now_s: float, ways: list[tuple[float, float]]
) -> None:
    duty, now_s = after(past, now_s)
    times = np.cumsum([abs(stroke) / 0.015 + pause_s + 0.1 for stroke, pause_s in ways])
    path = Trajectory([0.0, *times], [MID, *([MID_M + stroke, *MID[1:]] for stroke, _ in ways)])
    rules = Rules(CALIBRATION, BOTH, loads=lambda lengths_m: (False, lengths_m[0] > MID_M + 0.02, *(False,) * 4))
    refused = None
    try:
        check_duty(duty, path, now_s, rules)
    except DutyError as error:
        refused = error
    if refused is not None and refused.wait_s is not None:
        now_s += refused.wait_s
        check_duty(duty, path, now_s, rules)
    if refused is not None and refused.wait_s is None:
        with pytest.raises(DutyError):
            check_duty(Duty(), path, 0.0, rules)
        return
    edges = np.arange(0.0, path.duration_s, 0.05)
    pulses_us = np.array([CALIBRATION.pulses_us(list(path.at(edge))) for edge in (*edges, edges[-1] + 0.05)])
    ran = [(at_s, run_s * np.eye(6)[strut]) for at_s, strut, run_s in times_of(past)]
    ran += [
        (now_s + edge, 0.05 * np.array([moves[0], path.at(edge)[0] > MID_M + 0.02, 0, 0, 0, 0]))
        for edge, moves in zip(edges, np.diff(pulses_us, axis=0) != 0, strict=True)
    ]
    at_s, run_s = np.array([at for at, _ in ran]), np.array([run for _, run in ran])
    for window_s, budget_s in BOTH.duty_windows:
        for edge in edges[:: max(1, len(edges) // 50)]:
            inside = (at_s > now_s + edge - window_s) & (at_s <= now_s + edge)
            assert run_s[inside].sum(axis=0).max() <= budget_s + 1e-6


def test_nothing_runs_through_a_whole_short_window_and_the_refusal_names_it() -> None:
    limits = Limits()
    to_and_fro = Trajectory([0.0, *range(2, 62, 2)], [MID, *([MID_M + 0.02 * (knot % 2), *MID[1:]] for knot in range(1, 31))])
    with pytest.raises(DutyError, match=r"S1: has run 0\.0 s of the last 60 s .* the limit is 54 s; make the motion shorter"):
        check_duty(Duty(), to_and_fro, 0.0, Rules(CALIBRATION, limits))
    duty = Duty()
    for second in range(51):
        duty = duty.ran(FIRST_RAN, float(second), limits)
    assert duty.left_s(51.0, limits) == pytest.approx(3.0)
    with pytest.raises(DutyError, match=r"S1: has run 51\.0 s of the last 60 s and would run 4\.\d+ s more") as caught:
        check_duty(duty, out(0.04, 4.0), 51.0, Rules(CALIBRATION, limits))
    assert caught.value.wait_s == pytest.approx(11.0, abs=1.5), "until the first of it is a minute ago"
    check_duty(duty, out(0.04, 4.0), 51.0 + caught.value.wait_s, Rules(CALIBRATION, limits))


def test_a_strut_held_under_load_runs_for_as_long_as_the_path_lasts() -> None:
    long = Trajectory([0.0, 2.0, 9.0], [MID, [MID_M + 0.03, *MID[1:]], [MID_M + 0.03, *MID[1:]]])
    free, loaded = (Rules(CALIBRATION, LIMITS, loads=lambda lengths_m, on=on: (on,) * 6) for on in (False, True))
    assert run_times_s(long, free).sum(axis=0) == pytest.approx([2.1, 0, 0, 0, 0, 0], abs=0.06)
    assert (run_times_s(long, loaded).sum(axis=0) >= 9.0).all()
