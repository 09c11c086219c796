# SPDX-License-Identifier: Apache-2.0
"""Chains stay in the keep-in area: a node's, with joints where the test says that they are."""

import pytest
import rclpy
from rclpy.node import Node

from sim_core.dynamics.model import build_model
from sim_core.errors import RollRefused
from sim_core.gaits.cycle import TURNS, Chain, faces_of
from sim_core.gaits.library import load_library
from sim_core.gaits.roll_sequence import Link, Move, Phase, RollPlan, RollRules, RollSequence, Seen, View
from sim_core.planning.floor_planner import NO_SHIFT, Floor, Stance
from sim_core.structure.parameters import load_prototype
from tensegrity_robot.planner.chain_area import ChainArea

pytestmark = pytest.mark.ros
NEUTRAL = (0.234,) * 6
CYCLE = load_library("continuous").cycles[0]
LONG = Chain(CYCLE, faces_of("TC6", "TO5", (TURNS[0],) * 5))
SHORT = Chain(CYCLE, LONG.faces[:3])


@pytest.fixture(scope="module")
def floor():
    return Floor(build_model(load_prototype()))


@pytest.fixture
def area(domain, floor):
    """A node's area; `there` puts the robot on a face at a place."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = Node("area", context=context)
    found = ChainArea(node, "-0.5 -0.5, 0.5 -0.5, 0.5 0.5, -0.5 0.5", load_prototype())

    def there(face, *place_m):
        stance = Stance(face, *(place_m or (0.0, 0.0)), 0.0)
        found._joints.newest = lambda watched, since=0.0: None if face is None else floor.joints_m(stance)

    found.there = there
    yield found
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_a_chain_that_would_lead_out_is_refused_and_a_short_one_is_not(area):
    area.there("TC6")
    area.require_inside(SHORT, watched=True)
    with pytest.raises(RollRefused, match=r"on T[CO]\d+ of these faces the robot would leave the keep-in area"):
        area.require_inside(LONG, watched=True)


def test_without_anybody_who_tells_where_it_is_or_outside_no_chain_begins(area):
    area.there(None)
    with pytest.raises(RollRefused, match="nobody tells where the robot is"):
        area.require_inside(SHORT, watched=True)
    area.there("TC6", 0.45, 0.0)
    with pytest.raises(RollRefused, match="not inside of the keep-in area"):
        area.require_inside(SHORT, watched=True)


def seen_on(face, at_s):
    seen = Seen(face, False, round(at_s * 1e9), "prototype")
    return View(round(at_s * 1e9), NEUTRAL, None, seen, True)


@pytest.fixture
def rolling():
    """A long chain on its way to the second face, a TC."""
    links = tuple(Link(NEUTRAL, face, 0.0, 4.0) for face in LONG.faces[1:])
    rules = RollRules(NEUTRAL, True, settle_timeout_s=20.0, confirm_timeout_s=60.0)
    sequence = RollSequence(rules, lambda source: RollPlan(source, LONG.target, (), links=links))
    sequence.begin(seen_on("TC6", 0.0))
    assert sequence.look(seen_on("TO5", 1.0)).phase is Phase.ROLL_ON
    return sequence


def test_a_chain_under_way_ends_at_once_where_the_robot_came_out(area, rolling):
    area.there("TO5")
    assert area.watch(rolling, seen_on("TO5", 1.5)) is None
    area.there("TO5", 0.6, 0.0)
    assert area.watch(rolling, seen_on("TO5", 1.6)) == Move(Phase.RETURN, NEUTRAL, overtakes=True)
    assert "came out of the keep-in area" in rolling.end(seen_on("TO5", 9.0)).reason


def test_it_ends_on_a_tc_from_where_the_next_rolls_lead_out(area, rolling, floor):
    tc = LONG.faces[2]
    places = [Stance(tc, x / 20, y / 20, 0.0) for x in range(-10, 11) for y in range(-10, 11)]
    inside = [place for place in places if area._area.outside_m(floor.joints_m(place)) <= 0.0]
    edge = next(place for place in inside if area._area.leads_out(floor, place, LONG.faces[3:5], [NO_SHIFT] * 2))
    area.there(tc, edge.x_m, edge.y_m)
    landed = seen_on(tc, 3.0)
    assert area.watch(rolling, landed) is None, "it is not out yet"
    assert rolling.look(landed).phase is Phase.RETURN
    outcome = rolling.end(seen_on(tc, 9.0))
    assert (outcome.ended_early, "it would leave the keep-in area" in outcome.reason) == (True, True)
