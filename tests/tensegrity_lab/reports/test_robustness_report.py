# SPDX-License-Identifier: Apache-2.0
"""What is said about a study, on a study made up: no robot is rolled."""

import csv
import json

import numpy as np
import pytest

from sim_core.gaits.library import load_library
from sim_core.studies.attribution import Attribution
from sim_core.studies.local_runner import Cost
from sim_core.studies.robustness import Study, StudyPlan, gaits_of
from sim_core.uncertainty.perturbation_law import Law
from tensegrity_lab.reports.robustness_plot import robustness_picture
from tensegrity_lab.reports.robustness_report import document_of, text_of, write_tables


@pytest.fixture(scope="module")
def library():
    return load_library("robust")


@pytest.fixture(scope="module")
def study(library):
    """Three primitives on five prototypes: all, five in six, and none of the trials succeed."""
    primitives = (library.primitives[0], library.primitives[20], library.primitives[1])
    feasible = np.ones((3, 24, 5), dtype=np.bool_)
    feasible[1, :4] = feasible[2] = False
    numbers = [np.full(feasible.shape, value, dtype=np.float32) for value in (0.02, 0.015, 40.0, 12.0)]
    law = Law(0.1, ("stiffness", "mass", "payload"))
    return Study(
        StudyPlan(law, 7, 5),
        primitives,
        tuple(gaits_of(p, False) for p in primitives),
        feasible,
        *numbers,
        np.where(feasible, 0, 1).astype(np.int32),
        ("", "after actuation it stood on TC1"),
        Cost(5400.0, 12.0, 0.3, 360),
    )


@pytest.fixture(scope="module")
def blame(study):
    failures = np.array([[1, 0, 2], [2, 3, 0], [2, 3, 1]])
    vanishes = np.array([[True, True, False], [False, True, False], [False, False, False]])
    comes = np.array([[True, False, False], [False, False, False], [True, True, True]])
    return Attribution(failures, 140, study.plan.law.groups, vanishes, comes, np.zeros(3, dtype=np.bool_), Cost(1.0, 1.0, 0.0, 21))


def test_people_read_rates_counts_killers_cost_and_what_it_takes_for_granted(library, study, blame):
    text = text_of(library, study, blame, wall_s=6.0)
    for words in (
        "3 primitives, 24 gaits on each of 5 held-out prototypes of seed 7",
        "primitives: 1 at 100 %, 2 above 80 %, 2 at or above 50 %, of 3",
        "P21          TO5-TC6   83.33 %",
        "3 of 140 failed trials",
        "900 × real time",
        "independent and alike",
        "virtual trials",
        "The range of payload is a stand-in of ours.",
    ):
        assert words in text
    order = [text.index(f"\n{name} ") for name in ("P1", "P21", "P2")]
    assert order == sorted(order)


def test_killers_are_the_group_without_which_a_trial_succeeds(study, blame):
    assert blame.killers() == ["stiffness", "mass", "several together"]
    assert [row.group for row in blame.blames] == ["mass", "stiffness", "payload"]
    by_gait = blame.killers_by_gait(study)
    assert [sum(killers.values()) for killers in by_gait.values()] == [1, 2]


def test_the_document_is_json_and_agrees_with_the_tables(tmp_path, library, study, blame):
    document = json.loads(json.dumps(document_of(library, study, blame, 6.0)))
    assert document["counts"] == {"at_100": 1, "above_80": 2, "at_least_50": 2, "primitives": 3}
    assert len(document["gaits"]) == 72
    paths = write_tables(study, blame, tmp_path / "new")
    primitives, gaits, trials = (list(csv.DictReader(path.open(encoding="utf-8"))) for path in paths)
    assert [float(row["rate"]) for row in primitives] == pytest.approx([row["rate"] for row in document["primitives"]])
    assert len(gaits) == 72
    assert {row["killers"] for row in gaits} == {"", "stiffness 1", "mass 1, several together 1"}
    assert len(trials) == 360
    assert sum(int(row["feasible"]) for row in trials) == study.feasible.sum()
    assert {row["reason"] for row in trials if row["feasible"] == "0"} == {"after actuation it stood on TC1"}


def test_the_picture_is_drawn_with_and_without_blame(tmp_path, study, blame):
    for name, known in (("a.png", blame), ("b.png", None)):
        robustness_picture(study, known, tmp_path / name, "title")
        assert (tmp_path / name).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
