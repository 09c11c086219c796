# SPDX-License-Identifier: Apache-2.0
"""What a click on the floor means, and where a roll's ghost stands."""

import json
import math

import numpy as np
import pytest

from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.planning.floor_planner import Floor
from sim_core.structure.parameters import load_prototype
from sim_core.structure.topology import FACES, NEIGHBOURS
from tensegrity_console.web.floor_clicks import Ground
from tensegrity_console.web.scene import FULL_SCALE_N, ORANGE, PALE, tension_colors
from tensegrity_console.web.state import Facts, Selection, document_of, json_of


@pytest.fixture(scope="module")
def model():
    return build_model(load_prototype())


@pytest.fixture(scope="module")
def ground(model):
    return Ground(model)


@pytest.fixture(scope="module")
def facts(model):
    robot = Robot.resting_on(model, "TC6")
    return Facts(joints_m=np.vstack([robot.joints_m(), robot.box_m()]), predicted="TC6")


def ray_to(x, y):
    eye = np.array((0.3, -0.5, 0.6))
    return eye, np.array((x, y, 0.0)) - eye


def test_a_click_on_a_neighbouring_face_selects_it(ground, facts):
    stance = ground.stance(facts)
    neighbours = ground.neighbours(stance)
    assert {n.face for n in neighbours} == set(NEIGHBOURS["TC6"])
    for neighbour in neighbours:
        middle = neighbour.corners_m.mean(axis=0)
        assert ground.clicked(facts, *ray_to(*middle)) == Selection(neighbour.face, stood="TC6")


def test_a_click_elsewhere_on_the_floor_selects_the_place_and_above_the_horizon_nothing(ground, facts):
    assert ground.clicked(facts, *ray_to(1.0, -0.5)) == Selection("", (1.0, -0.5), "TC6")
    assert ground.clicked(facts, np.array((0.0, 0.0, 0.5)), np.array((1.0, 0.0, 0.1))) == Selection()
    nowhere = Facts(joints_m=facts.joints_m)
    assert ground.stance(nowhere) is None
    assert ground.clicked(nowhere, *ray_to(0.0, 0.0)) == Selection("", (0.0, 0.0)), "on no face there is no roll"


def test_a_click_with_numbers_that_are_none_or_beyond_the_floor_selects_nothing(ground, facts):
    eye, down = np.array((0.0, 0.0, 0.5)), np.array((0.0, 0.0, -1.0))
    for where, ray in ((eye * np.nan, down), (eye, down * np.inf), (eye, down * np.nan), (eye, np.array((1.0, 0.0, -1e-5)))):
        assert ground.clicked(facts, where, ray) == Selection()


def test_no_number_that_is_none_is_told_to_a_page():
    nan, inf = math.nan, math.inf
    facts = Facts(
        predicted="TC6", roll={"progress": nan}, rehearsal={"source": "TC6", "gaits": [{"successes": inf}]},
        strut_n=np.full(6, nan), duty_left_s=inf, trial={"done": nan},
    )  # fmt: skip
    text = json_of(document_of(facts, Selection("", (nan, inf)), 0.0))
    assert "NaN" not in text
    assert "Infinity" not in text
    assert json.loads(text)["place_m"] == [None, None]


def test_a_neighbour_shares_an_edge_with_the_face_stood_on(ground, facts):
    stance = ground.stance(facts)
    for neighbour in ground.neighbours(stance):
        common = sorted(set(FACES["TC6"]) & set(FACES[neighbour.face]))
        corners = [neighbour.corners_m[list(FACES[neighbour.face]).index(node)] for node in common]
        np.testing.assert_allclose(corners, facts.joints_m[common, :2], atol=2e-3)


def test_a_ghost_stands_where_the_floor_says(ground, facts, model):
    stance = ground.stance(facts)
    ghost = ground.ghost_m(stance, "TO7")
    there = Floor(model).rolled(stance, "TO7")
    np.testing.assert_allclose(ghost[:, :2].mean(axis=0), (there.x_m, there.y_m), atol=2e-3)
    lowest = np.argsort(ghost[:, 2])[:3]
    assert set(lowest) == set(FACES["TO7"])
    np.testing.assert_allclose(ground.ghost_m(stance, "TC6"), facts.joints_m[:12], atol=2e-3)
    assert ground.ghost_m(stance, "TC1") is None


def test_a_stance_tells_where_on_the_floor_the_robot_is(ground, facts):
    shifted = Facts(joints_m=facts.joints_m + np.array((0.4, 0.1, 0.0)), predicted="TC6")
    here, there = ground.stance(facts), ground.stance(shifted)
    assert math.isclose(there.x_m - here.x_m, 0.4, abs_tol=1e-6)
    assert math.isclose(there.yaw_rad, here.yaw_rad, abs_tol=1e-6)


def test_what_the_page_is_told_is_json_even_before_anything_was_heard():
    document = json.loads(json_of(document_of(Facts(), Selection(), 1.0)))
    assert document["alive"] is False
    assert document["face"] == ""
    assert document["duty_left_s"] is None
    assert document["lengths_mm"] == [None] * 6


def test_odds_of_a_face_left_behind_are_not_shown():
    told = {"source": "TC6", "gaits": []}
    assert document_of(Facts(predicted="TC6", rehearsal=told), Selection(), 0.0)["rehearsal"] == told
    assert document_of(Facts(predicted="TO5", rehearsal=told), Selection(), 0.0)["rehearsal"] is None


def test_slack_tendons_are_pale_and_tight_ones_orange():
    colors = tension_colors(np.array([0.0, FULL_SCALE_N, 2 * FULL_SCALE_N]))
    assert colors.shape == (3, 2, 3)
    assert tuple(colors[0, 0]) == PALE
    assert tuple(colors[1, 0]) == tuple(colors[2, 1]) == ORANGE
