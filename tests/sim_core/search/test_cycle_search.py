# SPDX-License-Identifier: Apache-2.0
"""The search for cycles: it begins with pairs that roll, keeps what it found, and stops and goes on without a difference."""

import json
import math

import pytest

from sim_core.dynamics.robot import Robot
from sim_core.errors import ParameterError
from sim_core.files.yaml_reader import parse_yaml
from sim_core.gaits.cycle import STRETCH, TURNS, TWIST, chain_of, faces_of
from sim_core.gaits.library import library_text, load_library, parse_library
from sim_core.planning.floor_planner import Floor, chain_shifts
from sim_core.rolling.batch import Batch
from sim_core.rolling.course import Course, stages_of_chain
from sim_core.search.cycle_search import TRAINED, CyclePlan, CycleSearch, way_of
from sim_core.studies.robustness import training_seeds

SMALL = CyclePlan("small", offspring=6, generations=2, keep=1, elites=4, robots=3, choice=2)


@pytest.mark.slow
def test_a_search_that_was_stopped_goes_on_as_if_it_had_not_been(prototype):
    whole = CycleSearch(prototype, SMALL)
    whole.step()
    state = json.loads(json.dumps(whole.state))
    whole.step()
    again = CycleSearch(prototype, SMALL, state=state)
    again.step()
    assert again.state == whole.state
    assert whole.done
    assert whole.progress.finished == 1.0
    library = whole.library()
    assert library.hash == again.library().hash
    assert library.primitives == load_library("staged").primitives
    (cycle,) = library.cycles
    assert set(cycle.turns) == set(TURNS)
    assert all(0 <= s.onto_next <= s.rolls <= 2 * 2 * 12 and 0 <= s.stayed <= s.leaves <= 4 for s in cycle.turns.values())
    assert cycle.margins["chains"] > 0.5
    assert whole.elites[0].merit > TRAINED
    assert parse_library(parse_yaml(library_text(library), "again"), "again").cycles == library.cycles
    assert {seed for pair in SMALL.seeds.values() for seed in pair} <= training_seeds(library)


def test_the_shipped_cycles_ways_are_known_and_a_chain_ends_where_it_is_planned_to(model):
    cycle = load_library("continuous").cycles[0]
    way = way_of(model.prototype, cycle)
    assert way == {STRETCH: cycle.margins[STRETCH], TWIST: cycle.margins[TWIST]}
    faces, floor = faces_of("TC8", "TO7", (TURNS[0], TURNS[1], TURNS[1])), Floor(model)
    begin = stance = floor.stance("TC8", Robot.resting_on(model, "TC8").joints_m())
    for face, shift in zip(faces[1:], chain_shifts(cycle, faces), strict=True):
        stance = floor.rolled(stance, face, shift)
    (found,) = Batch([model]).run([Course(0, "TC8", stages_of_chain(chain_of(cycle, faces)))])
    planned = stance.x_m - begin.x_m, stance.y_m - begin.y_m
    assert math.dist(planned, found.travel_m) < 0.025
    assert math.hypot(*found.travel_m) > 0.15


def test_a_state_of_another_plan_is_refused(prototype):
    state = CycleSearch(prototype, SMALL).state
    with pytest.raises(ParameterError, match="another plan or model"):
        CycleSearch(prototype, CyclePlan("small", seed=2), state=state)


def test_seeds_of_two_searches_are_not_shared():
    assert not {s for pair in CyclePlan(seed=1).seeds.values() for s in pair} & {
        s for pair in CyclePlan(seed=2).seeds.values() for s in pair
    }


def test_a_plan_without_robots_is_refused():
    with pytest.raises(ParameterError, match="robots 0: valid"):
        CyclePlan(robots=0)
