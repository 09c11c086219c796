# SPDX-License-Identifier: Apache-2.0
"""Cycles: two policies that roll on without stopping, one from a TC onto a TO, one from there onto the next TC.

A cycle is given for the reference course TC6 → TO5 → TC3. Arrived on TC3 the robot may turn to either of the two other TOs: the
element of the group that carries (TC6, TO5) to (TC3, that TO) relabels both policies, and so on, TC after TC. A turn is named by
the TO that it leads to on the reference course. The same turn again and again goes straight on: its element has order six, and six
TCs later the robot stands on the first face again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from sim_core.errors import LibraryError, PolicyError, RollRefused, brief
from sim_core.structure.policy import Policy, checked_policy
from sim_core.structure.symmetry import CARRIERS, REFERENCE_TC, REFERENCE_TO, Element
from sim_core.structure.topology import NEIGHBOURS, require_adjacent

NEXT_TC = next(face for face in NEIGHBOURS[REFERENCE_TO] if face != REFERENCE_TC)
"""Where the reference course leads."""
TURNS = tuple(face for face in NEIGHBOURS[NEXT_TC] if face != REFERENCE_TO)
"""The two TOs to which it may go on."""
SPEED = "m_per_min_"
"""Before a turn in the names of a cycle's margins: how fast it goes straight on by that turn."""
STRETCH, TWIST = "stretch", "twist_deg"
"""Margins, of the nominal robot straight on: how far its rolls go over rolls from rest to rest, and by how much the first one, of
the reference course, turns the robot more."""
LONGEST_S = 60.0
"""Of a stage's times: more is a mistake."""


@dataclass(frozen=True)
class CycleStage:
    """One half of a cycle.

    Attributes:
        policy: of the reference course; six strokes, whole mm, S1..S6, + lengthens.
        dwell_s: it goes on so long after the next face was seen.
        time_s: where nobody looks: how long it takes, so seen.
    """

    policy: Policy
    dwell_s: float
    time_s: float


class Switches(NamedTuple):
    """How a turn went on perturbed robots: rolls that went on as they should, and returns to neutral that stayed, in as many.

    Attributes:
        rolls: rolls made on the way of this turn.
        onto_next: how many of them came onto the next face.
        leaves: courses that ended in neutral on a TC.
        stayed: how many of them stayed on it.
    """

    rolls: int
    onto_next: int
    leaves: int
    stayed: int

    @property
    def miss(self) -> float:
        """Share of rolls that went elsewhere."""
        return 1.0 - self.onto_next / self.rolls if self.rolls else 1.0


@dataclass(frozen=True)
class Cycle:
    """Two stages that repeat under the group.

    Attributes:
        name: unique in its library, e.g. "C1".
        stages: from a TC, and from a TO.
        turns: by name: how it went.
        margins: figures of its trials, by name.
    """

    name: str
    stages: tuple[CycleStage, CycleStage]
    turns: Mapping[str, Switches] = field(default_factory=dict)
    margins: Mapping[str, float] = field(default_factory=dict)


class ChainRoll(NamedTuple):
    """One roll of a chain: what to drive to, onto which face, and when to go on, as `CycleStage`."""

    policy: Policy
    onto: str
    dwell_s: float
    time_s: float


@dataclass(frozen=True)
class Chain:
    """A cycle over certain faces, the first of which the robot stands on."""

    cycle: Cycle
    faces: tuple[str, ...]

    @property
    def source(self) -> str:
        """Where it begins."""
        return self.faces[0]

    @property
    def target(self) -> str:
        """Where it ends."""
        return self.faces[-1]

    @property
    def name(self) -> str:
        """Cycle and faces, for people."""
        return f"{self.cycle.name} {'→'.join(self.faces)}"

    @property
    def rolls(self) -> tuple[ChainRoll, ...]:
        """See `chain_of`."""
        return chain_of(self.cycle, self.faces)

    def runs_s(self, speed_m_s: float) -> float:
        """For how long each strut may have to run (s) in two rolls, wherever in the chain, and on the way back to neutral.

        As if it never paused: struts that are held under load run, too.
        """
        rolls = self.rolls
        two_s = max(sum(roll.time_s for roll in rolls[first : first + 2]) for first in range(len(rolls)))
        return two_s + 1e-3 * max(max(map(abs, roll.policy)) for roll in rolls) / speed_m_s


def turned(element: Element, turn: str) -> Element:
    """The element of the next two rolls, when `element` carries the reference course to the last two."""
    following = CARRIERS[NEXT_TC, turn]
    return CARRIERS[element.face(following.face(REFERENCE_TC)), element.face(following.face(REFERENCE_TO))]


def faces_of(source: str, first: str, turns: Sequence[str]) -> tuple[str, ...]:
    """The faces of a chain that begins on the TC `source` towards the TO `first`, and takes these turns; `source` is the first."""
    element = _element(source, first)
    faces = [source, first, element.face(NEXT_TC)]
    for turn in turns:
        element = turned(element, turn)
        faces += [element.face(REFERENCE_TO), element.face(NEXT_TC)]
    return tuple(faces)


def turns_of(faces: Sequence[str]) -> tuple[str, ...]:
    """The turns of a chain over these faces, from TC to TC. Raises RollRefused: no cycle goes there."""
    turns = []
    for at in range(0, len(faces) - 4, 2):
        element = _element(faces[at], faces[at + 1])
        turn = next((turn for turn in TURNS if turned(element, turn).face(REFERENCE_TO) == faces[at + 3]), None)
        if turn is None:
            raise RollRefused(f"a cycle does not go from {faces[at + 1]} over {faces[at + 2]} to {faces[at + 3]}")
        turns.append(turn)
    return tuple(turns)


def chain_of(cycle: Cycle, faces: Sequence[str]) -> tuple[ChainRoll, ...]:
    """The rolls of a cycle over these faces, the first of which the robot stands on.

    Raises:
        UnknownFaceError, NotAdjacentError; RollRefused: it is no way from a TC over a TO to another TC, and so on.
    """
    if len(faces) < 3 or len(faces) % 2 == 0 or not faces[0].startswith("TC"):
        raise RollRefused(f"a cycle goes from TC to TC over TOs: an odd number of faces from 3 on; got {', '.join(faces)}")
    rolls = []
    for at in range(0, len(faces) - 1, 2):
        element = _element(faces[at], faces[at + 1])
        require_adjacent(faces[at + 1], faces[at + 2])
        if faces[at + 2] != element.face(NEXT_TC):
            raise RollRefused(
                f"from {faces[at]} over {faces[at + 1]} a cycle goes to {element.face(NEXT_TC)}, not to {faces[at + 2]}"
            )
        for stage, onto in zip(cycle.stages, faces[at + 1 : at + 3], strict=True):
            policy = checked_policy(element.relabel(stage.policy), 10_000)
            rolls.append(ChainRoll(policy, onto, stage.dwell_s, stage.time_s))
    turns_of(faces)
    return tuple(rolls)


def _element(source: str, target: str) -> Element:
    require_adjacent(source, target)
    if not source.startswith("TC"):
        raise RollRefused(f"a cycle begins on a TC, not on {source}")
    return CARRIERS[source, target]


def stage_numbers(stage: CycleStage) -> tuple[Any, ...]:
    """What a stage does: its policy and its times, in whole ms."""
    return *stage.policy, round(1e3 * stage.dwell_s), round(1e3 * stage.time_s)


def parse_cycles(rows: Any, where: str) -> tuple[Cycle, ...]:
    """The cycles of a library's parsed YAML. Raises LibraryError."""
    if not isinstance(rows, list):
        raise LibraryError(f"{where}: cycles is {brief(rows)}; valid is a list")
    cycles: list[Cycle] = []
    for number, row in enumerate(rows, start=1):
        try:
            one, other = (
                CycleStage(checked_policy(stage["policy_mm"], 10_000), _seconds(stage["dwell_s"]), _seconds(stage["time_s"]))
                for stage in row["stages"]
            )
            turns = {str(turn): Switches(*(int(counts[key]) for key in Switches._fields)) for turn, counts in row["turns"].items()}
            margins = {str(key): float(value) for key, value in dict(row.get("margins") or {}).items()}
            cycle = Cycle(str(row["name"]), (one, other), turns, margins)
            if set(turns) - set(TURNS) or any(min(counts) < 0 for counts in turns.values()):
                raise ValueError("turns")
        except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
            raise LibraryError(
                f"{where}: cycle {number} is {brief(row)}; valid is {{name, stages: [two of {{policy_mm, dwell_s, time_s}}], "
                f"turns: {{{' or '.join(TURNS)}: {{{', '.join(Switches._fields)}}}}}}}"
            ) from error
        except PolicyError as error:
            raise LibraryError(f"{where}: cycle {number}: {error}") from error
        if cycle.name in {before.name for before in cycles}:
            raise LibraryError(f"{where}: two cycles are called {cycle.name!r}; names must differ")
        cycles.append(cycle)
    return tuple(cycles)


def _seconds(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= LONGEST_S:
        raise ValueError(f"{value} is no time")
    return float(value)


def cycles_text(cycles: Sequence[Cycle]) -> str:
    """The YAML of cycles."""
    lines = ["cycles:"]
    for cycle in cycles:
        lines += [f"- name: {cycle.name}", "  stages:"]
        for stage in cycle.stages:
            policy = ", ".join(map(str, stage.policy))
            lines.append(f"  - {{policy_mm: [{policy}], dwell_s: {stage.dwell_s:g}, time_s: {stage.time_s:g}}}")
        lines.append("  turns:")
        for turn, switches in cycle.turns.items():
            counts = ", ".join(f"{key}: {value}" for key, value in switches._asdict().items())
            lines.append(f"    {turn}: {{{counts}}}")
        lines.append(f"  margins: {{{', '.join(f'{key}: {value:g}' for key, value in cycle.margins.items())}}}")
    return "\n".join(lines)


def cycle_line(cycle: Cycle) -> str:
    """A cycle in one line, for people."""
    stages = " then ".join(f"{' '.join(f'{v:+d}' for v in stage.policy)} mm" for stage in cycle.stages)
    turns = "; ".join(f"{turn} {s.onto_next} of {s.rolls} rolls" for turn, s in cycle.turns.items())
    return f"{cycle.name} {stages}: {', '.join(f'{key} {value:g}' for key, value in cycle.margins.items())}; straight on by {turns}"
