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
from sim_core.gaits.cycle import TURNS, Chain, Cycle, faces_of, turns_of
from sim_core.gaits.library import Gait, Library, Primitive, gait_of, wanted_chain
from sim_core.gaits.success_counts import load_success_counts
from sim_core.planning.face_graph import FaceGraph
from sim_core.rolling.batch import Batch
from sim_core.rolling.course import Course, stages_of_chain
from sim_core.structure.roll_classes import CLASSES, TC_TO, class_of, rolls_of
from sim_core.structure.symmetry import CARRIERS
from sim_core.structure.topology import require_adjacent
from sim_core.studies.model_agreement import NamedGait, verdicts
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.csv_tables import csv_row, record_of
from tensegrity_lab.session_data.ledger_line import Line, gait_name

DIGITS = 6
"""Of odds: a table and a bag hold the same number."""
GAIT_WORDS = ("all", "proper", "improper", "reference")
STRAIGHT_TURNS, MOST_ROLLS = 5, 24
"""Turns of the chains that these words name: twelve rolls, after which a straight one stands on its first face again. And the most
rolls that the planner makes without a stop."""


class Slot(NamedTuple):
    """One gait or chain that is to be tried once.

    Attributes:
        primitive, roll_class, source, target: which gait; of a chain see `Line`.
        repeat: from 1.
        proper: by a rotation.
        policy_mm: strokes of S1..S6 (mm).
        odds: predicted probability of success; NaN: nobody knows.
        predicted: feasible on the nominal model.
        chain: its faces, such as TC6-TO5-TC3; empty: it is one roll.
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
    chain: str = ""

    @property
    def gait(self) -> tuple[str, str, str, int]:
        """As a ledger's line names it."""
        return self.primitive, self.source, self.chain or self.target, self.repeat

    @property
    def name(self) -> str:
        """For people."""
        return gait_name(self.primitive, self.source, self.target, self.chain)


def chosen_primitives(library: Library, words: str) -> tuple[Primitive | Cycle, ...]:
    """Primitives by number (as listed in the library, from 1), range or name: "1-40", "1,3,7-9", "P5,P12", "all"; cycles by name.

    Raises:
        SessionError: none of these; says what is valid.
    """
    count, every = len(library.primitives), list[Primitive | Cycle]([*library.primitives, *library.cycles])
    chosen: dict[str, Primitive | Cycle] = {}
    for word in (part.strip() for part in words.split(",")):
        first, dash, last = word.partition("-")
        if word == "all":
            found: Sequence[Primitive | Cycle] = library.primitives
        elif word == "cycles":
            found = library.cycles
        elif first.isdigit() and (not dash or last.isdigit()) and 1 <= int(first) <= int(last or first) <= count:
            found = library.primitives[int(first) - 1 : int(last or first)]
        else:
            found = [one for one in every if one.name == word][:1]
        if not found:
            names = ", ".join(one.name for one in every)
            names += "; cycles: all its cycles" if library.cycles else ""
            raise SessionError(
                f"--primitives {words!r}: {word!r} is none of library {library.name}: valid are numbers 1 to {count}, ranges such "
                f"as 1-{count}, all, and names: {names}"
            )
        chosen |= {primitive.name: primitive for primitive in found}
    return tuple(chosen.values())


def chosen_gaits(chosen: Iterable[Primitive | Cycle], words: str) -> list[Gait | Chain]:
    """Gaits of primitives: all 24 of each, the 12 proper or improper ones, the reference pair's, or pairs: "TC6-TO5,TO5-TC8".

    Of a cycle chains: twelve rolls straight on by either turn, which begin with all 24 (or so) pairs, or "TC6-TO5-TC3,...".

    Raises:
        SessionError: none of these, or a pair or chain that nothing chosen can roll.
    """
    chosen = list(chosen)
    primitives, cycles = [c for c in chosen if isinstance(c, Primitive)], [c for c in chosen if isinstance(c, Cycle)]
    if words in GAIT_WORDS:
        every: list[Gait | Chain] = [gait_of(p, *pair) for p in primitives for pair in rolls_of(p.roll_class)]
        every += [
            Chain(cycle, faces_of(*pair, [turn] * STRAIGHT_TURNS)) for cycle in cycles for pair in rolls_of(TC_TO) for turn in TURNS
        ]
        if words == "reference":
            return [gait for gait in every if _first_roll(gait) in map(tuple, CLASSES.values())]
        return [gait for gait in every if words == "all" or _is_proper(gait) == (words == "proper")]
    gaits: list[Gait | Chain] = []
    for word in (part.strip() for part in words.split(",")):
        if word.count("-") > 1 or not primitives:
            gaits += _chains(cycles, word, words)
            continue
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


def _chains(cycles: Sequence[Cycle], word: str, words: str) -> list[Gait | Chain]:
    """The chain that a word names, by each cycle. Raises SessionError: no cycle goes there."""
    chains = [Chain(cycle, tuple(word.split("-"))) for cycle in cycles]
    try:
        if not chains:
            raise SessionError(f"{word} is a chain and no cycle is chosen: say --primitives cycles, or the name of one")
        if len(chains[0].rolls) > MOST_ROLLS:
            raise SessionError(f"{word} has {len(chains[0].rolls)} rolls; valid are 2 to {MOST_ROLLS}")
    except (SimError, SessionError) as error:
        raise SessionError(
            f"--gaits {words!r}: {error}; valid for cycles are {', '.join(GAIT_WORDS)}, or chains such as TC6-TO5-TC3"
        ) from error
    return [*chains]


def _first_roll(gait: Gait | Chain) -> tuple[str, str]:
    return (gait.source, gait.faces[1] if isinstance(gait, Chain) else gait.target)


def _is_proper(gait: Gait | Chain) -> bool:
    return CARRIERS[_first_roll(gait)].proper if isinstance(gait, Chain) else gait.proper


def chain_in(library: Library, gait: Slot | Line) -> Chain:
    """The chain of a slot or line. Raises SimError: the library does not have it."""
    source, *faces = gait.chain.split("-")
    return wanted_chain(library, source, faces, gait.primitive)


def planned(gaits: Sequence[Gait | Chain], library: Library, nominal: Model, repeats: int, seed: int) -> list[Slot]:
    """A plan of a library's gaits and chains, each with what the nominal model and the library's counts predict."""
    rolls, chains = [g for g in gaits if isinstance(g, Gait)], [g for g in gaits if isinstance(g, Chain)]
    predicted = verdicts(nominal, [NamedGait(gait.name, gait.source, gait.target, gait.policy) for gait in rolls]) if rolls else []
    if chains:
        courses = [Course(0, chain.source, stages_of_chain(chain.rolls)) for chain in chains]
        predicted += [result.feasible for result in Batch([nominal]).run(courses)]
    return make_plan([*rolls, *chains], predicted, FaceGraph(library, load_success_counts(library)), repeats, seed)


def make_plan(gaits: Sequence[Gait | Chain], predicted: Sequence[bool], graph: FaceGraph, repeats: int, seed: int) -> list[Slot]:
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
        if isinstance(gait, Chain):
            first = Slot(
                gait.cycle.name,
                TC_TO.name,
                gait.source,
                gait.target,
                1,
                _is_proper(gait),
                gait.rolls[0].policy,
                round(odds_of(gait), DIGITS),
                feasible,
                "-".join(gait.faces),
            )
        else:
            known = graph.believed is not None or "success" in gait.primitive.margins
            odds = round(graph.probability(gait), DIGITS) if known else math.nan
            facts = (gait.primitive.name, gait.primitive.roll_class.name, gait.source, gait.target)
            first = Slot(*facts, 1, gait.proper, gait.policy, odds, feasible)
        slots += [first._replace(repeat=repeat) for repeat in range(1, repeats + 1)]
    random.Random(seed).shuffle(slots)
    return slots


def odds_of(chain: Chain) -> float:
    """How likely a chain is made and stays, by its turns' switches; NaN: nobody counted one of them."""
    counted = {turn: switches for turn, switches in chain.cycle.turns.items() if switches.rolls and switches.leaves}
    turns = turns_of(chain.faces)
    if not counted or set(turns) - set(counted):
        return math.nan
    first = min(counted.values(), key=lambda switches: switches.miss)  # from rest it has not turned yet: as the surer turn
    taken = [first, *(counted[turn] for turn in turns)]
    return math.prod((1.0 - switches.miss) ** 2 for switches in taken) * taken[-1].stayed / taken[-1].leaves


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
    """The plan as a CSV table; one without chains as it ever was, with the same hash."""
    plan = list(plan)
    columns = slice(None if any(slot.chain for slot in plan) else Slot._fields.index("chain"))
    return "\n".join([csv_row(row[columns]) for row in [tuple(Slot._fields), *map(tuple, plan)]] + [""])


def plan_of(text: str, where: str) -> list[Slot]:
    """The plan of a table. Raises SessionError: it is none."""
    try:
        plan = [record_of(Slot, row) for row in csv.DictReader(io.StringIO(text))]
    except (SessionError, csv.Error) as error:
        raise SessionError(f"{where} is not the plan of a session: {error}") from error
    if not plan:
        raise SessionError(f"{where} is an empty plan")
    return plan
