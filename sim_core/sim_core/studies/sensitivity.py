# SPDX-License-Identifier: Apache-2.0
"""What each number of the model influences: how often a roll's outcome changes when it is a little different.

Computed, not asserted.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from sim_core.dynamics.model import build_model
from sim_core.errors import SimError
from sim_core.files.bounded_reader import DATA
from sim_core.files.yaml_reader import read_yaml, yaml_text
from sim_core.gaits.library import Library
from sim_core.rolling.batch import Batch, Job
from sim_core.rolling.roll import RollResult
from sim_core.structure.parameters import SPECS, Prototype, with_value
from sim_core.structure.policy import MOST_STAGES, checked_policy

STORED = DATA / "sensitivity.yaml"
"""Where the nominal model's influences are kept."""
STEP = 0.10
"""Relative change of a parameter, to either side."""
ANGLE_STEP_RAD = 0.02
"""Change of a slope, which is zero."""
EACH = 3
"""Policies near each primitive: itself, and shifted ones."""
SHIFT_MM = 6
"""Largest random shift of a library's strokes: makes policies that are good, marginal and bad."""


class Influence(NamedTuple):
    """What a change of one parameter does.

    Attributes:
        flips: share of the policies whose outcome (feasible or not) changes, mean of both sides; None if neither side can be built.
        margin_mm: mean change of the centre of mass's margin inside the base, of policies feasible before and after, per +STEP.
    """

    flips: float | None
    margin_mm: float | None


def policies_near(library: Library, limit_mm: int, each: int, seed: int) -> list[Job]:
    """Rolls of the reference pairs with the library's policies, each as it is and `each − 1` times shifted at random."""
    rng = np.random.default_rng(seed)
    jobs = []
    for primitive in library.primitives:
        for number in range(each):
            given = np.array(primitive.policy)
            shift = rng.integers(-SHIFT_MM, SHIFT_MM + 1, len(given)) if number else np.zeros(len(given), dtype=int)
            policy = checked_policy(np.clip(given + shift, -limit_mm, limit_mm).tolist(), limit_mm, MOST_STAGES)
            jobs.append(Job(0, primitive.roll_class.source, policy, primitive.roll_class.target))
    return jobs


def influences(
    prototype: Prototype,
    library: Library,
    each: int = EACH,
    seed: int = 1,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> dict[str, Influence]:
    """Vary one parameter at a time by ±STEP and roll the policies near the library's.

    The nominal model is symmetric and stays so under these changes (but for a slope): the reference pair stands for all 24 gaits.
    """
    jobs = policies_near(library, prototype.policy_limit_mm, each, seed)
    nominal = Batch([build_model(prototype)]).run(jobs)
    names = [name for name, spec in SPECS.items() if not spec.whole]
    found = {}
    for done, name in enumerate(names, start=1):
        sides = [_rolled(_changed(prototype, name, sign), jobs) for sign in (-1.0, 1.0)]
        flips = [np.mean([a.feasible != b.feasible for a, b in zip(nominal, side, strict=True)]) for side in sides if side]
        slopes = [
            sign * (b.margin_m - a.margin_m)
            for sign, side in zip((-1.0, 1.0), sides, strict=True)
            for a, b in zip(nominal, side or [], strict=False)
            if a.feasible and b.feasible
        ]
        found[name] = Influence(
            round(float(np.mean(flips)), 4) if flips else None, round(1e3 * float(np.mean(slopes)), 3) if slopes else None
        )
        report(done, len(names))
    return found


def _changed(prototype: Prototype, name: str, sign: float) -> Prototype | None:
    """The prototype with one parameter a step off; None if that is not a valid robot."""
    value: Any = getattr(prototype, name)
    step = sign * STEP
    if name == "ground_slope_rad":
        new: Any = (value[0] + sign * ANGLE_STEP_RAD, value[1] + sign * ANGLE_STEP_RAD)
    elif isinstance(value, tuple):
        new = tuple(item * (1.0 + step) for item in value)
    else:
        new = value * (1.0 + step)
    try:
        return with_value(prototype, name, new)
    except SimError:
        return None


def _rolled(prototype: Prototype | None, jobs: list[Job]) -> list[RollResult] | None:
    if prototype is None:
        return None
    try:
        return Batch([build_model(prototype)]).run(jobs)
    except SimError:
        return None


def text_of(prototype: Prototype, library: Library, each: int, found: Mapping[str, Influence]) -> str:
    """The YAML of influences, with what they belong to."""
    head = {
        "how": f"each parameter by ±{STEP:.0%} alone (slopes by ±{ANGLE_STEP_RAD} rad), "
        f"{each * len(library.primitives)} policies near library {library.name}; flips: share of outcomes that change; "
        f"margin_mm: change of the centre of mass's margin per +{STEP:.0%}",
        "prototype_hash": prototype.hash,
        "library_hash": library.hash,
    }
    lines = [yaml_text(head) + "influences:"]

    def shown(value: float | None) -> str:
        return "null" if value is None else str(value)

    lines += [f"  {name}: {{flips: {shown(row.flips)}, margin_mm: {shown(row.margin_mm)}}}" for name, row in found.items()]
    return "\n".join(lines) + "\n"


def stored_influences(prototype: Prototype) -> dict[str, Influence] | None:
    """The stored influences if they were computed for these very numbers, else None."""
    document = read_yaml(STORED)
    if document["prototype_hash"] != prototype.hash:
        return None
    return {name: Influence(row["flips"], row["margin_mm"]) for name, row in document["influences"].items()}
