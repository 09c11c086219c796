# SPDX-License-Identifier: Apache-2.0
"""A robustness study for people, for scripts and for tables."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sim_core.gaits.library import Library, gait_of
from sim_core.studies.attribution import Attribution
from sim_core.studies.binomial_intervals import EXCHANGEABLE, ONE_GAIT, Rate
from sim_core.studies.local_runner import Cost
from sim_core.studies.robustness import Study
from sim_core.uncertainty.perturbation_law import GROUPS, OURS
from tensegrity_lab.session_data.csv_tables import write_table

WORST = 8
"""Gaits to name."""
VIRTUAL = "These are virtual trials: the prototypes share the model's equations, so they test the library, not the model."


def head_of(library: Library, study: Study) -> str:
    """What was studied, in two lines."""
    plan = study.plan
    gaits, count = plan.shape
    tried = "the reference gait" if plan.one_gait else f"{gaits} gaits"
    numbers = f" (numbers {plan.numbers[0]} to {plan.numbers[-1]})" if plan.first else ""
    return (
        f"library {library.name} ({library.hash}): {len(study.primitives)} primitives, {tried} on each of {count} held-out "
        f"prototypes of seed {plan.seed}{numbers}\noff by {plan.law.brief} (docs: Perturbed prototypes)"
    )


def shown(rate: Rate) -> str:
    """A rate with its interval, in %."""
    return f"{100 * rate.value:6.2f} %  [{100 * rate.low:6.2f}, {100 * rate.high:6.2f}]"


def spread(rate: Rate) -> str:
    """Counts, rate and interval."""
    return f"{rate.successes} of {rate.trials}, {shown(rate).strip()}"


def text_of(library: Library, study: Study, blame: Attribution | None, wall_s: float) -> str:
    """The whole study for people."""
    lines = [head_of(library, study), "", f"{'primitive':<12} {'class':<8} success   95 % interval    weakest gait"]
    rows = zip(study.primitives, study.rates, study.gait_rates, study.gaits, strict=True)
    for primitive, rate, gaits, rolls in sorted(rows, key=lambda row: -row[1].value):
        weakest = min(range(len(gaits)), key=lambda g: gaits[g].value)
        source, target = rolls[weakest]
        weak = f"{source}→{target} {gaits[weakest].successes} of {gaits[weakest].trials}"
        lines.append(f"{primitive.name:<12} {primitive.roll_class.name:<8} {shown(rate)}  {weak}")
    lines += ["", f"primitives: {study.counts.text}", f"all trials: {spread(study.overall)}"]
    if blame is not None:
        lines += ["", *_blame_lines(blame, study)]
    lines += ["", cost_line(study.cost, wall_s), "", ONE_GAIT if study.plan.one_gait else EXCHANGEABLE, VIRTUAL]
    ours = [name for name in study.plan.law.groups if GROUPS[name].source == OURS]
    if ours:
        lines.append(f"The range of {', '.join(ours)} is a stand-in of ours.")
    return "\n".join(lines)


def _blame_lines(blame: Attribution, study: Study) -> Iterator[str]:
    count = len(blame.failures)
    if not count:
        yield "no trial failed: there is nothing to blame"
        return
    yield f"{count} of {blame.failed} failed trials, tried again:"
    yield f"{'uncertainty':<14} vanish without it   come with it alone"
    for row in blame.blames:
        yield f"{row.group:<14} {100 * row.vanish_without / count:13.0f} % {100 * row.come_alone / count:18.0f} %"
    if blame.nominal.any():
        yield f"{100 * blame.nominal.mean():.0f} % fail on the nominal robot too"
    worst = sorted(blame.killers_by_gait(study).items(), key=lambda item: -item[1].total())[:WORST]
    yield "gaits that failed most among these: " + "; ".join(f"{gait} by {_counted(killers)}" for gait, killers in worst)


def _counted(killers: Counter[str]) -> str:
    return ", ".join(f"{name} {number}" for name, number in killers.most_common())


def cost_line(cost: Cost, wall_s: float) -> str:
    """What the trials took."""
    return (
        f"cost: {cost.trials} rolls, {cost.robot_s:.0f} robot-seconds in {wall_s:.1f} s ({cost.robot_s / wall_s:.0f} × real time); "
        f"{cost.core_s:.1f} core-seconds, {1e3 * cost.core_s / cost.robot_s:.2f} core-ms a robot-second, "
        f"{100 * cost.build_s / cost.core_s:.0f} % of it to draw and build prototypes"
    )


def document_of(library: Library, study: Study, blame: Attribution | None, wall_s: float) -> dict[str, Any]:
    """The whole study for scripts."""
    plan = study.plan
    return {
        "library": library.name,
        "library_hash": library.hash,
        "law": {**vars(plan.law), "words": plan.law.text},
        "seed": plan.seed,
        "first": plan.first,
        "prototypes": plan.shape[1],
        "one_gait": plan.one_gait,
        "overall": rate_document(study.overall),
        "counts": study.counts._asdict(),
        "primitives": _primitive_rows(study),
        "gaits": _gait_rows(study, blame),
        "uncertainties": None
        if blame is None
        else {
            "failed": blame.failed,
            "looked_at": len(blame.failures),
            "nominal": int(blame.nominal.sum()),
            "groups": [row._asdict() for row in blame.blames],
        },
        "cost": {**study.cost._asdict(), "wall_s": wall_s},
        "notes": [ONE_GAIT if study.plan.one_gait else EXCHANGEABLE, VIRTUAL],
    }


def rate_document(rate: Rate) -> dict[str, float]:
    """A rate for JSON and CSV."""
    return {"successes": rate.successes, "trials": rate.trials, "rate": rate.value, "low": rate.low, "high": rate.high}


def _primitive_rows(study: Study) -> list[dict[str, Any]]:
    return [
        {"name": p.name, "class": p.roll_class.name, "policy_mm": p.policy, **rate_document(rate)}
        for p, rate in zip(study.primitives, study.rates, strict=True)
    ]


def _gait_rows(study: Study, blame: Attribution | None) -> list[dict[str, Any]]:
    killers = blame.killers_by_gait(study) if blame else {}
    return [
        {"primitive": p.name, "source": source, "target": target, **rate_document(rate)}
        | {"killers": killers.get(gait_of(p, source, target).name, Counter())}
        for p, rolls, rates in zip(study.primitives, study.gaits, study.gait_rates, strict=True)
        for (source, target), rate in zip(rolls, rates, strict=True)
    ]


def write_tables(study: Study, blame: Attribution | None, folder: Path) -> list[Path]:
    """Write primitives.csv, gaits.csv and trials.csv; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    primitives = ({"primitive": row.pop("name"), **row} for row in _primitive_rows(study))
    gaits = ({**row, "killers": _counted(row["killers"])} for row in _gait_rows(study, blame))
    tables = {"primitives.csv": primitives, "gaits.csv": gaits, "trials.csv": _trial_rows(study)}
    return [write_table(folder / name, rows) for name, rows in tables.items()]


def _trial_rows(study: Study) -> Iterator[dict[str, Any]]:
    for p, primitive in enumerate(study.primitives):
        for g, (source, target) in enumerate(study.gaits[p]):
            for k, number in enumerate(study.plan.numbers):
                at = p, g, k
                yield {
                    "primitive": primitive.name,
                    "source": source,
                    "target": target,
                    "seed": study.plan.seed,
                    "prototype": number,
                    "feasible": int(study.feasible[at]),
                    "margin_m": f"{study.margin_m[at]:.5f}",
                    "clearance_m": f"{study.clearance_m[at]:.5f}",
                    "peak_force_n": f"{study.peak_force_n[at]:.2f}",
                    "duration_s": f"{study.duration_s[at]:.2f}",
                    "reason": study.reasons[study.reason[at]],
                }
