# SPDX-License-Identifier: Apache-2.0
"""The plans of the shipped libraries: `./sixstrut search NAME` makes each of them again."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sim_core.search.cycle_search import CyclePlan, CycleSearch
from sim_core.search.genetic_search import Search, SearchPlan
from sim_core.search.training_robots import FittedTraining, Training
from sim_core.structure.elements import PREVIOUS
from sim_core.structure.parameters import Prototype
from sim_core.studies.local_runner import Runner
from sim_core.uncertainty.ensemble import Posterior
from sim_core.uncertainty.perturbation_law import Law

LEVEL = Law(0.2)
"""Training on level ground: twice the errors that a library is asked to survive everywhere."""
INCLINED = Law(0.05, incline_deg=5.0)
"""Ground slope is what stops plain primitives: uphill they do not tip."""

PLANS: dict[str, SearchPlan | CyclePlan] = {
    plan.name: plan
    for plan in (
        SearchPlan("improved"),
        SearchPlan("previous", kind=PREVIOUS, generations=100_000),
        SearchPlan(
            "robust",
            offspring=160,
            polish=22,
            apart_mm=8,
            # two to one: uphill strength costs the TC6-TO5 rolls their tolerance of ill-made robots
            training=(Training(LEVEL, 24, 11_001), Training(INCLINED, 12, 11_002)),
            choice=(Training(LEVEL, 96, 12_001), Training(INCLINED, 48, 12_002)),
        ),
        SearchPlan(
            "staged",
            classes=("TC6-TO5",),  # a TO is left by all but one in a thousand
            offspring=96,
            polish=16,
            apart_mm=8,
            training=(Training(LEVEL, 24, 11_001), Training(INCLINED, 12, 11_002)),
            choice=(Training(LEVEL, 96, 12_001), Training(INCLINED, 48, 12_002)),
            stages=2,
            start="robust",
        ),
        CyclePlan("continuous"),
    )
}


def search_of(
    prototype: Prototype, plan: SearchPlan | CyclePlan, runner: Runner, state: Mapping[str, Any] | None
) -> Search | CycleSearch:
    """The search for a plan, from the beginning or from a state. Raises ParameterError: the state is another search's."""
    return CycleSearch(prototype, plan, runner, state) if isinstance(plan, CyclePlan) else Search(prototype, plan, runner, state)


FITTED_ROBOTS, FITTED_SEED = 32, 13_001
FITTED_CHOICE, FITTED_CHOICE_SEED = 128, 14_001
"""Drawn from a fitted ensemble, about as many as the plan `robust` has."""


def fitted_to(posterior: Posterior) -> SearchPlan:
    """The plan `robust`, trained on robots fitted to trials instead."""
    training = FittedTraining(posterior, FITTED_ROBOTS, FITTED_SEED)
    choice = FittedTraining(posterior, FITTED_CHOICE, FITTED_CHOICE_SEED)
    plan = PLANS["robust"]
    assert isinstance(plan, SearchPlan)
    return replace(plan, training=(training,), choice=(choice,))
