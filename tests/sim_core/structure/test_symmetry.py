# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from sim_core.structure.symmetry import CARRIERS, GROUP, REFERENCE_TC, REFERENCE_TO, carrier
from sim_core.structure.topology import FACES, NODES, PAIRS, STRUTS, TENDONS


def index_of(matrix):
    matches = [i for i, element in enumerate(GROUP) if np.allclose(element.matrix, matrix)]
    assert len(matches) == 1
    return matches[0]


def test_the_group_is_closed_with_identity_inverses_and_associativity():
    assert index_of(np.eye(3)) == 0
    table = np.array([[index_of(a.matrix @ b.matrix) for b in GROUP] for a in GROUP])
    assert all(sorted(row) == list(range(24)) for row in table)
    assert all(0 in row for row in table)
    assert all(table[table[a, b], c] == table[a, table[b, c]] for a in range(24) for b in range(24) for c in range(24))


def test_twelve_elements_are_improper():
    assert sum(not element.proper for element in GROUP) == 12
    assert all(element.proper == (np.linalg.det(element.matrix) > 0) for element in GROUP)


def test_elements_permute_nodes_struts_tendons_and_faces():
    for element in GROUP:
        assert np.allclose(NODES @ element.matrix.T, NODES[list(element.nodes)])
        assert sorted(element.struts) == list(range(6))
        assert {tuple(sorted((element.nodes[a], element.nodes[b]))) for a, b in TENDONS} == set(TENDONS)
        assert sorted(element.face(face) for face in FACES) == sorted(FACES)
        for strut, (a, b) in enumerate(STRUTS):
            assert {element.nodes[a], element.nodes[b]} == set(STRUTS[element.struts[strut]])


def test_exactly_one_element_carries_the_reference_pair_to_each_adjacent_pair():
    images = [(element.face(REFERENCE_TC), element.face(REFERENCE_TO)) for element in GROUP]
    assert sorted(images) == sorted(PAIRS)
    assert all(CARRIERS[pair].face(REFERENCE_TC) == pair[0] for pair in PAIRS)


@pytest.mark.parametrize(
    ("pair", "word", "proper"),
    [
        (("TC6", "TO5"), "123456", True),
        (("TC1", "TO1"), "651243", True),
        (("TC4", "TO12"), "246135", True),
        (("TC4", "TO4"), "615342", True),
        (("TC6", "TO7"), "451362", True),
        (("TC8", "TO7"), "415362", False),
        (("TC2", "TO3"), "532614", False),
    ],
)
def test_known_rows_of_the_relabelling_table(pair, word, proper):
    element = carrier(*pair)
    assert "".join(map(str, element.relabel([1, 2, 3, 4, 5, 6]))) == word
    assert element.relabel([1, 2, 3, 4, 5, 6, 0, 0, 0, 0, 0, 7])[:6] == element.relabel([1, 2, 3, 4, 5, 6]), "stage by stage"
    assert element.proper is proper
    assert carrier(*reversed(pair)) is element


def test_relabelling_follows_the_group_product():
    policy = (3, -7, 11, 0, 25, -40)
    for a in GROUP[::5]:
        for b in GROUP[::7]:
            assert GROUP[index_of(a.matrix @ b.matrix)].relabel(policy) == a.relabel(b.relabel(policy))
