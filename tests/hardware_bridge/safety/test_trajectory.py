# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.errors import TrajectoryError
from hardware_bridge.safety.trajectory import MAX_KNOTS, Trajectory
from tests.hardware_bridge.helpers import MID

NAMES = ["S1", "S2", "S3", "S4", "S5", "S6"]


def test_between_knots_every_strut_goes_straight_and_beyond_them_it_stays() -> None:
    path = Trajectory([1.0, 2.0, 4.0], [MID, [0.24] * 6, [0.20] * 6])
    assert path.at(0.0) == pytest.approx(MID)
    assert path.at(1.5) == pytest.approx([0.237] * 6)
    assert path.at(2.0) == pytest.approx([0.24] * 6)
    assert path.at(3.0) == pytest.approx([0.22] * 6)
    assert path.at(99.0) == pytest.approx([0.20] * 6)
    assert path.duration_s == 4.0


@given(st.floats(0, 10), st.floats(0, 10))
def test_no_strut_is_ever_faster_than_its_segment(one_s: float, other_s: float) -> None:
    path = Trajectory([0.0, 3.0, 10.0], [MID, [0.25] * 6, [0.21] * 6])
    change = np.abs(path.at(one_s) - path.at(other_s)).max()
    assert change <= abs(one_s - other_s) * 0.04 / 7 + 1e-12


def test_starting_at_puts_the_present_in_front_or_in_place_of_a_knot_that_says_the_same() -> None:
    for times, lengths in (([2.0], [[0.24] * 6]), ([0.0, 2.0], [MID, [0.24] * 6])):
        path = Trajectory(times, lengths).starting_at(MID)
        assert list(path.times_s) == [0.0, 2.0]
        assert path.lengths_m.tolist() == [list(MID), [0.24] * 6]


@pytest.mark.parametrize("times", [[0.0], [0.0, 1e-11], [0.0, 2.0]])
def test_a_first_knot_elsewhere_is_a_jump_and_is_not_lost(times: list[float]) -> None:
    path = Trajectory(times, [[0.24] * 6] * len(times)).starting_at(MID)
    assert path.lengths_m[:2].tolist() == [list(MID), [0.24] * 6]
    assert 0.0 < path.times_s[1] <= 1e-9


def test_as_many_knots_as_are_valid_can_start_at_the_present() -> None:
    times = np.arange(1, MAX_KNOTS + 1) * 0.1
    assert len(Trajectory(times, [MID] * MAX_KNOTS).starting_at(MID).times_s) == MAX_KNOTS + 1


def test_columns_follow_the_names() -> None:
    path = Trajectory.from_names(NAMES[::-1], [1.0], [[0.6, 0.5, 0.4, 0.3, 0.2, 0.1]])
    assert list(path.lengths_m[0]) == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]


@pytest.mark.parametrize("names", [NAMES[:5], [*NAMES, "S7"], ["S1"] * 6, ["a"] * 6, [], [*NAMES[:5], "s6"]])
def test_wrong_names_or_counts_are_refused(names: list[str]) -> None:
    with pytest.raises(TrajectoryError, match="names are"):
        Trajectory.from_names(names, [1.0], [[0.234] * len(names)])


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_length_that_is_no_number_names_strut_and_knot(bad: float) -> None:
    lengths = np.full((3, 6), 0.234)
    lengths[1, 4] = bad
    with pytest.raises(TrajectoryError) as caught:
        Trajectory([1.0, 2.0, 3.0], lengths)
    assert (caught.value.strut, caught.value.knot) == ("S5", 2)


@pytest.mark.parametrize("times", [[1.0, 1.0], [2.0, 1.0], [-1.0, 1.0], [0.0, math.nan], [0.0, math.inf], [0.0, 601.0]])
def test_times_must_rise(times: list[float]) -> None:
    with pytest.raises(TrajectoryError, match="time of knot"):
        Trajectory(times, [MID, MID])


@pytest.mark.parametrize(
    ("times", "lengths"),
    [
        ([], np.zeros((0, 6))),
        ([1.0], np.zeros((2, 6))),
        ([1.0], np.zeros((1, 5))),
        ([1.0], np.zeros(6)),
        (np.arange(MAX_KNOTS + 1.0), np.zeros((MAX_KNOTS + 1, 6))),
        (["a"], [MID]),
        ([1.0], [["x"] * 6]),
        ([1.0, 2.0], [MID, [0.2]]),
    ],
)
def test_other_shapes_are_refused(times: object, lengths: object) -> None:
    with pytest.raises(TrajectoryError):
        Trajectory(times, lengths)  # type: ignore[arg-type]


def test_a_trajectory_cannot_be_changed_after_it_was_judged() -> None:
    lengths = np.full((1, 6), 0.234)
    path = Trajectory([1.0], lengths)
    lengths[0, 0] = 9.0
    assert path.lengths_m[0, 0] == 0.234
    with pytest.raises(ValueError, match="read-only"):
        path.lengths_m[0, 0] = 9.0
