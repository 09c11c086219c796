# SPDX-License-Identifier: Apache-2.0
"""Cycles: the group carries two policies over any chain of TCs, and files keep them."""

from dataclasses import replace
from itertools import product

import pytest

from sim_core.errors import LibraryError, RollRefused
from sim_core.files.yaml_reader import parse_yaml
from sim_core.gaits.cycle import NEXT_TC, TURNS, Cycle, CycleStage, Switches, chain_of, faces_of, turns_of
from sim_core.gaits.library import library_text, load_library, parse_library, wanted_chain
from sim_core.structure.symmetry import CARRIERS, GROUP
from sim_core.structure.topology import NEIGHBOURS

CYCLE = Cycle(
    "C1",
    (CycleStage((7, 44, -19, -17, -45, -45), 0.1, 3.5), CycleStage((-24, -21, -30, -41, 45, 15), 0.0, 4.2)),
    {TURNS[0]: Switches(2400, 2396, 200, 200), TURNS[1]: Switches(2400, 2380, 200, 198)},
    {"m_per_min": 1.21},
)


@pytest.mark.parametrize("turn", TURNS)
def test_the_same_turn_again_and_again_visits_six_tcs_and_comes_back(turn):
    faces = faces_of("TC6", "TO5", [turn] * 6)
    assert faces[12:] == faces[:3]
    assert len(set(faces[:12])) == 12


def test_every_chain_goes_over_neighbours_and_never_back():
    for turns in product(TURNS, repeat=4):
        faces = faces_of("TC6", "TO5", turns)
        assert turns_of(faces) == turns
        for before, face, after in zip(faces, faces[1:], faces[2:], strict=False):
            assert face in NEIGHBOURS[before]
            assert after != before


def test_a_chain_is_the_reference_chain_under_the_group():
    turns = (TURNS[0], TURNS[1], TURNS[1])
    reference = chain_of(CYCLE, faces_of("TC6", "TO5", turns))
    assert [roll.policy for roll in reference[:2]] == [stage.policy for stage in CYCLE.stages]
    assert [roll.onto for roll in reference[:2]] == ["TO5", NEXT_TC]
    for (tc, to), element in CARRIERS.items():
        carried = chain_of(CYCLE, faces_of(tc, to, turns))
        assert [roll.onto for roll in carried] == [element.face(roll.onto) for roll in reference]
        assert [roll.policy for roll in carried] == [element.relabel(roll.policy) for roll in reference]
    assert len(GROUP) == len(CARRIERS)


@pytest.mark.parametrize(
    ("faces", "why"),
    [
        (("TC6", "TO5"), "odd number"),
        (("TO5", "TC3", "TO4"), "odd number"),
        (("TC6", "TO5", "TC6"), "goes to TC3"),
        (("TC6", "TO5", "TC3", "TO5", "TC6"), "does not go from TO5"),
    ],
)
def test_other_ways_are_refused(faces, why):
    with pytest.raises(RollRefused, match=why):
        chain_of(CYCLE, faces)


def test_a_library_keeps_cycles_and_its_hash_knows_them():
    plain = load_library("robust")
    mixed = type(plain)(plain.name, plain.model_hash, plain.provenance, plain.primitives, (CYCLE,))
    again = parse_library(parse_yaml(library_text(mixed), "there"), "there")
    assert again.cycles == (CYCLE,)
    assert again.hash == mixed.hash != plain.hash
    assert "schema: 1" in library_text(plain)
    assert CYCLE.turns[TURNS[1]].miss == pytest.approx(20 / 2400)


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("dwell_s: 0.1", "dwell_s: -1"), ("rolls: 2400", "rolls: many"), ("TO4:", "TO1:"), ("[7, 44,", "[7.5, 44,"), ("C1", "[1]")],
)
def test_a_damaged_cycle_is_named(wrong, right):
    plain = load_library("robust")
    text = library_text(type(plain)(plain.name, plain.model_hash, plain.provenance, plain.primitives, (CYCLE,)))
    assert wrong in text
    if right == "[1]":
        text += "- name: C1\n  stages: []\n"
    with pytest.raises(LibraryError, match=r"cycle [12]"):
        parse_library(parse_yaml(text.replace(wrong, right), "there"), "there")


def test_the_chain_that_is_wanted_is_of_the_named_cycle_or_the_first():
    shelf = replace(load_library("robust"), cycles=(CYCLE, replace(CYCLE, name="C2")))
    faces = faces_of("TC6", "TO5", TURNS[:1])
    assert wanted_chain(shelf, "TC6", faces[1:]).name == f"C1 {'→'.join(faces)}"
    assert wanted_chain(shelf, "TC6", faces[1:], "C2").cycle.name == "C2"
    with pytest.raises(RollRefused, match="no cycle 'P1': valid are C1, C2"):
        wanted_chain(shelf, "TC6", faces[1:], "P1")
    with pytest.raises(RollRefused, match="robust has no cycles"):
        wanted_chain(load_library("robust"), "TC6", faces[1:])
    with pytest.raises(RollRefused, match="goes to"):
        wanted_chain(shelf, "TC6", ("TO5", "TC6"))
