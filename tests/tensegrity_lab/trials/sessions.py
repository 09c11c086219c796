# SPDX-License-Identifier: Apache-2.0
"""Sessions as files, made without any robot."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from sim_core.gaits.library import Library, load_library
from sim_core.gaits.success_counts import load_success_counts
from sim_core.planning.face_graph import FaceGraph
from tensegrity_lab.session_data.folder import SessionFolder, Settings, begin_session
from tensegrity_lab.session_data.ledger import Ledger
from tensegrity_lab.session_data.ledger_line import Event, Line, Outcome
from tensegrity_lab.session_data.plan import Slot, chosen_gaits, chosen_primitives, make_plan

WHEN = "2026-01-02T03:04:05.678901Z"


def planned(primitives: str = "1-2", gaits: str = "all", repeats: int = 1, seed: int = 1) -> list[Slot]:
    """A plan of the library `robust`."""
    chosen = chosen_gaits(chosen_primitives(graph().library, primitives), gaits)
    return make_plan(chosen, [True] * len(chosen), graph(), repeats, seed)


@cache
def graph() -> FaceGraph:
    """Of the library `robust`, with its odds."""
    library = load_library()
    return FaceGraph(library, load_success_counts(library))


def begun(path: Path, plan: list[Slot], robot: str = "virtual one", virtual: bool = True) -> SessionFolder:
    """A session's folder."""
    library = cyclic() if any(slot.chain for slot in plan) else graph().library
    facts = {"primitives": "x", "gaits": "x", "repeats": 1, "order_seed": 1}
    settings = Settings(path.name, WHEN, library.name, library.hash, robot=robot, virtual_robot=virtual, **facts)
    return begin_session(path, settings, plan, library)


def with_chains(gaits: str = "reference", repeats: int = 1) -> list[Slot]:
    """A plan of the first cycle of the library `continuous`."""
    chosen = chosen_gaits(chosen_primitives(cyclic(), "C1"), gaits)
    return make_plan(chosen, [True] * len(chosen), FaceGraph(cyclic()), repeats, 1)


@cache
def cyclic() -> Library:
    """The library `continuous`, which has cycles."""
    return load_library("continuous")


def line_of(slot: Slot, number: int, event: Event = Event.BEGIN, robot: str = "virtual one", virtual: bool = True) -> Line:
    """A line of a ledger."""
    library = cyclic() if slot.chain else graph().library
    who = ("a session", "somebody", robot, virtual, library.name, library.hash)
    return Line(event, number, WHEN, *who, **slot._asdict(), began=WHEN, bag="a.mcap", bag_offset_s=1.5)


def try_all(folder: SessionFolder, outcomes: dict[int, Outcome]) -> Ledger:
    """A ledger in which slot number i of the plan ended as `outcomes` says; each i in order."""
    ledger = Ledger(folder.path)
    for index, outcome in outcomes.items():
        add(ledger, folder.plan[index], outcome, folder.settings.robot, folder.settings.virtual_robot)
    return ledger


def add(
    ledger: Ledger, slot: Slot, outcome: Outcome, robot: str = "virtual one", virtual: bool = True, rolls: int | None = None
) -> Line:
    """One whole trial; its line. `rolls`: that a chain made; default: all if it succeeded."""
    line = line_of(slot, ledger.standing().last_number + 1, robot=robot, virtual=virtual)
    ledger.append(line)
    face = slot.target if outcome is Outcome.SUCCESS else slot.source
    rolls = line.wanted * (outcome is Outcome.SUCCESS) if rolls is None else rolls
    faces = tuple(slot.chain.split("-")[: rolls + 1]) if slot.chain else (slot.source, face)
    line = replace(line, event=Event.TRIAL, outcome=outcome, observed_face=face, faces=faces, rolls=rolls)
    ledger.append(line)
    return line
