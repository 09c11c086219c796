# SPDX-License-Identifier: Apache-2.0
from itertools import pairwise

import pytest

from sim_core.structure.symmetry import carrier
from sim_core.structure.topology import FACES, NEIGHBOURS
from tensegrity_lab.studies.demo_route import next_face, walk


@pytest.mark.parametrize("start", FACES)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_walk_of_three_uses_three_different_gaits_with_a_mirrored_one_and_never_turns_back(start, seed):
    faces = walk(start, 3, seed)
    assert faces[0] == start
    assert len(faces) == 4
    assert all(b in NEIGHBOURS[a] for a, b in pairwise(faces))
    assert faces[0] != faces[2]
    assert faces[1] != faces[3]
    elements = [carrier(a, b) for a, b in pairwise(faces)]
    assert len({element.struts for element in elements}) == 3
    assert any(not element.proper for element in elements)


def test_the_same_seed_gives_the_same_walk():
    assert walk("TC6", 20, 5) == walk("TC6", 20, 5) != walk("TC6", 20, 6)


@pytest.mark.parametrize("start", FACES)
def test_short_walks_end_too(start):
    assert len(walk(start, 1, 1)) == 2
    assert len(walk(start, 2, 1)) == 3


def test_a_walk_from_the_reference_face_begins_with_the_reference_roll():
    assert walk("TC6", 3, 4)[:2] == ["TC6", "TO5"]
    assert walk("TO5", 3, 4)[:2] == ["TO5", "TC6"]


def test_a_mirrored_gait_is_preferred_when_wanted():
    import random

    for face in FACES:
        mirrored = [n for n in NEIGHBOURS[face] if not carrier(face, n).proper]
        chosen = next_face(face, None, set(), True, random.Random(1))
        assert not mirrored or chosen in mirrored
