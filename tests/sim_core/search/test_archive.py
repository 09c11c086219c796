# SPDX-License-Identifier: Apache-2.0
import itertools

from hypothesis import given
from hypothesis import strategies as st

from sim_core.search.archive import Candidate, Elites, distance_mm

policies = st.tuples(*[st.integers(-45, 45)] * 6)
candidates = st.lists(st.builds(Candidate, policies, st.floats(0, 4), st.just({})), max_size=30, unique_by=lambda c: c.policy)


@given(candidates, st.integers(1, 60), st.integers(1, 10))
def test_elites_are_ranked_and_apart_and_not_too_many(found, apart, most):
    ranked = Elites(apart, most, found).ranked
    assert len(ranked) <= most
    assert [c.merit for c in ranked] == sorted((c.merit for c in ranked), reverse=True)
    assert all(distance_mm(a.policy, b.policy) >= apart for a, b in itertools.combinations(ranked, 2))
    if found:
        assert ranked[0].merit == max(c.merit for c in found)


@given(candidates, st.randoms())
def test_the_order_in_which_candidates_come_does_not_matter(found, random):
    shuffled = random.sample(found, len(found))
    assert Elites(10, 8, found).ranked == Elites(10, 8, shuffled).ranked


def test_a_better_neighbour_takes_the_place_of_an_elite():
    near, far = (10, 0, 0, 0, 0, 0), (-30, 0, 0, 0, 0, 0)
    elites = Elites(15, 5, [Candidate((0, 0, 0, 0, 0, 0), 2.1, {}), Candidate(far, 2.0, {})])
    elites.add([Candidate(near, 2.2, {})])
    assert [c.policy for c in elites.ranked] == [near, far]
    assert elites.count(2.1) == 1
