# SPDX-License-Identifier: Apache-2.0
"""A library's cycles in MuJoCo and in our solver: the same robots, the same chains, judged by the same code."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim_core.dynamics.model import build_model
from sim_core.gaits.cycle import TURNS, chain_of
from sim_core.gaits.library import Library
from sim_core.rolling.batch import Batch
from sim_core.rolling.course import Course, CourseResult, stages_of_chain
from sim_core.structure.parameters import Prototype
from sim_core.structure.symmetry import REFERENCE_TC
from sim_core.studies.binomial_intervals import Rate, rate_of
from sim_core.studies.local_runner import Draw
from sim_core.studies.robustness import HELD_OUT_SEED, require_held_out
from sim_core.uncertainty.perturbation_law import Law, sample
from tensegrity_lab.reports.markdown import table
from tests.benchmarks.solver.mujoco_engine import MuJoCo, judged
from tests.studies.chain_study import RANDOM, ROLLS, chain_faces

STEP_S = 2e-3
LAW = Law(0.1)
ENGINES = ("sixstrut", "MuJoCo")


@dataclass(frozen=True)
class Went:
    """How the chains of one kind went in one engine.

    Attributes:
        onto_next: rolls that came onto the next face, of those that were begun.
        in_a_row: chains that made all rolls, of all chains.
        stayed: chains that then stood on the last face in neutral, of all chains.
        m_per_min: mean way between first and last landing, straight, over time.
    """

    onto_next: Rate
    in_a_row: Rate
    stayed: Rate
    m_per_min: float


@dataclass(frozen=True)
class Compared:
    """A cycle's chains of one kind in both engines, as in ENGINES.

    Attributes:
        turns: one of TURNS again and again, or RANDOM.
        robots: which, in words.
    """

    cycle: str
    turns: str
    robots: str
    went: tuple[Went, Went]

    @property
    def apart(self) -> float:
        """By how many points MuJoCo's share of rolls onto the next face is above ours."""
        ours, theirs = self.went
        return 100.0 * (theirs.onto_next.value - ours.onto_next.value)


def went(results: Sequence[CourseResult]) -> Went:
    """Count chains."""
    begun = sum(min(r.reached + 1, r.wanted) for r in results)
    whole = [r for r in results if r.reached == r.wanted]
    return Went(
        rate_of(sum(r.reached for r in results), begun),
        rate_of(len(whole), len(results)),
        rate_of(sum(r.ended == r.target for r in whole), len(results)),
        60.0 * float(np.mean([r.pace_m_s for r in results])),
    )


def compared_with_mujoco(prototype: Prototype, library: Library, robots: int, threads: int) -> list[Compared]:
    """Every cycle of a library over ROLLS rolls, with either turn again and again and with random ones, the same for both engines.

    On the nominal robot and on so many held-out ones, whose actuators are ideal. A roll waits for the face, then neutral follows.

    Raises:
        ParameterError: the library was bred on the held-out robots.
    """
    require_held_out(library, HELD_OUT_SEED)
    nominal = build_model(prototype)
    models = [nominal, *sample(nominal, LAW, robots, HELD_OUT_SEED)]
    ways = [(cycle, turns) for cycle in library.cycles for turns in (*TURNS, RANDOM)]
    draws = [Draw(LAW, HELD_OUT_SEED, number) for number in (robots, *range(robots))]  # the nominal robot turns as one more would
    jobs = [
        Course(robot, REFERENCE_TC, stages_of_chain(chain_of(cycle, chain_faces(turns, draw, ROLLS))))
        for cycle, turns in ways
        for robot, draw in enumerate(draws)
    ]
    ours, theirs = Batch(models, threads).run(jobs), judged([MuJoCo(model, STEP_S) for model in models], jobs, threads)
    found = []
    for number, (cycle, turns) in enumerate(ways):
        at = number * len(models)
        for words, part in (("nominal", slice(at, at + 1)), (f"{robots} at {LAW.brief}", slice(at + 1, at + len(models)))):
            found.append(Compared(cycle.name, turns, words, (went(ours[part]), went(theirs[part]))))
    return found


def compared_text(library: Library, compared: Sequence[Compared]) -> str:
    """For people."""
    head = [
        "cycle", "turns", "robots", *(f"onto the next face, {engine}" for engine in ENGINES), "points apart",
        f"{ROLLS} in a row", "and neutral there", "m/min",
    ]  # fmt: skip
    rows = []
    for c in compared:
        onto = [f"{_of(w.onto_next)} [{100 * w.onto_next.low:.1f}, {100 * w.onto_next.high:.1f}] %" for w in c.went]
        speeds = "" if c.turns == RANDOM else " / ".join(f"{w.m_per_min:.2f}" for w in c.went)
        row, there = (" / ".join(_of(getattr(w, name)) for w in c.went) for name in ("in_a_row", "stayed"))
        rows.append([c.cycle, c.turns, c.robots, *onto, f"{c.apart:+.1f}", row, there, speeds])
    return (
        f"cycles of {library.name} ({library.hash}), level ground, ideal actuators, waiting for the face; "
        f"pairs are {' / '.join(ENGINES)}:\n\n{table(head, rows, 'lll' + 'r' * 6)}\n\n"
        "Intervals (95 %) take rolls as independent; those of one robot are not."
    )


def _of(rate: Rate) -> str:
    return f"{rate.successes} of {rate.trials}"


def compared_document(compared: Sequence[Compared]) -> list[dict[str, Any]]:
    """For programs."""
    return [
        {"cycle": c.cycle, "turns": c.turns, "robots": c.robots, "points_apart": c.apart}
        | {
            engine: {
                **{name: getattr(w, name)._asdict() for name in ("onto_next", "in_a_row", "stayed")},
                "m_per_min": w.m_per_min,
            }
            for engine, w in zip(ENGINES, c.went, strict=True)
        }
        for c in compared
    ]
