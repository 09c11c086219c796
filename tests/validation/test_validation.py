# SPDX-License-Identifier: Apache-2.0
"""Every validation case, as a test; the longest runs are shortened."""

from dataclasses import replace

import pytest

from sim_core.structure.parameters import load_prototype
from tests.validation import CASES, TOPICS, Comparison, Setting


@pytest.fixture(scope="module")
def setting():
    return Setting(load_prototype(), full=False)


@pytest.mark.parametrize("name", CASES)
def test_the_solver_agrees_with_mechanics(name, setting):
    case = CASES[name](setting)
    assert case.result.passed, f"{case.name}: {case.result}, off by {case.result.error}, {case.note}"
    assert case.checked.endswith(".")
    assert case.source


def test_case_names_are_unique():
    assert len(CASES) == sum(len(topic.cases) for topic in TOPICS)


def test_a_case_fails_beyond_its_tolerance_or_without_a_number():
    result = Comparison(1.0, 1.0, "m", 0.01)
    assert result.passed
    assert not result._replace(measured=1.02).passed
    assert not result._replace(measured=float("nan")).passed
    assert result._replace(measured=0.005, reference=0.0, relative=False).passed
    assert not result._replace(measured=0.02, reference=0.0, relative=False).passed


def test_a_wrong_solver_is_found_out(setting):
    """The suite is worth nothing if it cannot fail: a robot with other ropes has another first frequency."""
    softer = setting.prototype.tendon_stiffness_n_m * 0.95
    wrong = setting._replace(prototype=replace(setting.prototype, tendon_stiffness_n_m=softer))
    assert not CASES["frequency_by_eigenvalues"](wrong).result.passed
