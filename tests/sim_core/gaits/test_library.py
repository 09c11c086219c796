# SPDX-License-Identifier: Apache-2.0
from collections import Counter
from dataclasses import replace

import pytest
import yaml

from sim_core.errors import LibraryError
from sim_core.gaits.library import gait_of, library_text, load_library, parse_library
from sim_core.rolling.batch import Job, roll_many
from sim_core.structure.roll_classes import CLASSES, TC_TO, TO_TC, rolls_of


@pytest.fixture(scope="module")
def shipped():
    return load_library("robust")


def test_the_shipped_library_belongs_to_the_shipped_model_and_has_three_of_each_class(shipped, model):
    assert shipped.model_hash == model.hash
    counts = Counter(p.roll_class for p in shipped.primitives)
    assert set(counts) == set(CLASSES.values())
    assert min(counts.values()) >= 3


def test_every_primitive_is_feasible_for_its_reference_pair(shipped, model):
    jobs = [Job(0, p.roll_class.source, p.policy, p.roll_class.target) for p in shipped.primitives]
    assert all(result.feasible for result in roll_many([model], jobs))


@pytest.mark.parametrize("roll_class", [TC_TO, TO_TC])
def test_the_best_primitive_of_a_class_works_as_all_its_24_gaits(shipped, model, roll_class):
    primitive = next(p for p in shipped.primitives if p.roll_class is roll_class)
    gaits = [gait_of(primitive, source, target) for source, target in rolls_of(roll_class)]
    for gait, result in zip(gaits, roll_many([model], [Job(0, g.source, g.policy, g.target) for g in gaits]), strict=True):
        assert result.feasible, f"{gait.name}: {result.reason}"


def test_a_policy_in_two_stages_is_written_read_and_relabelled(shipped):
    first = shipped.primitives[0]
    staged = replace(shipped, primitives=(replace(first, policy=first.policy + tuple(-v for v in first.policy)),))
    text = library_text(staged)
    assert parse_library(yaml.safe_load(text), "file").primitives == staged.primitives
    gait = staged.gaits("TC1", "TO1")[0]
    assert gait.policy[6:] == tuple(-v for v in gait.policy[:6])
    assert gait.policy[:6] == shipped.gaits("TC1", "TO1")[0].policy
    with pytest.raises(LibraryError, match="or for each of 2 stages; got 18"):
        parse_library(yaml.safe_load(text.replace("policy_mm: [", "policy_mm: [0, 0, 0, 0, 0, 0, ")), "file")


def test_a_gait_of_the_wrong_class_is_refused(shipped):
    with pytest.raises(LibraryError, match=r"class TC6-TO5: it cannot roll TO5→TC6"):
        gait_of(shipped.primitives[0], "TO5", "TC6")


def test_an_unknown_primitive_is_refused_naming_those_there_are(shipped):
    with pytest.raises(LibraryError, match="no primitive 'P99': valid are P1, P2"):
        shipped.primitive("P99")


def test_writing_and_reading_keeps_everything(shipped, tmp_path):
    path = tmp_path / "copy.yaml"
    path.write_text(library_text(shipped), encoding="utf-8")
    copy = load_library(path)
    assert copy == shipped
    assert copy.hash == shipped.hash


def test_an_unknown_library_is_refused_naming_the_shipped_ones():
    with pytest.raises(LibraryError, match=r"shipped are: continuous, improved, previous, robust"):
        load_library("best")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ({"class": "TC6-TO5", "policy_mm": [1, 2, 3]}, "primitive 1: a policy has six strokes"),
        ({"class": "TC6-TO6", "policy_mm": [0] * 6}, "TC6-TO5 or TO5-TC6"),
        ({"class": "TC6-TO5"}, "valid is {name, class"),
        ("nonsense", "valid is {name, class"),
    ],
)
def test_a_bad_primitive_is_refused_naming_it(row, message):
    with pytest.raises(LibraryError, match=message):
        parse_library({"schema": 1, "primitives": [row]}, "here")


def test_broken_yaml_is_refused_with_its_line(tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text("schema: 1\nprimitives: [", encoding="utf-8")
    with pytest.raises(LibraryError, match=r"bad\.yaml is not valid YAML at line \d"):
        load_library(path)
