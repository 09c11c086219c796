# SPDX-License-Identifier: Apache-2.0
"""A verdict is on a path, and not on how densely somebody has sampled it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.errors import DutyError, LimitError, Refused, ShapeError, SupplyError, TrajectoryError
from hardware_bridge.safety.duty_cycle import Duty, check_duty, returns, run_times_s
from hardware_bridge.safety.limit_checks import Rules, check_shapes, check_trajectory
from hardware_bridge.safety.limits import Limits, Pacing
from hardware_bridge.safety.path_extremes import points_along
from hardware_bridge.safety.shape_cache import ShapeMemory
from hardware_bridge.safety.supervisor_messages import Supply
from hardware_bridge.safety.trajectory import MAX_KNOTS, Trajectory
from tests.hardware_bridge.emulated import Rig
from tests.hardware_bridge.helpers import MID, MID_M
from tests.scale import examples

CALIBRATION = load_calibration()
CALIBRATION = replace(
    CALIBRATION, struts=(replace(CALIBRATION.struts[0], direction=-1, us_per_mm=7.3, trim_us=17), *CALIBRATION.struts[1:])
)
LIMITS = Limits(duty_window_s=30.0)


def thin(lengths_m: tuple[float, ...]) -> str | None:
    """Bad only in a layer thinner than the step between judged shapes."""
    return "thin ice" if abs(lengths_m[0] - 0.2402) < 0.0004 or max(lengths_m) - min(lengths_m) > 0.07 else None


RULES = Rules(CALIBRATION, LIMITS, shape_check=thin)


def densely(path: Trajectory, at_s: np.ndarray) -> Trajectory:
    """The same path with more knots on its lines."""
    apart = [time_s for time_s in np.unique(np.round(at_s, 6)) if np.abs(path.times_s - time_s).min() > 1e-7]
    times = np.sort(np.concatenate((path.times_s, apart)))
    return Trajectory(times, [path.at(time_s) for time_s in times])


@st.composite
def paths(draw: st.DrawFn) -> Trajectory:
    """At most the limit's neighbourhood in speed, plateaus, turns; from mid stroke or elsewhere."""
    count = draw(st.integers(1, 6))
    start = MID_M + np.array(draw(st.tuples(*[st.sampled_from([0.0, 0.0, 0.01, -0.02])] * 6)))
    gaps = [draw(st.sampled_from([0.004, 0.05, 0.3, 1.0, 2.5])) for _ in range(count)]
    speeds = st.sampled_from([0.0, 0.019, -0.019, 0.0201, -0.0201, 0.001, 0.025, -0.008, 0.013])
    one = draw(st.booleans())
    rows, at_m = [start], start
    for gap_s in gaps:
        at_m = at_m + gap_s * np.array([draw(speeds) if index == 0 or not one else 0.0 for index in range(6)])
        rows.append(at_m)
    return Trajectory(np.concatenate(([0.0], np.cumsum(gaps))), rows)


densities = st.lists(st.floats(0.0, 1.0), max_size=200) | st.integers(2, 400).map(lambda count: list(np.linspace(0.0, 1.0, count)))


def verdict(path: Trajectory) -> tuple[object, ...]:
    """What the rules say, with what is said of it."""
    said: list[object] = [returns(path, CALIBRATION), tuple(run_times_s(path, RULES).sum(axis=0))]
    try:
        check_trajectory(RULES, tuple(path.lengths_m[0]), path)
        said.append("permitted")
    except LimitError as error:
        said.append(error.quantity)
    except ShapeError as error:
        said.append([round(length, 6) for length in error.lengths_m])
    try:
        check_duty(Duty(), path, 0.0, RULES)
    except DutyError as error:
        said.append(error.strut)
    return tuple(said)


@settings(max_examples=examples(150), deadline=None)
@given(path=paths(), parts=densities)
def test_more_knots_on_the_same_lines_change_no_verdict(path: Trajectory, parts: list[float]) -> None:
    dense = densely(path, np.array(parts) * path.duration_s)
    assert verdict(dense) == verdict(path)


@settings(max_examples=examples(60), deadline=None)
@given(path=paths(), parts=densities)
def test_the_same_shapes_are_judged(path: Trajectory, parts: list[float]) -> None:
    judged: list[list[tuple[float, ...]]] = []
    for each in (path, densely(path, np.array(parts) * path.duration_s)):
        keys: dict[tuple[float, ...], None] = {}
        memory = ShapeMemory(lambda lengths_m, keys=keys: keys.setdefault(lengths_m), 6e-4)  # type: ignore[misc]
        check_shapes(replace(RULES, shape_check=memory.judge), each)
        judged.append(list(keys))
    assert judged[0] == judged[1]


@settings(max_examples=examples(60), deadline=None)
@given(path=paths(), part=st.floats(0.0, 1.0))
def test_every_place_of_a_judged_path_is_near_a_judged_shape(path: Trajectory, part: float) -> None:
    memory = ShapeMemory(lambda _: None, 0.5e-3 + max(strut.quantum_m for strut in CALIBRATION.struts))
    check_shapes(replace(RULES, shape_check=memory.judge), path)
    lengths_m = CALIBRATION.lengths_m(CALIBRATION.pulses_us(list(path.at(part * path.duration_s))))
    assert memory.recall(lengths_m) is None


@settings(max_examples=examples(40), deadline=None)
@given(data=st.data(), path=paths())
def test_frames_are_never_counted_to_run_longer_than_was_judged(data: st.DataObject, path: Trajectory) -> None:
    rules = Rules(CALIBRATION, Limits(duty_fraction=1.0, duty_window_s=3600.0), Pacing(energise_pause_s=0.0, homing_speed_m_s=0.02))
    rig = Rig("lsc", rules)
    rig.arm()
    path = Trajectory(path.times_s[1:], path.lengths_m[1:] - path.lengths_m[0] + MID_M)
    if not rig.accepts(path):
        return
    needs_s = run_times_s(path.starting_at(MID), rules).sum(axis=0)
    before_s = rig.engine.state.duty.used_s(0.0, 3600.0)
    late = data.draw(st.lists(st.sampled_from([0.05, 0.05, 0.05, 0.06, 0.04, 0.09, 0.001]), min_size=1, max_size=30))
    number = 0
    while rig.engine.state.motion is not None:
        rig.tick(late[number % len(late)])
        number += 1
    used_s = rig.engine.state.duty.used_s(0.0, 3600.0) - before_s
    assert (used_s <= needs_s + 1e-6).all()


# ---- what was found -------------------------------------------------------------------------------------------------


def test_29_mm_per_s_is_refused_however_it_is_sampled() -> None:
    for count in (1, 20, 100, 2000):
        times = np.linspace(0.0, 1.0, count + 1)[1:]
        with pytest.raises(LimitError, match="S1: speed 29"):
            check_trajectory(Rules(load_calibration()), MID, Trajectory(times, MID_M + np.outer(0.029 * times, [1, 0, 0, 0, 0, 0])))


@pytest.mark.parametrize("count", [1, 20, 100, 2000])
def test_a_motion_away_from_mid_stroke_is_no_return_however_it_is_sampled(tmp_path: Path, count: int) -> None:
    rules = Rules(load_calibration(), Limits(duty_window_s=10.0), Pacing(energise_pause_s=0.0))
    times = np.linspace(0.0, 2.2, count + 1)[1:]
    away = Trajectory(times, MID_M + np.outer(0.009 * times, [1, 0, 0, 0, 0, 0]))
    assert not returns(away.starting_at(MID), rules.calibration)
    rig = Rig("lsc", rules)
    rig.arm()
    with pytest.raises(DutyError, match="S1: has run"):
        rig.execute(away)
    rig.engine.apply(Supply(5000))
    with pytest.raises(Refused):
        rig.execute(away)
    short = Trajectory(times * 0.5, away.lengths_m * 0.5 + MID_M * 0.5)
    with pytest.raises(SupplyError):
        rig.execute(short)
    rig.engine.apply(Supply(7400))
    rig.execute(short)


def test_with_a_spent_budget_no_chain_of_returns_creeps_away(tmp_path: Path) -> None:
    rules = Rules(load_calibration(), Limits(duty_window_s=10.0), Pacing(energise_pause_s=0.0))
    rig = Rig("lsc", rules)
    rig.arm()
    rig.execute(Trajectory([1.8], [[MID_M + 0.01, *MID[1:]]]))
    while rig.engine.state.motion is not None:
        rig.tick(0.05)
    for _ in range(40):
        here_m = rig.engine.lengths_m()[0]
        rig.accepts(Trajectory([0.1], [[here_m + 0.9e-4, *MID[1:]]]))
        rig.tick(0.05)
        rig.hold(0.03)
    assert rig.engine.lengths_m()[0] <= MID_M + 0.01 + 1e-9


# ---- edges ----------------------------------------------------------------------------------------------------------


def test_a_jump_at_time_0_is_a_quantum_at_most_and_is_not_forgiven_again() -> None:
    rules = Rules(load_calibration())
    jump = np.array([1e-4, 0, 0, 0, 0, 0])
    check_trajectory(rules, MID, Trajectory([0.0, 1.0], [MID_M + jump, MID_M + 200 * jump]))
    with pytest.raises(LimitError, match="S1: jump"):
        check_trajectory(rules, MID, Trajectory([0.0, 1.0], [MID_M + 1.1 * jump, MID_M + 100 * jump]))
    for count in (2, 50):
        times = np.linspace(0.0, 1.0, count)
        with pytest.raises(LimitError, match="S1: speed"):
            check_trajectory(rules, MID, Trajectory(times, MID_M + jump + np.outer(0.0201 * times, [1, 0, 0, 0, 0, 0])))


def test_a_zigzag_whose_average_is_slow_is_as_fast_as_its_fastest_span() -> None:
    times = np.arange(1, 101) * 0.02
    zigzag = MID_M + np.outer(np.where(np.arange(100) % 2, 0.0, 0.0006), [1, 0, 0, 0, 0, 0])
    with pytest.raises(LimitError, match="S1: speed 30"):
        check_trajectory(Rules(load_calibration()), MID, Trajectory(times, zigzag))
    check_trajectory(Rules(load_calibration()), MID, Trajectory(times, MID_M + (zigzag - MID_M) / 1.3))


def test_knots_a_nanosecond_apart_gain_one_quantum_in_all() -> None:
    rules = Rules(load_calibration())
    times = np.arange(1, 21) * 1e-9
    check_trajectory(rules, MID, Trajectory(times, MID_M + np.outer(np.linspace(0.05e-4, 1e-4, 20), np.eye(6)[0])))
    with pytest.raises(LimitError, match="S1: speed"):
        check_trajectory(rules, MID, Trajectory(times, MID_M + np.outer(np.linspace(0.1e-4, 2e-4, 20), np.eye(6)[0])))


def test_turns_between_the_judged_millimetres_are_judged() -> None:
    path = Trajectory([0.0, 1.0, 2.0], [MID, [MID_M + 0.0064, *MID[1:]], MID])
    found = points_along(path, 1e-3, 100)
    assert found is not None
    assert (MID_M + 0.0064) in found[1][:, 0]
    assert len(found[0]) == 15


def test_a_way_too_long_to_judge_is_refused_before_anybody_judges() -> None:
    times = np.arange(1, MAX_KNOTS + 1) * 0.14
    rows = MID_M + np.outer(np.where(np.arange(MAX_KNOTS) % 2, -0.01, 0.01) * 0.7, np.eye(6)[0])
    asked: list[object] = []
    rules = Rules(load_calibration(), Limits(speed_m_s=0.1, step_m=0.01), shape_check=asked.append)
    with pytest.raises(TrajectoryError, match="send it in parts"):
        check_trajectory(rules, MID, Trajectory(times, rows))
    assert not asked
