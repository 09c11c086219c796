"""A seeded random search for primitives: the plain beginning that a genetic generator will replace.

Policies are drawn uniformly (whole mm within the bound) for a robot resting on the reference face. Any feasible roll onto *any*
adjacent face is, relabelled by the symmetry group, a primitive of the reference pair, so none is thrown away. Candidates are
then tried in all 24 gaits on perturbed training prototypes, and the most reliable are kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from sim_core.batch import Batch, Job
from sim_core.library import Library, Primitive, gait_of
from sim_core.model import Model
from sim_core.perturbation import LAW, perturb
from sim_core.policy import Policy, checked_policy
from sim_core.roll import RollResult
from sim_core.structure import NEIGHBOURS
from sim_core.symmetry import CLASSES, RollClass, carrier, rolls_of

DRAWS_AT_ONCE = 256


@dataclass(frozen=True)
class SearchPlan:
    """What to search.

    Attributes:
        seed: same plan and model, same library.
        candidates: feasible policies to find per class before choosing. keep: primitives to keep per class.
        training: perturbed prototypes on which candidates are tried. scale: their perturbation.
        distance_mm: two kept primitives differ by at least this in some strut.
    """

    seed: int = 1
    candidates: int = 24
    keep: int = 6
    training: int = 8
    scale: float = 0.05
    distance_mm: int = 10


@dataclass(frozen=True)
class Progress:
    """Where a search is: class, phase ("find" or "try"), done of total, policies tried."""

    roll_class: str
    phase: str
    done: int
    total: int
    tried: int


def search(model: Model, plan: SearchPlan, report: Callable[[Progress], None] = lambda _: None) -> Library:
    """Find primitives of both classes with the nominal model, and rank them on perturbed prototypes."""
    nominal = Batch([model])
    training = Batch([perturb(model, plan.scale, plan.seed * 1000 + k) for k in range(plan.training)])
    kept: list[Primitive] = []
    tried_in_all = {}
    for roll_class in CLASSES.values():
        found, tried = _find(nominal, roll_class, plan, report)
        tried_in_all[roll_class.name] = tried

        def on_trials(done: int, total: int, name: str = roll_class.name, tried: int = tried) -> None:
            report(Progress(name, "try", done, total, tried))

        ranked = _tried(found, training, roll_class, on_trials)
        ranked.sort(key=lambda p: (-p.margins["success"], -p.margins["inside_mm"]))
        kept += ranked[: plan.keep]
    named = tuple(replace(p, name=f"P{i}") for i, p in enumerate(kept, start=1))
    provenance = {
        "how": "seeded uniform random policies, feasible on the nominal model, "
        "ranked by success over 24 gaits on training prototypes",
        "plan": {**vars(plan)},
        "policies_tried": tried_in_all,
        "perturbation_law": LAW,
    }
    return Library("first", model.hash, provenance, named)


def _draws(limit_mm: int, seed: list[int]) -> Iterator[Policy]:
    rng = np.random.default_rng(seed)
    while True:
        yield checked_policy(rng.integers(-limit_mm, limit_mm + 1, 6).tolist(), limit_mm)


def _find(
    nominal: Batch, roll_class: RollClass, plan: SearchPlan, report: Callable[[Progress], None]
) -> tuple[list[Primitive], int]:
    """Feasible policies of the reference pair, far enough from each other, in the order drawn; and how many were drawn."""
    draws = _draws(nominal.models[0].prototype.policy_limit_mm, [plan.seed, list(CLASSES).index(roll_class.name)])
    found: list[Primitive] = []
    tried = 0
    while True:
        drawn = list(islice(draws, DRAWS_AT_ONCE))
        for result in nominal.run([Job(0, roll_class.source, policy) for policy in drawn]):
            tried += 1
            if result.feasible and result.target in NEIGHBOURS[roll_class.source]:
                policy = _for_reference(result.policy, roll_class.source, result.target)
                if all(_distance(policy, other.policy) >= plan.distance_mm for other in found):
                    found.append(Primitive(f"P{len(found) + 1}", roll_class, policy, _margins(result)))
                    if len(found) == plan.candidates:
                        report(Progress(roll_class.name, "find", len(found), plan.candidates, tried))
                        return found, tried
        report(Progress(roll_class.name, "find", len(found), plan.candidates, tried))


def _margins(result: RollResult) -> dict[str, float]:
    return {
        "inside_mm": round(1e3 * result.margin_m, 2),
        "clearance_mm": round(1e3 * result.clearance_m, 2),
        "peak_force_n": round(result.peak_force_n, 1),
        "duration_s": round(result.duration_s, 2),
    }


def _for_reference(policy: Policy, source: str, target: str) -> Policy:
    """The policy of the reference pair whose relabelling to (source, target) is `policy`."""
    struts = carrier(source, target).struts
    back = [policy[struts[s]] for s in range(6)]
    return checked_policy(back, max(map(abs, back)) or 1)


def _distance(a: Policy, b: Policy) -> int:
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def _tried(found: list[Primitive], training: Batch, roll_class: RollClass, report: Callable[[int, int], None]) -> list[Primitive]:
    """The primitives with their success rate over 24 gaits on every training prototype as a margin."""
    trials = [
        Job(model, source, gait_of(primitive, source, target).policy, target)
        for primitive in found
        for model in range(len(training.models))
        for source, target in rolls_of(roll_class)
    ]
    wins = np.array([result.feasible for result in training.run(trials, report)]).reshape(len(found), -1)
    return [
        replace(primitive, margins={"success": round(float(row.mean()), 4), "trials": len(row), **primitive.margins})
        for primitive, row in zip(found, wins, strict=True)
    ]
