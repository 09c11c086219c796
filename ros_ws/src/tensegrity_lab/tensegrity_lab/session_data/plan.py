# SPDX-License-Identifier: Apache-2.0
"""What a session tries, in which order, and how long it takes. Knows no ROS and no clock."""

import csv
import io
import math
import random
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

from sim_core.dynamics.model import Model
from sim_core.errors import SimError
from sim_core.gaits.library import Gait, Library, Primitive, gait_of
from sim_core.gaits.success_counts import load_success_counts
from sim_core.planning.face_graph import FaceGraph
from sim_core.structure.roll_classes import class_of, rolls_of
from sim_core.structure.topology import require_adjacent
from sim_core.studies.model_agreement import NamedGait, verdicts
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.csv_tables import csv_row, record_of

DIGITS = 6
"""Of odds: a table and a bag hold the same number."""
GAIT_WORDS = ("all", "proper", "improper", "reference")


class Slot(NamedTuple):
    """One gait that is to be tried once.

    Attributes:
        primitive, roll_class, source, target: which gait.
        repeat: from 1.
        proper: by a rotation.
        policy_mm: strokes of S1..S6 (mm).
        odds: predicted probability of success; NaN: nobody knows.
        predicted: feasible on the nominal model.
    """

    primitive: str
    roll_class: str
    source: str
    target: str
    repeat: int
    proper: bool
    policy_mm: tuple[int, ...]
    odds: float
    predicted: bool

    @property
    def gait(self) -> tuple[str, str, str, int]:
        """As a ledger's line names it."""
        return self.primitive, self.source, self.target, self.repeat

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.primitive} {self.source}→{self.target}"


def chosen_primitives(library: Library, words: str) -> tuple[Primitive, ...]:
    """Primitives by number (as listed in the library, from 1), range or name: "1-40", "1,3,7-9", "P5,P12", "all".

    Raises:
        SessionError: none of these; says what is valid.
    """
    count = len(library.primitives)
    chosen: dict[str, Primitive] = {}
    for word in (part.strip() for part in words.split(",")):
        first, dash, last = word.partition("-")
        if word == "all":
            found: Sequence[Primitive] = library.primitives
        elif first.isdigit() and (not dash or last.isdigit()) and 1 <= int(first) <= int(last or first) <= count:
            found = library.primitives[int(first) - 1 : int(last or first)]
        else:
            found = [primitive for primitive in library.primitives if primitive.name == word]
        if not found:
            names = ", ".join(primitive.name for primitive in library.primitives)
            raise SessionError(
                f"--primitives {words!r}: {word!r} is none of library {library.name}: valid are numbers 1 to {count}, ranges such "
                f"as 1-{count}, all, and names: {names}"
            )
        chosen |= {primitive.name: primitive for primitive in found}
    return tuple(chosen.values())


def chosen_gaits(primitives: Iterable[Primitive], words: str) -> list[Gait]:
    """Gaits of primitives: all 24 of each, the 12 proper or improper ones, the reference pair's, or pairs: "TC6-TO5,TO5-TC8".

    Raises:
        SessionError: none of these, or a pair that no chosen primitive can roll.
    """
    primitives = list(primitives)
    if words in GAIT_WORDS:
        every = [gait_of(p, source, target) for p in primitives for source, target in rolls_of(p.roll_class)]
        if words == "reference":
            return [gait for gait in every if (gait.source, gait.target) == tuple(gait.primitive.roll_class)]
        return [gait for gait in every if words == "all" or gait.proper == (words == "proper")]
    gaits: list[Gait] = []
    for word in (part.strip() for part in words.split(",")):
        source, _, target = word.partition("-")
        try:
            require_adjacent(source, target)
        except SimError as error:
            raise SessionError(
                f"--gaits {words!r}: {error}; valid are {', '.join(GAIT_WORDS)}, or pairs such as TC6-TO5,TO5-TC8"
            ) from error
        able = [p for p in primitives if p.roll_class is class_of(source)]
        if not able:
            raise SessionError(f"--gaits {words!r}: none of the chosen primitives rolls {word}: they are of the other class")
        gaits += [gait_of(p, source, target) for p in able]
    return list({gait.name: gait for gait in gaits}.values())


def planned(gaits: Sequence[Gait], library: Library, nominal: Model, repeats: int, seed: int) -> list[Slot]:
    """A plan of a library's gaits, each with what the nominal model and the library's counts predict."""
    listed = [NamedGait(gait.name, gait.source, gait.target, gait.policy) for gait in gaits]
    return make_plan(gaits, verdicts(nominal, listed), FaceGraph(library, load_success_counts(library)), repeats, seed)


def make_plan(gaits: Sequence[Gait], predicted: Sequence[bool], graph: FaceGraph, repeats: int, seed: int) -> list[Slot]:
    """Every gait `repeats` times, in an order that the seed draws.

    Args:
        gaits: what is to be tried.
        predicted: for each gait, whether the nominal model says that it is feasible.
        graph: knows how probable gaits are to work.
        repeats: trials of each gait.
        seed: of the order.
    """
    slots = []
    for gait, feasible in zip(gaits, predicted, strict=True):
        known = graph.believed is not None or "success" in gait.primitive.margins
        odds = round(graph.probability(gait), DIGITS) if known else math.nan
        facts = (gait.primitive.name, gait.primitive.roll_class.name, gait.source, gait.target)
        slots += [Slot(*facts, repeat, gait.proper, gait.policy, odds, feasible) for repeat in range(1, repeats + 1)]
    random.Random(seed).shuffle(slots)
    return slots


def due_of(plan: Iterable[Slot], done: Collection[tuple[str, str, str, int]]) -> list[Slot]:
    """Slots that still need a trial, in the plan's order."""
    return [slot for slot in plan if slot.gait not in done]


def next_due(due: Sequence[Slot], face: str) -> Slot | None:
    """The next trial from the face that the robot is on: the first in order that leads where something is due, else the first.

    So a robot that rolls as it should is seldom carried. None: nothing is due from there.
    """
    here = [slot for slot in due if slot.source == face]
    onward = Counter(slot.source for slot in due)
    return next((slot for slot in here if onward[slot.target]), here[0] if here else None)


def placing(due: Sequence[Slot]) -> str:
    """Where to put a robot that is not where anything is due: the face from which most is. Raises SessionError: nothing is due."""
    if not due:
        raise SessionError("nothing is due: the session is complete")
    return Counter(slot.source for slot in due).most_common(1)[0][0]


def way_to_due(due: Sequence[Slot], face: str, graph: FaceGraph) -> tuple[str, ...]:
    """Faces to roll over to the nearest one from which something is due, the likeliest way; empty: no gaits lead there."""
    ways = []
    for target in {slot.source: None for slot in due}:
        try:
            route = graph.route(face, target)
        except SimError:
            continue
        ways.append((len(route.choices), -route.probability, route.faces))
    return min(ways)[2] if ways else ()


def plan_text(plan: Iterable[Slot]) -> str:
    """The plan as a CSV table."""
    return "\n".join([csv_row(Slot._fields), *map(csv_row, plan), ""])


def plan_of(text: str, where: str) -> list[Slot]:
    """The plan of a table. Raises SessionError: it is none."""
    try:
        plan = [record_of(Slot, row) for row in csv.DictReader(io.StringIO(text))]
    except (SessionError, csv.Error) as error:
        raise SessionError(f"{where} is not the plan of a session: {error}") from error
    if not plan:
        raise SessionError(f"{where} is an empty plan")
    return plan
