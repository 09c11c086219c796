# SPDX-License-Identifier: Apache-2.0
"""The study of travels: its cases, its file, its page. Trips are made up here: real ones take minutes each."""

from dataclasses import replace

import pytest

from tensegrity_lab.stack.simulation_lag import LATE_S
from tensegrity_lab.stack.virtual_stack import VirtualRobot
from tensegrity_lab.studies.travel import Trip
from tensegrity_lab.studies.travel_plot import study_picture, travel_picture
from tests.studies import travels as module
from tests.studies.travels import TRAVELLERS, TRIPS, cases_of, page_of, read_trips, study

ROBOT = VirtualRobot(time_scale=8.0)
TRIP = Trip(
    (1.0, 0.0),
    "robust",
    True,
    1,
    0.0,
    0.05,
    True,
    "there",
    17,
    1,
    0.05,
    1.3,
    1.0,
    200.0,
    ("TC6", "TO5"),
    0.0,
    8.0,
    ((0.0, 0.0),),
    "b.mcap",
)


@pytest.fixture
def made(monkeypatch):
    """Trips made, as (case, time scale); how late each is comes from `late_s`, from the first one on, then 0."""
    made, late_s = [], []

    def trip(robot, case, tell):
        made.append((case, robot.time_scale))
        own = {"library": case.library, "use_odds": case.use_odds, "incline_deg": case.incline_deg, "seed": robot.seed}
        return replace(TRIP, goal_m=case.goal_m, late_s=late_s.pop(0) if late_s else 0.0, time_scale=robot.time_scale, **own)

    monkeypatch.setattr(module, "_trip", trip)
    return made, late_s


def test_every_goal_on_both_floors_with_every_traveller_and_what_is_compared_comes_together():
    cases = cases_of(3, seed=1)
    assert len(set(cases)) == len(cases) == 3 * 2 * len(TRAVELLERS)
    assert cases == cases_of(3, seed=1)
    assert [case.incline_deg for case in cases[5:7]] == [0.0, 3.0]
    assert [case.use_odds for case in cases[:2]] == [True, False]
    assert cases[0].goal_m == cases[1].goal_m
    level = cases_of(3, 1, "continuous", level=True)
    assert [(case.goal_m, case.incline_deg, case.use_odds) for case in level] == [(case.goal_m, 0.0, True) for case in cases[:6:2]]


def test_it_goes_on_where_it_was_stopped_for_all_that_a_line_is_cut_short(made, tmp_path):
    cases = cases_of(1, seed=1)
    study(cases[:2], ROBOT, tmp_path, lambda text: None, lambda text: None)
    with (tmp_path / TRIPS).open("a", encoding="utf-8") as file:
        file.write('{"number": 1, "goal')
    assert len(read_trips(tmp_path)) == 2
    (tmp_path / TRIPS).write_text("".join((tmp_path / TRIPS).read_text().splitlines(keepends=True)[:2]))
    study(cases, ROBOT, tmp_path, lambda text: None, lambda text: None)
    assert [case for case, _ in made[0]] == cases
    assert set(read_trips(tmp_path)) == {case.key for case in cases}


def test_a_trip_whose_orders_came_late_is_made_again_and_all_after_it_more_slowly(made, tmp_path):
    trips, late_s = made
    late_s += [LATE_S + 0.5, LATE_S + 0.1]
    cases, told = cases_of(1, seed=1)[:2], []
    study(cases, ROBOT, tmp_path, lambda text: None, told.append)
    assert trips == [(cases[0], 8.0), (cases[0], 4.0), (cases[0], 2.0), (cases[1], 2.0)]
    assert all(trip.late_s <= LATE_S for trip in read_trips(tmp_path).values())
    assert "again, at 4 times real time" in told[0]


def test_the_page_says_what_it_has_and_what_is_left(made, tmp_path):
    cases = cases_of(2, seed=1)
    study(cases[:2], ROBOT, tmp_path, lambda text: None, lambda text: None)
    known = read_trips(tmp_path)
    found = {case: known[case.key] for case in cases[:2]}
    page = page_of(found, len(cases) - 2, ROBOT, "COMMAND", "picture.png")
    assert "**2 travels of 8**, so far" in page
    assert "| level | robust, knows odds | 1 of 1 | 17 | 0 | 1 (6 %) | 17.0 | 200 s | 200 s | 0.28 | 1.37 |" in page
    assert "so far" not in page_of(found, 0, ROBOT, "COMMAND", "picture.png")


@pytest.mark.parametrize("stands", [(), (("TC6", 0.0, 0.0),), (("TC6", 0.0, 0.0), ("TO5", 0.1, 0.0), ("TC3", 0.1, 0.0))])
def test_a_travel_is_drawn_however_little_was_seen_of_it(stands, tmp_path):
    trip = replace(TRIP, stands=stands, places_m=tuple((x, y) for _, x, y in stands))
    travel_picture(trip, tmp_path / "one.png")
    study_picture([("level", [trip]), ("inclined", [])], tmp_path / "all.png")
    assert all((tmp_path / name).read_bytes().startswith(b"\x89PNG") for name in ("one.png", "all.png"))


def test_trips_of_older_studies_know_no_stands(made, tmp_path):
    study(cases_of(1, seed=1)[:1], ROBOT, tmp_path, lambda text: None, lambda text: None)
    path = tmp_path / TRIPS
    path.write_text(path.read_text().replace(', "stands": []', ""))
    assert [trip.stands for trip in read_trips(tmp_path).values()] == [()]
