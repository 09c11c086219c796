# SPDX-License-Identifier: Apache-2.0
"""A study of cycles for people, for scripts and for its page."""

from collections.abc import Sequence
from typing import Any

from sim_core.gaits.cycle import TURNS
from sim_core.gaits.library import Library
from sim_core.uncertainty.perturbation_law import Law
from tensegrity_lab.reports.markdown import table
from tensegrity_lab.reports.robustness_report import VIRTUAL, rate_document
from tests.studies.chain_study import BLIND_ROLLS, LONG, ROLLS, STOP_AND_GO, Chains
from tests.studies.pace_bound import PaceBound

NOTES = (
    f"Chains of {ROLLS} rolls, each next stage 0.4 s after the face was seen, then neutral. *In a row*: without a miss, at rest in "
    "neutral at the end, clearance and strut forces as a roll's. Straight on by either turn; random: each robot its own turns; "
    f"blind: {BLIND_ROLLS} rolls straight on, each by its own time, as where nobody looks.",
    "m/min: straight way over time, first landing to last. m in ten minutes: way for the time that a strut may run in them, "
    f"from neutral to neutral by chains of {LONG} rolls; for {STOP_AND_GO}, by the library's best gaits over the same faces.",
)


def chains_table(chains: Sequence[Chains]) -> str:
    """All ways of rolling on, as Markdown."""
    head = ("cycle", "turns", "actuators", "rolls", "in a row", "m/min", "m in ten minutes", "least clearance", "misses")
    return table(head, map(_row, chains), "lll" + "r" * 5 + "l")


def _row(c: Chains) -> tuple[str, ...]:
    straight = c.turns in TURNS
    return (
        c.cycle,
        c.turns,
        c.actuators,
        f"{100 * c.rolls.value:.2f} % of {c.rolls.trials}",
        f"{100 * c.whole.value:.1f} % of {c.whole.trials}, at least {100 * c.whole.low:.1f} %",
        f"{c.m_per_min:.2f}" if straight else "",
        f"{c.m_per_10min:.1f}" if straight else "",
        f"{1e3 * c.clearance_m:.1f} mm",
        "; ".join(f"{count}: {why}" for why, count in c.misses[:2]),
    )


def bound_text(bounds: Sequence[PaceBound]) -> str:
    """What the actuators would allow, in one paragraph."""
    fast = " and ".join(f"{b.m_per_min:.2f} m/min by {b.turn} (two rolls in {b.two_rolls_s:.1f} s)" for b in bounds)
    return (
        "*How fast it could be.* If each roll began where the last one tipped over, nothing waited and nothing swung, speed and "
        f"stroke of the actuators would allow {fast}: a linear program about neutral, in which the robot tips once its centre of "
        "mass is past the edge. It is no bound for a robot that swings: what a cycle gains above it is momentum, what it lacks is "
        "waiting."
    )


def chains_text(
    library: Library, law: Law, seed: int, prototypes: int, chains: Sequence[Chains], bounds: Sequence[PaceBound]
) -> str:
    """The whole study, as Markdown."""
    head = (
        f"Library {library.name} ({library.hash}) on {prototypes} held-out prototypes of seed {seed}, off by {law.brief}, their "
        "actuators as well where they feel their load."
    )
    return "\n\n".join((head, chains_table(chains), bound_text(bounds), *NOTES, VIRTUAL))


def chains_document(
    library: Library, law: Law, seed: int, prototypes: int, chains: Sequence[Chains], bounds: Sequence[PaceBound]
) -> dict[str, Any]:
    """The whole study for scripts."""
    rows = [c._asdict() | {"rolls": rate_document(c.rolls), "whole": rate_document(c.whole)} for c in chains]
    about = {"library": library.name, "library_hash": library.hash, "law": law.text, "seed": seed, "prototypes": prototypes}
    return about | {"chains": rows, "bounds": [b._asdict() for b in bounds], "notes": [*NOTES, VIRTUAL]}
