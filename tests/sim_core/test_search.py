from sim_core import search as module
from sim_core.search import SearchPlan, search
from sim_core.symmetry import TO_TC


def test_a_seeded_search_finds_the_same_feasible_primitives_again(model, monkeypatch):
    """Only the quick class here: the other takes some hundred policies."""
    monkeypatch.setattr(module, "CLASSES", {TO_TC.name: TO_TC})
    plan, seen = SearchPlan(seed=3, candidates=2, keep=2, training=1), []
    library = search(model, plan, seen.append)
    again = search(model, SearchPlan(seed=3, candidates=1, keep=1, training=1))
    assert again.primitives[0].policy in {p.policy for p in library.primitives}
    assert library.model_hash == model.hash
    assert len(library.primitives) == 2
    assert all(0.0 <= p.margins["success"] <= 1.0 and p.margins["trials"] == 24 for p in library.primitives)
    assert seen[-1].phase == "try"
    assert max(abs(a - b) for a, b in zip(*(p.policy for p in library.primitives), strict=True)) >= plan.distance_mm
