# SPDX-License-Identifier: Apache-2.0
"""The robustness study: all 24 gaits of every primitive on perturbed prototypes that nobody trained on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_core.errors import LibraryError, ParameterError
from sim_core.gaits.library import Library, Primitive, gait_of
from sim_core.gaits.success_counts import SuccessCounts
from sim_core.rolling.batch import Job
from sim_core.structure.elements import IMPROVED
from sim_core.structure.parameters import Prototype
from sim_core.structure.policy import MOST_STAGES, checked_policy
from sim_core.structure.roll_classes import rolls_of
from sim_core.studies.binomial_intervals import Counts, Rate, counts_of, rate_of, rates_along
from sim_core.studies.local_runner import Chunk, Cost, Draw, Reporter, Runner, Trials, joined, run_here, silent
from sim_core.uncertainty.perturbation_law import Law

HELD_OUT_SEED = 90_001
"""Of the final figures' prototypes; no search may train on it."""
CHUNK_JOBS, LARGEST_CHUNK_JOBS = 1000, 20_000
"""About how many rolls make a chunk: of a small study, and of a large one, which must not keep a cluster's scheduler too busy."""
CHUNKS = 1000
"""A study that would have more chunks than this gets larger ones."""
GAITS = 24


@dataclass(frozen=True)
class StudyPlan:
    """What to study.

    Attributes:
        law, seed: of the prototypes.
        prototypes: how many, K.
        first: number of the first one in this seed's endless row, so that a large study can be done in slices.
        one_gait: instead of 24 gaits on K prototypes, the reference gait on 24 K: the same under a symmetric law.
    """

    law: Law = field(default_factory=Law)
    seed: int = HELD_OUT_SEED
    prototypes: int = 20
    one_gait: bool = False
    first: int = 0

    def __post_init__(self) -> None:
        if self.prototypes < 1:
            raise ParameterError(f"{self.prototypes} prototypes: valid is a whole number of 1 or more")
        if self.first < 0 or self.seed < 0:
            raise ParameterError(f"first prototype {self.first}, seed {self.seed}: valid are whole numbers of 0 or more")
        if self.one_gait and not self.law.symmetric:
            raise ParameterError("one gait stands for 24 only under a symmetric law, and a slope has a direction: leave out slope")

    @property
    def shape(self) -> tuple[int, int]:
        """(gaits, prototypes) of each primitive's trials."""
        return (1, GAITS * self.prototypes) if self.one_gait else (GAITS, self.prototypes)

    @property
    def numbers(self) -> range:
        """Of the prototypes, in the trials' order."""
        start = self.first * (GAITS if self.one_gait else 1)
        return range(start, start + self.shape[1])


@dataclass(frozen=True)
class Study:
    """Outcomes. Arrays are (primitives, gaits, prototypes); with one gait, (primitives, 1, 24 K).

    Attributes:
        gaits: the rolls' (source, target) of each primitive, in the arrays' order.
        reason: index into `reasons`; 0 is the empty one.
    """

    plan: StudyPlan
    primitives: tuple[Primitive, ...]
    gaits: tuple[tuple[tuple[str, str], ...], ...]
    feasible: NDArray[np.bool_]
    margin_m: NDArray[np.float32]
    clearance_m: NDArray[np.float32]
    peak_force_n: NDArray[np.float32]
    duration_s: NDArray[np.float32]
    reason: NDArray[np.int32]
    reasons: tuple[str, ...]
    cost: Cost

    @property
    def rates(self) -> list[Rate]:
        """Of each primitive, over gaits and prototypes."""
        return rates_along(self.feasible)

    @property
    def gait_rates(self) -> list[list[Rate]]:
        """Of each primitive's gaits, over prototypes."""
        return [rates_along(rows) for rows in self.feasible]

    @property
    def counts(self) -> Counts:
        """How many primitives reach the paper's levels."""
        return counts_of(self.rates)

    @property
    def overall(self) -> Rate:
        """Of all trials together."""
        return rate_of(int(self.feasible.sum()), self.feasible.size)


def training_seeds(library: Library) -> frozenset[int]:
    """Every seed that the library's provenance names, but for those under a key with `held_out`: of its search and its training."""
    found: set[int] = set()

    def visit(node: Any, named: bool) -> None:
        if isinstance(node, Mapping):
            for key, value in node.items():
                visit(value, (named or "seed" in str(key)) and "held_out" not in str(key))
        elif isinstance(node, (list, tuple)):
            for value in node:
                visit(value, named)
        elif named and isinstance(node, int) and not isinstance(node, bool):
            found.add(node)

    visit(library.provenance, False)
    plan = library.provenance.get("plan")
    if isinstance(plan, Mapping) and isinstance(plan.get("seed"), int) and isinstance(plan.get("training"), int):
        found |= {plan["seed"] * 1000 + k for k in range(plan["training"])}  # as `search` counts its prototypes
    return frozenset(found)


def require_held_out(library: Library, seed: int) -> None:
    """Raise LibraryError if the library was trained with this seed."""
    known = training_seeds(library)
    if seed in known:
        free = next(s for s in range(HELD_OUT_SEED, HELD_OUT_SEED + len(known) + 1) if s not in known)
        raise LibraryError(
            f"seed {seed} is a training seed of library {library.name!r}: its prototypes are not held out; "
            f"take another, e.g. {free}"
        )


def gaits_of(primitive: Primitive, one_gait: bool) -> tuple[tuple[str, str], ...]:
    """The rolls on which a primitive is tried."""
    reference = primitive.roll_class
    return ((reference.source, reference.target),) if one_gait else rolls_of(reference)


def success_counts_of(library: Library, study: Study) -> SuccessCounts:
    """Every gait's successes in a study of the whole library.

    Raises:
        ParameterError: a study of the reference gait alone, or of some primitives only.
    """
    if study.plan.one_gait or len(study.primitives) != len(library.primitives):
        raise ParameterError("success counts need all 24 gaits of every primitive: leave out --one-gait and --quick")
    plan = study.plan
    wins = {p.name: tuple(int(won) for won in rows.sum(axis=1)) for p, rows in zip(study.primitives, study.feasible, strict=True)}
    return SuccessCounts(library.primitives_hash, f"{plan.law.text}; seed {plan.seed}", plan.prototypes, wins)


def chunk_jobs(rolls: int) -> int:
    """Rolls of a chunk in a study of so many. It does not depend on the workers, so neither do results."""
    return min(LARGEST_CHUNK_JOBS, max(CHUNK_JOBS, rolls // CHUNKS))


def chunks_of(
    prototype: Prototype, primitives: Sequence[Primitive], plan: StudyPlan, kind: str = IMPROVED, size: int | None = None
) -> list[Chunk]:
    """The study's work: every chunk some prototypes with all their rolls, prototype by prototype, primitive by primitive.

    `size`: rolls of a chunk; default: see `chunk_jobs`.
    """
    rolls = []
    for primitive in primitives:
        for source, target in gaits_of(primitive, plan.one_gait):
            policy = checked_policy(gait_of(primitive, source, target).policy, prototype.policy_limit_mm, MOST_STAGES)
            rolls.append((source, policy, target))
    if not rolls:
        raise LibraryError("the library has no primitives: there is nothing to study")
    each = max(1, (size or chunk_jobs(plan.shape[1] * len(rolls))) // len(rolls))
    chunks = []
    for at in range(0, plan.shape[1], each):
        draws = tuple(Draw(plan.law, plan.seed, number) for number in plan.numbers[at : at + each])
        jobs = tuple(Job(model, *roll) for model in range(len(draws)) for roll in rolls)
        chunks.append(Chunk(prototype, draws, jobs, kind))
    return chunks


def study(
    prototype: Prototype,
    primitives: Sequence[Primitive],
    plan: StudyPlan,
    runner: Runner = run_here,
    report: Reporter = silent,
    kind: str = IMPROVED,
) -> Study:
    """Roll every primitive in its gaits on every prototype.

    Raises:
        LibraryError, PolicyError, ParameterError, ModelError.
    """
    done = runner(chunks_of(prototype, primitives, plan, kind), report)
    return assembled(primitives, plan, done)


def assembled(primitives: Sequence[Primitive], plan: StudyPlan, done: Sequence[Trials]) -> Study:
    """The trials of a study's chunks, put in order."""
    (gaits, count), trials = plan.shape, joined(done)

    def table(column: NDArray[Any]) -> NDArray[Any]:
        return np.ascontiguousarray(np.moveaxis(column.reshape(count, len(primitives), gaits), 0, -1))

    said: dict[str, int] = {"": 0}
    reason = np.array([said.setdefault(text, len(said)) for text in trials.reason], dtype=np.int32)
    return Study(
        plan,
        tuple(primitives),
        tuple(gaits_of(primitive, plan.one_gait) for primitive in primitives),
        table(trials.feasible),
        table(trials.margin_m),
        table(trials.clearance_m),
        table(trials.peak_force_n),
        table(trials.duration_s),
        table(reason),
        tuple(said),
        trials.cost,
    )
