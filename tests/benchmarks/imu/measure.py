# SPDX-License-Identifier: Apache-2.0
"""Rolls of hidden robots, each with a sensor of its own, and what the watch said of them. Virtual trials, without ROS or bytes."""

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from itertools import product
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np

from sim_core.dynamics.model import Model, build_model
from sim_core.dynamics.robot import Robot
from sim_core.gaits.cycle import TURNS, chain_of, faces_of
from sim_core.gaits.library import Library, gait_of, load_library
from sim_core.structure.parameters import load_prototype
from sim_core.structure.topology import FACES, NEIGHBOURS
from tensegrity_lab.reports.markdown import table
from tests.sensed_robot import SensedRobot

LIBRARIES = ("improved", "robust", "staged", "continuous")
INCLINES_DEG = (0.0, 5.0, 10.0)
ROLLS = 6
"""Of each robot; a chain has as many."""
STOOD_S, NEAR_S, DWELLS_S = 0.5, 0.3, 0.2
"""A face that the robot stood on for so long is to be told; a word may be so early or late; a chain goes on so long after it."""


class Case(NamedTuple):
    """A robot: its gaits, its ground, its seed."""

    library: str
    incline_deg: float
    seed: int


@dataclass
class Told:
    """What came of some robots. Attributes: rolls: made. undecided: without a word at rest. wrong: words. late_s: of each face."""

    rolls: int = 0
    undecided: int = 0
    wrong: int = 0
    late_s: list[float] = field(default_factory=list)

    def add(self, other: "Told") -> None:
        """Another robot's."""
        self.rolls += other.rolls
        self.undecided += other.undecided
        self.wrong += other.wrong
        self.late_s += other.late_s


@cache
def _nominal() -> Model:
    return build_model(load_prototype())


@cache
def _shelf(name: str) -> Library:
    return load_library(name)


def told_of(case: Case) -> Told:
    """One robot's rolls: by random gaits from wherever it rests, or by chains of random turns."""
    shelf, rng = _shelf(case.library), np.random.default_rng(case.seed)
    start = str(rng.choice([face for face in FACES if not shelf.cycles or face.startswith("TC")]))
    robot = SensedRobot(_nominal(), start, case.seed, incline_deg=case.incline_deg)
    told = Told()
    while told.rolls < ROLLS and (face := robot.robot.footing().face):
        if robot.twin.footing().face != face:
            robot.twin = Robot.resting_on(_nominal(), face)  # as an observation corrects it
        heard = len(robot.words)
        if shelf.cycles and face.startswith("TC"):
            told.rolls += _chain(robot, shelf, face, rng)
        else:
            target = str(rng.choice(NEIGHBOURS[face]))
            fitting = [p for p in shelf.primitives if p.roll_class.source[:2] == face[:2]]
            robot.roll(gait_of(fitting[rng.integers(len(fitting))], face, target).policy)
            told.rolls += 1
        settled = [word.face for _, word in robot.words[heard:] if word.settled]
        told.undecided += not settled
        if robot.watch.known != (robot.robot.footing().face or ""):
            robot.watch.said(robot.robot.footing().face or "")
    told.wrong, told.late_s = words_and_faces(robot)
    return told


def _chain(robot: SensedRobot, shelf: Library, face: str, rng: np.random.Generator) -> int:
    """A chain that goes on by the watch's word; rolls made."""
    faces = faces_of(face, str(rng.choice(NEIGHBOURS[face])), tuple(TURNS[i] for i in rng.integers(0, 2, ROLLS // 2 - 1)))
    made = 0
    for roll in chain_of(shelf.cycles[int(rng.integers(len(shelf.cycles)))], faces):
        robot.drive(roll.policy, until=roll.onto)
        made += 1
        if robot.watch.known != roll.onto:
            break
        robot.wait(DWELLS_S + roll.dwell_s)
    robot.drive(None)
    robot.rest()
    return made


def words_and_faces(robot: SensedRobot) -> tuple[int, list[float]]:
    """Words that were wrong; how late each face that the robot stood on long enough was told (infinite: never)."""
    ends = [at for at, _ in robot.faces[1:]] + [np.inf]
    stays = [(face, start, end) for (start, face), end in zip(robot.faces, ends, strict=True)]
    wrong, late = 0, list[float]()
    for at, word in robot.words:
        near = {face for face, start, end in stays if start - NEAR_S <= at <= end + NEAR_S}
        wrong += bool(word.face) and word.face not in near
    for face, start, end in stays[1:]:
        if end - start > STOOD_S:
            words = [at - start for at, word in robot.words if word.face == face and start - NEAR_S <= at < end + NEAR_S]
            late.append(max(0.0, min(words)) if words else np.inf)
    return wrong, late


def measured(rolls: int, processes: int, seed: int, say: Callable[[str], None]) -> dict[tuple[str, float], Told]:
    """About so many rolls, evenly over libraries and inclines."""
    kinds = list(product(LIBRARIES, INCLINES_DEG))
    robots = max(1, round(rolls / ROLLS / len(kinds)))
    cases = [Case(library, incline, seed + number) for number in range(robots) for library, incline in kinds]
    found = {kind: Told() for kind in kinds}
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        for number, (case, told) in enumerate(zip(cases, pool.map(told_of, cases, chunksize=8), strict=True), 1):
            found[case[:2]].add(told)
            if number % 600 == 0:
                say(f"{number} of {len(cases)} robots")
    return found


def text_of(found: dict[tuple[str, float], Told]) -> str:
    """A table: a line for each library and incline, and one for all."""
    total = Told()
    for told in found.values():
        total.add(told)
    named = {f"{library}, {incline:g}°": told for (library, incline), told in found.items()}
    rows = [[name, *_figures(told)] for name, told in {**named, "all": total}.items()]
    return table(["rolls by", "rolls", "wrong words", "undecided", "told after", "told within 0.3 s"], rows)


def _figures(told: Told) -> list[str]:
    late = np.array(told.late_s or [np.nan])
    counts = [f"{told.rolls}", f"{told.wrong}", f"{told.undecided}"]
    return [*counts, f"{np.median(late):.2f} s", f"{100.0 * (late <= NEAR_S).mean():.1f} % of {len(told.late_s)}"]


def document_of(found: dict[tuple[str, float], Told]) -> list[dict[str, object]]:
    """The same for scripts."""
    return [
        {"library": library, "incline_deg": incline, "rolls": told.rolls, "wrong": told.wrong, "undecided": told.undecided}
        | {"told": len(told.late_s), "told_in_time": sum(late <= NEAR_S for late in told.late_s)}
        for (library, incline), told in found.items()
    ]
