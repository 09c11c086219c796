# SPDX-License-Identifier: Apache-2.0
import math
from itertools import pairwise

import numpy as np
import pytest

from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.errors import LibraryError
from sim_core.gaits.library import Library, Primitive, gait_of, load_library
from sim_core.gaits.success_counts import load_success_counts
from sim_core.planning.face_graph import FaceGraph
from sim_core.planning.floor_planner import NO_SHIFT, ROLL_COST, Floor, Stance
from sim_core.rolling.roll import roll
from sim_core.structure.parameters import load_prototype
from sim_core.structure.roll_classes import TC_TO
from sim_core.structure.topology import FACES, NEIGHBOURS

REST_S = 6.0


@pytest.fixture(scope="module")
def model():
    return build_model(load_prototype())


@pytest.fixture(scope="module")
def floor(model):
    return Floor(model)


@pytest.fixture(scope="module")
def graph():
    return FaceGraph(load_library("robust"))


@pytest.mark.parametrize("face", ["TC1", "TO7"])
def test_a_resting_robots_stance_is_where_it_was_put(model, floor, face):
    robot = Robot.resting_on(model, face, (0.3, -0.2), 0.7)
    stance = floor.stance(face, robot.joints_m())
    assert np.abs(floor.joints_m(stance) - robot.joints_m()[:, :2]).max() < 1e-3
    assert stance.yaw_rad == pytest.approx(0.7, abs=0.06)  # settling turns a robot on an open triangle a little


@pytest.mark.parametrize("face", FACES)
def test_a_roll_keeps_the_edge_and_the_roll_back_undoes_it(floor, face):
    start = Stance(face, 0.1, 0.2, 0.4)
    for target in NEIGHBOURS[face]:
        there = floor.rolled(start, target)
        edge = sorted(set(FACES[face]) & set(FACES[target]))
        assert np.abs(floor.joints_m(start)[edge] - floor.joints_m(there)[edge]).max() < 2e-3
        assert 0.03 < math.hypot(there.x_m - 0.1, there.y_m - 0.2) < 0.1
        back = floor.rolled(there, face)
        assert (back.x_m, back.y_m, back.yaw_rad) == pytest.approx((0.1, 0.2, 0.4), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "source", "target"), [("robust", "TC6", "TO5"), ("staged", "TC8", "TO7"), ("robust", "TO5", "TC3")]
)
def test_a_simulated_roll_ends_where_the_floor_says(model, floor, name, source, target):
    gait = FaceGraph(load_library(name)).best(source, target).gait
    robot = Robot.resting_on(model, source, (0.2, 0.1), 0.5)
    start = floor.stance(source, robot.joints_m())
    assert roll(model, source, target, gait.policy, start=robot).feasible
    ended, planned, turned = (
        floor.stance(target, robot.joints_m()),
        floor.rolled(start, target, floor.shift(gait)),
        floor.rolled(start, target),
    )
    assert math.dist(ended[1:3], planned[1:3]) < 0.003
    assert abs(math.remainder(ended.yaw_rad - planned.yaw_rad, 2.0 * math.pi)) < 0.02
    assert math.dist(ended[1:3], turned[1:3]) > math.dist(ended[1:3], planned[1:3]), "it goes farther than over the edge"


def test_a_gait_that_does_not_roll_is_planned_as_a_turn_over_the_edge(floor):
    lazy = Primitive("P1", TC_TO, (1, 0, 0, 0, 0, 0))
    assert floor.shift(gait_of(lazy, "TC6", "TO5")) == NO_SHIFT


@pytest.mark.parametrize("goal", [(0.5, 0.0), (-0.3, 0.4), (0.0, -0.6)])
def test_a_way_leads_there_roll_by_roll(floor, graph, goal):
    way = floor.way(Stance("TC6", 0.0, 0.0, 0.0), goal, graph)
    assert way.reaches
    assert way.left_m == way.stances[-1].distance_m(goal) <= 0.08
    for (before, after), choice in zip(pairwise(way.stances), way.choices, strict=True):
        assert (choice.gait.source, choice.gait.target) == (before.face, after.face)
        assert floor.rolled(before, after.face, floor.shift(choice.gait)) == after
    assert way.probability == pytest.approx(math.prod(choice.probability for choice in way.choices))
    assert len(way.choices) * floor.longest_m >= math.hypot(*goal) - 0.08


def test_a_goal_where_the_robot_stands_needs_no_roll(floor, graph):
    way = floor.way(Stance("TO3", 1.0, 1.0, 0.3), (1.02, 1.0), graph)
    assert (way.choices, way.probability, way.reaches) == ((), 1.0, True)


def test_without_gaits_there_is_no_way(floor):
    empty = FaceGraph(Library("none", "", {}, ()))
    with pytest.raises(LibraryError, match="has no gait from TC6"):
        floor.way(Stance("TC6", 0.0, 0.0, 0.0), (1.0, 0.0), empty)


def test_a_lean_makes_rolls_down_it_likelier_and_rolls_up_it_less_so(floor):
    library = load_library("robust")
    graph = FaceGraph(library, load_success_counts(library))
    start = Stance("TC6", 0.0, 0.0, 0.0)
    level = floor.way(start, (0.0, 1.0), graph)
    same = floor.way(start, (0.0, 1.0), graph, lean=(0.0, 0.0))
    assert same == level
    down, up = (floor.way(start, (0.0, 1.0), graph, lean=(0.0, y)) for y in (8.0, -8.0))
    assert down.probability >= level.probability > up.probability
    assert level.reaches
    assert up.reaches


def test_a_heading_is_the_direction_of_the_step(floor):
    start = Stance("TC6", 0.1, -0.2, 0.4)
    for target in NEIGHBOURS["TC6"]:
        there = floor.rolled(start, target)
        heading = start.heading_rad(there)
        step = np.array((there.x_m - start.x_m, there.y_m - start.y_m))
        assert np.allclose(step / np.linalg.norm(step), (math.cos(heading), math.sin(heading)))


def test_uphill_the_gait_that_climbs_steeper_is_taken_and_elsewhere_the_surer_one(floor):
    library = load_library("robust")
    graph = FaceGraph(library, load_success_counts(library))
    climber = library.gaits("TC6", "TO5")[-1]
    assert graph.best("TC6", "TO5").gait != climber

    def climbs_deg(gait):
        return 8.0 if gait.primitive == climber.primitive else 2.0

    start = Stance("TC6", 0.0, 0.0, 0.0)
    there = floor.rolled(start, "TO5", floor.shift(climber))
    goal, heading = (there.x_m, there.y_m), start.heading_rad(there)
    for down, wanted in ((-6.0, climber), (0.0, graph.best("TC6", "TO5").gait), (6.0, graph.best("TC6", "TO5").gait)):
        lean = (down * math.cos(heading), down * math.sin(heading))
        assert floor.way(start, goal, graph, 0.01, lean, climbs_deg).choices[0].gait == wanted


@pytest.mark.parametrize("lean", [(0.0, 0.0), (4.0, 0.0), (-4.0, 2.0), (0.0, -8.0)])
def test_looking_ahead_changes_how_long_it_takes_and_not_the_way(floor, monkeypatch, lean):
    library = load_library("improved")
    graph = FaceGraph(library, load_success_counts(library))
    start, goal = Stance("TC6", 0.0, 0.0, 0.0), (0.2, 0.1)
    quick = floor.way(start, goal, graph, lean=lean)
    monkeypatch.setattr("sim_core.planning.floor_planner._least_cost", lambda *_: 0.0)
    slow = floor.way(start, goal, graph, lean=lean)
    assert quick.reaches
    cost, least = (ROLL_COST * len(way.choices) - math.log(way.probability) for way in (quick, slow))
    assert least - 1e-9 <= cost <= 1.1 * least  # looking ahead aims at the middle of the goal, up the slope also past its near edge
