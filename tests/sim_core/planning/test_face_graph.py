# SPDX-License-Identifier: Apache-2.0
import itertools
import math

import pytest

from sim_core.errors import LibraryError, NotAdjacentError, UnknownFaceError
from sim_core.gaits.library import Library, Primitive
from sim_core.gaits.success_counts import SuccessCounts, load_success_counts, success_counts_text
from sim_core.planning.face_graph import FaceGraph
from sim_core.structure.roll_classes import TC_TO, TO_TC, rolls_of
from sim_core.structure.topology import FACES, NEIGHBOURS

LIBRARY = Library(
    "small",
    "0" * 16,
    {},
    (
        Primitive("A", TC_TO, (1, 2, 3, 4, 5, 6), {"success": 0.9}),
        Primitive("B", TC_TO, (6, 5, 4, 3, 2, 1), {"success": 0.7}),
        Primitive("C", TO_TC, (-1, 0, 0, 0, 0, 9), {"success": 0.8}),
    ),
)


@pytest.fixture
def counts():
    """B beats A in every fourth roll; C never works from TO5 to TC6."""
    wins = {"A": [80] * 24, "B": [90 if i % 4 == 0 else 40 for i in range(24)], "C": [98] * 24}
    wins["C"][rolls_of(TO_TC).index(("TO5", "TC6"))] = 0
    return SuccessCounts(LIBRARY.hash, "made up", 98, {name: tuple(row) for name, row in wins.items()})


def test_every_roll_has_all_gaits_of_its_class_the_most_reliable_first(counts):
    graph = FaceGraph(LIBRARY, counts)
    for source, targets in NEIGHBOURS.items():
        for target in targets:
            choices = graph.choices(source, target)
            assert len(choices) == (2 if source.startswith("TC") else 1)
            assert [c.probability for c in choices] == sorted((c.probability for c in choices), reverse=True)
    firsts = [graph.best(source, target).gait.primitive.name for source, target in rolls_of(TC_TO)]
    assert firsts == ["B" if i % 4 == 0 else "A" for i in range(24)]


def test_without_odds_a_primitives_own_rate_stands_for_its_gaits():
    assert {FaceGraph(LIBRARY).best(a, b).probability for a, b in rolls_of(TC_TO)} == {0.9}


def test_a_route_is_the_likeliest_of_all_walks(counts):
    graph = FaceGraph(LIBRARY, counts)
    best = {(a, b): graph.best(a, b).probability for a, targets in NEIGHBOURS.items() for b in targets}

    def likeliest(source, target, rolls):
        """By trying every walk of up to so many rolls."""
        walks, top = [(1.0, source)], 0.0
        for _ in range(rolls):
            walks = [(p * best[face, onto], onto) for p, face in walks for onto in NEIGHBOURS[face]]
            top = max([top, *(p for p, face in walks if face == target)])
        return top

    for source, target in itertools.islice(itertools.permutations(FACES, 2), 0, None, 37):
        route = graph.route(source, target)
        assert route.faces[0] == source
        assert route.faces[-1] == target
        assert route.probability == pytest.approx(math.prod(best[a, b] for a, b in itertools.pairwise(route.faces)))
        assert route.probability == pytest.approx(likeliest(source, target, 7), rel=1e-4)


def test_a_roll_that_never_worked_is_avoided(counts):
    assert FaceGraph(LIBRARY, counts).route("TO5", "TC6").faces != ("TO5", "TC6")


def test_one_class_alone_leads_nowhere_far():
    half = FaceGraph(Library("half", "0" * 16, {}, LIBRARY.primitives[:2]))
    assert half.route("TC6", "TO5").faces == ("TC6", "TO5")
    with pytest.raises(LibraryError, match="do not lead from TC6 to TC1"):
        half.route("TC6", "TC1")
    with pytest.raises(LibraryError, match="no primitive for TO5→TC6"):
        half.best("TO5", "TC6")


def test_wrong_faces_are_refused(counts):
    graph = FaceGraph(LIBRARY, counts)
    with pytest.raises(NotAdjacentError):
        graph.best("TC6", "TC1")
    with pytest.raises(UnknownFaceError):
        graph.route("TC6", "TC9")


def test_odds_are_read_as_they_were_written_and_only_for_their_library(counts, tmp_path):
    path = tmp_path / "small.odds.yaml"
    path.write_text(success_counts_text(counts), encoding="utf-8")
    assert load_success_counts(LIBRARY, path) == counts
    assert load_success_counts(LIBRARY) is None
    other = Library("other", "1" * 16, {}, LIBRARY.primitives)
    with pytest.raises(LibraryError, match="are of library"):
        load_success_counts(other, path)
    path.write_text("wins: 3", encoding="utf-8")
    with pytest.raises(LibraryError, match="cannot read success counts"):
        load_success_counts(LIBRARY, path)
