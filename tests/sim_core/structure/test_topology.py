# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from sim_core.errors import NotAdjacentError, UnknownFaceError
from sim_core.structure.topology import (
    FACES,
    NEIGHBOURS,
    NODES,
    PAIRS,
    STRUTS,
    TENDON_LENGTH,
    TENDONS,
    require_adjacent,
    require_face,
)


def test_six_parallel_pairs_of_struts_at_half_a_length():
    axes = np.array([NODES[b] - NODES[a] for a, b in STRUTS])
    assert np.allclose(np.linalg.norm(axes, axis=1), 1.0)
    middles = np.array([(NODES[a] + NODES[b]) / 2 for a, b in STRUTS])
    partners = [[j for j in range(6) if j != i and abs(abs(axes[i] @ axes[j]) - 1.0) < 1e-12] for i in range(6)]
    assert [len(p) for p in partners] == [1] * 6
    assert all(np.isclose(np.linalg.norm(middles[i] - middles[p[0]]), 0.5) for i, p in enumerate(partners))


def test_twenty_four_tendons_four_at_each_node():
    assert len(TENDONS) == 24
    assert np.allclose([np.linalg.norm(NODES[i] - NODES[j]) for i, j in TENDONS], TENDON_LENGTH)
    assert [sum(node in pair for pair in TENDONS) for node in range(12)] == [4] * 12


@pytest.mark.parametrize(("prefix", "count", "tendon_edges"), [("TC", 8, 3), ("TO", 12, 2)])
def test_faces_have_their_tendon_edges(prefix, count, tendon_edges):
    faces = {name: nodes for name, nodes in FACES.items() if name.startswith(prefix)}
    assert len(faces) == count
    for nodes in faces.values():
        edges = [tuple(sorted(pair)) for pair in (nodes[:2], nodes[1:], nodes[::2])]
        assert sum(edge in TENDONS for edge in edges) == tendon_edges


def test_each_closed_face_touches_three_open_ones_and_each_open_face_two_closed_ones():
    assert {len(NEIGHBOURS[f]) for f in FACES if f.startswith("TC")} == {3}
    assert {len(NEIGHBOURS[f]) for f in FACES if f.startswith("TO")} == {2}
    assert len(PAIRS) == 24
    assert all(a in NEIGHBOURS[b] for a in FACES for b in NEIGHBOURS[a])


@pytest.mark.parametrize("pair", [("TC6", "TO5"), ("TC4", "TO4"), ("TC4", "TO12"), ("TO7", "TC6"), ("TO7", "TC8")])
def test_pairs_that_the_paper_names_are_adjacent(pair):
    assert pair[1] in NEIGHBOURS[pair[0]]
    require_adjacent(*pair)


def test_heights_and_turn_of_the_ideal_body():
    centre = {name: NODES[list(nodes)].mean(axis=0) for name, nodes in FACES.items()}

    def normal(name):
        a, b, c = NODES[list(FACES[name])]
        n = np.cross(b - a, c - a)
        return n / np.linalg.norm(n) * np.sign(n @ centre[name])

    height = {name: normal(name) @ NODES[FACES[name][0]] for name in FACES}
    assert height["TC6"] == pytest.approx(0.4330, abs=5e-5)
    assert height["TO5"] == pytest.approx(0.4472, abs=5e-5)
    for closed, opened in PAIRS:
        assert np.degrees(np.arccos(normal(closed) @ normal(opened))) == pytest.approx(39.23, abs=0.01)


def test_an_unknown_face_is_refused_naming_the_valid_ones():
    with pytest.raises(UnknownFaceError, match=r"'TC9'.*TC1\.\.TC8.*TO1\.\.TO12"):
        require_face("TC9")


def test_a_pair_that_is_not_adjacent_is_refused_naming_the_neighbours():
    with pytest.raises(NotAdjacentError, match=r"TO1 is not adjacent to TC6.*TO5, TO7, TO9"):
        require_adjacent("TC6", "TO1")
