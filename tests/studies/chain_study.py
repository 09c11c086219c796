# SPDX-License-Identifier: Apache-2.0
"""The chain study: cycles rolled on, twelve rolls in a row, on perturbed prototypes nobody trained on, and stop-and-go beside."""

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_core.dynamics.actuators import IDEAL, ActuatorParameters
from sim_core.gaits.cycle import TURNS, chain_of, faces_of
from sim_core.gaits.library import Library
from sim_core.rolling.course import Course, Stage, stages_of_chain, stages_of_rolls
from sim_core.structure.parameters import Prototype
from sim_core.structure.symmetry import REFERENCE_TC, REFERENCE_TO
from sim_core.studies.binomial_intervals import Rate, rate_of
from sim_core.studies.local_runner import Chunk, Draw, Reporter, Runner, Trials, jobs_in, joined, part_of, run_here, silent
from sim_core.uncertainty.perturbation_law import Law

ROLLS = 12
"""In a row: straight on, the robot then stands on its first face again."""
LONG, LONG_PROTOTYPES = 36, 48
"""Rolls of the chains that tell the way in ten minutes, about as many as duty permits; and on how many prototypes."""
RANDOM = "random"
BLIND, BLIND_ROLLS = "blind", 6
"""Straight on by the first turn where nobody looks: by the stages' own times; the planner permits no more rolls."""
STOP_AND_GO = "stop and go"
CHUNK_JOBS = 256
DUTY, WINDOW_S = 0.2, 600.0
"""What the actuators' makers permit, as the bridge counts it."""


class Chains(NamedTuple):
    """One way of rolling on all prototypes.

    Attributes:
        cycle: name; STOP_AND_GO: the library's primitives instead, as long as the first cycle's straight chain.
        turns: one of TURNS: straight on; RANDOM: each prototype its own; BLIND: see there.
        actuators: name.
        rolls: that came onto the next face, of those begun.
        whole: chains without a miss, that ended in neutral and kept clearance and force.
        m_per_min: straight way / time from the first landing to the last, mean of the prototypes; NaN for random turns.
        m_per_10min: way that the actuators' duty permits, by chains of LONG rolls from neutral to neutral.
        clearance_m: least of all.
        misses: reasons, the most frequent first.
    """

    cycle: str
    turns: str
    actuators: str
    rolls: Rate
    whole: Rate
    m_per_min: float
    m_per_10min: float
    clearance_m: float
    misses: tuple[tuple[str, int], ...]


class _Way(NamedTuple):
    cycle: str
    turns: str
    actuators: str


def chain_study(
    prototype: Prototype,
    library: Library,
    law: Law,
    seed: int,
    prototypes: int,
    actuators: Sequence[tuple[str, ActuatorParameters | None]] = ((IDEAL, None),),
    runner: Runner = run_here,
    report: Reporter = silent,
) -> tuple[Chains, ...]:
    """Roll every cycle on, straight with either turn and with random turns, and once stop and go, with all these actuators."""
    draws = tuple(Draw(law, seed, number) for number in range(prototypes))
    work: dict[_Way, list[Chunk]] = {}
    for name, parameters in actuators:
        for cycle in library.cycles:
            for turns in (*TURNS, RANDOM, BLIND):
                ways = [(draw, chain_faces(turns, draw, BLIND_ROLLS if turns == BLIND else ROLLS)) for draw in draws]
                if turns in TURNS:
                    ways += [(draw, chain_faces(turns, draw, LONG)) for draw in draws[:LONG_PROTOTYPES]]
                courses = [(draw, stages_of_chain(chain_of(cycle, faces), observed=turns != BLIND)) for draw, faces in ways]
                work[_Way(cycle.name, turns, name)] = _chunks(prototype, courses, parameters)
        if library.cycles:
            faces = chain_faces(TURNS[0], draws[0], ROLLS)
            policies = [library.gaits(*pair)[0].policy for pair in pairwise(faces)]
            stages = stages_of_rolls(policies, faces[1:], prototype.actuator_speed_m_s)
            work[_Way(STOP_AND_GO, TURNS[0], name)] = _chunks(prototype, [(draw, stages) for draw in draws], parameters)
    total, before, found = sum(jobs_in(chunks) for chunks in work.values()), 0, []
    for way, chunks in work.items():
        found.append(_chains(way, joined(runner(chunks, part_of(report, before, total))), prototypes))
        before += jobs_in(chunks)
    return tuple(found)


def chain_faces(turns: str, draw: Draw, rolls: int) -> tuple[str, ...]:
    """The faces of a chain of so many rolls, one of TURNS again and again, the first for BLIND, or RANDOM: this prototype's own."""
    count = rolls // 2 - 1
    chosen = [turns if turns in TURNS else TURNS[0]] * count
    if turns == RANDOM:
        chosen = [TURNS[n] for n in np.random.default_rng([draw.seed, draw.number, 2]).integers(2, size=count)]
    return faces_of(REFERENCE_TC, REFERENCE_TO, chosen)


def _chunks(
    prototype: Prototype, courses: Sequence[tuple[Draw, tuple[Stage, ...]]], actuators: ActuatorParameters | None
) -> list[Chunk]:
    chunks = []
    for at in range(0, len(courses), CHUNK_JOBS):
        part = courses[at : at + CHUNK_JOBS]
        jobs = tuple(Course(number, REFERENCE_TC, stages) for number, (_, stages) in enumerate(part))
        chunks.append(Chunk(prototype, tuple(draw for draw, _ in part), jobs, actuators=actuators))
    return chunks


def _chains(way: _Way, trials: Trials, prototypes: int) -> Chains:
    """`trials`: of chains of ROLLS on all prototypes, then of those that tell the way in ten minutes, if there are any."""
    reached, wanted = trials.reached[:prototypes].astype(int), BLIND_ROLLS if way.turns == BLIND else ROLLS
    why = Counter(reason for reason in trials.reason[:prototypes] if reason)
    whole: NDArray[np.bool_] = (trials.reached >= ROLLS) & (way.turns in TURNS)
    long = whole.copy()
    if len(long) > prototypes:
        long[:prototypes] = False
    whole[prototypes:] = False
    way_m = trials.pace_m_s * trials.between_s
    return Chains(
        *way,
        rate_of(int(reached.sum()), int(np.minimum(reached + 1, wanted).sum())),
        rate_of(int(trials.feasible[:prototypes].sum()), prototypes),
        60.0 * _mean(trials.pace_m_s[whole]),
        _mean(np.minimum(DUTY * WINDOW_S * way_m / trials.driven_s, WINDOW_S * trials.pace_m_s)[long]),
        float(trials.clearance_m.min()),
        tuple(why.most_common()),
    )


def _mean(values: NDArray[np.float32]) -> float:
    return float(values.astype(float).mean()) if len(values) else float("nan")
