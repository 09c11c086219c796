# SPDX-License-Identifier: Apache-2.0
"""Cycles in both engines are counted alike; the other engine itself is not among the packages of the tests."""

import json

import pytest

from sim_core.gaits.cycle import Cycle
from sim_core.gaits.library import Library
from sim_core.rolling.course import CourseResult
from tests.benchmarks.solver.cycles_in_mujoco import Compared, compared_document, compared_text, went
from tests.studies.chain_study import RANDOM


def result(reached, ended="TC1", pace=0.02):
    return CourseResult("TC1", reached, 12, False, "", (), ended, 0.0, 0.02, 50.0, (0.0,) * 6, (0.0, 0.0), 40.0, pace)


@pytest.fixture
def compared():
    ours = went([result(12), result(12, "TO1"), result(3, ""), result(0, "TC6", 0.0)])
    theirs = went([result(12)] * 4)
    return [Compared("C1", turns, "4 robots", (ours, theirs)) for turns in ("TO4", RANDOM)]


def test_a_chain_counts_the_rolls_that_were_begun(compared):
    ours, theirs = compared[0].went
    assert ours.onto_next[:2] == (27, 12 + 12 + 4 + 1)
    assert ours.in_a_row[:2] == (2, 4)
    assert ours.stayed[:2] == (1, 4)
    assert ours.m_per_min == pytest.approx(60.0 * 0.02 * 3 / 4)
    assert theirs.onto_next[:2] == (48, 48)
    assert compared[0].apart == pytest.approx(100.0 * (1.0 - 27 / 29))


def test_the_table_and_the_json_say_so(compared):
    straight, mixed = compared_text(Library("short", "0", {}, (), (Cycle("C1", ()),)), compared).splitlines()[4:6]
    assert "| 27 of 29 [" in straight
    assert "| 48 of 48 [92.6, 100.0] % | +6.9 | 2 of 4 / 4 of 4 | 1 of 4 / 4 of 4 | 0.90 / 1.20 |" in straight
    assert mixed.endswith("|  |")  # a way that is not straight has no speed
    one = json.loads(json.dumps(compared_document(compared)))[0]
    assert one["sixstrut"]["onto_next"]["successes"] == 27
    assert one["MuJoCo"]["in_a_row"]["trials"] == 4
