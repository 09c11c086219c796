# SPDX-License-Identifier: Apache-2.0
"""Who judges trials and puts the robot where it is needed: an observer or inertial sensor, or a person with a keyboard.

What makes a roll a success is in `sim_core.gaits.roll_sequence`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from sim_core.planning.face_graph import FaceGraph
from sim_core.structure.topology import NEIGHBOURS
from tensegrity_lab.errors import SessionError, StackError
from tensegrity_lab.session_data.ledger_line import Outcome
from tensegrity_lab.session_data.plan import Slot, placing, way_to_due
from tensegrity_lab.terminal.keys import ENTER, Keys
from tensegrity_lab.trials.panel import LEAVE, UNDO, Panel
from tensegrity_lab.trials.robot_access import RobotAccess, Rolled

LONGEST_RUN_S = 6.0
"""Robot time that a strut runs in a roll, at most: 45 mm there and back."""
MISSES = 2
"""Rolls that may fail on the way to a face before the prototype is put there."""
UNDECIDED = "nobody said within"
"""As a roll's reason begins whose face nobody knows, see `RollSequence`."""
VOID_REASONS = {
    "1": "touched or misplaced",
    "2": "a rope or joint came off",
    "3": "link or power",
    "4": "not watched",
    "5": "other",
}


class Verdict(NamedTuple):
    """How a trial ended, why, and where the robot stands now (empty: on no face, or it must be put somewhere)."""

    outcome: Outcome
    reason: str
    face: str


def void_of(rolled: Rolled) -> str:
    """Why nothing was learnt from a roll; empty: it was a trial."""
    return "" if rolled.completed and not rolled.ended_early else rolled.reason or "the roll ended early"


def _told(lab: RobotAccess, rolled: Rolled, say: Callable[[str], None]) -> Verdict:
    """By what was told to the bridge."""
    reason = void_of(rolled)
    if reason:
        return Verdict(Outcome.VOID, reason, rolled.observed_face)
    if remark := lab.compare(rolled.observed_face):
        say(remark)
    return Verdict(Outcome.SUCCESS if rolled.success else Outcome.FAILURE, rolled.reason, rolled.observed_face)


def _rolled_there(
    lab: RobotAccess, due: Sequence[Slot], graph: FaceGraph, say: Callable[[str], None], watch: Callable[[], None]
) -> bool:
    """Roll to where something is due; whether it is there. Raises StackError."""
    wanted = {slot.source for slot in due}
    misses = 0
    while lab.face and lab.face not in wanted and misses < MISSES and not lab.trouble():
        way = way_to_due(due, lab.face, graph)
        if not way:
            break
        say(f"no trial is due from {way[0]}: rolling on to {way[1]}, which is no trial")
        lab.rest(LONGEST_RUN_S, watch)
        misses += not lab.roll(way[0], way[1], "", lambda feedback: None, watch).success
    return lab.face in wanted


class Observer:
    """By what an observer or an inertial sensor tells of a virtual prototype; places by rolling, else by putting it there."""

    def __init__(self, graph: FaceGraph, owns_prototype: bool, say: Callable[[str], None]):
        """Args: owns_prototype: the session starts it, so it can be started anew on another face: the same seed, the same robot."""
        self._graph = graph
        self._owns = owns_prototype
        self._say = say

    def arm(self, lab: RobotAccess) -> None:
        """Arm a robot that was just connected. Raises StackError."""
        lab.wait_for_rest()
        lab.arm(at_mid_stroke=True)
        lab.wait_for_rest()

    def place(self, lab: RobotAccess, due: Sequence[Slot], watch: Callable[[], None]) -> None:
        """Have the robot where something is due. Raises StackError, SessionError."""
        if not _rolled_there(lab, due, self._graph, self._say, watch):
            self._restart(lab, placing(due))

    def judge(self, lab: RobotAccess, slot: Slot, rolled: Rolled) -> Verdict:
        """How a roll ended."""
        return _told(lab, rolled, self._say)

    def recover(self, lab: RobotAccess, due: Sequence[Slot], trouble: str) -> None:
        """Make the stack fit for another trial, and the robot armed. Raises StackError, SessionError."""
        self._restart(lab, placing(due))

    def _restart(self, lab: RobotAccess, face: str) -> None:
        if not self._owns:
            raise SessionError(
                f"the virtual prototype at the port must stand on {face}: start it there (--face {face}), then this command again"
            )
        self._say(f"putting the virtual prototype on {face}: the same one, started anew")
        lab.stop()
        lab.start(face)
        self.arm(lab)


class Person:
    """Somebody who looks, lifts, and presses one key."""

    def __init__(self, keys: Keys, panel: Panel, owns_prototype: bool):
        self._keys = keys
        self._panel = panel
        self._owns = owns_prototype
        self.undo: Callable[[], None] = lambda: None
        """Revokes the last trial; set by who can."""

    def ask(self, question: str, choices: Mapping[str, str]) -> str:
        """Wait for one of the keys; u undoes the last trial meanwhile.

        Raises:
            KeyboardInterrupt: q, leave.
            EOFError: the terminal is gone.
        """
        words = [("Enter" if key == ENTER else key, meaning) for key, meaning in choices.items()]
        self._panel.show(question=question, keys=(*words, UNDO, LEAVE))
        try:
            while (key := self._keys.next()) not in choices:
                if key == "q":
                    raise KeyboardInterrupt
                if key == "u":
                    self.undo()
            return key
        finally:
            self._panel.show(question="", keys=())

    def arm(self, lab: RobotAccess) -> None:
        """Arm a robot that was just connected. Raises StackError."""
        self.ask("Lift the robot, keep hands clear, switch of the supply within reach.", {ENTER: "arm"})
        at_mid_stroke = False
        while True:
            try:
                lab.arm(at_mid_stroke)
                break
            except StackError as error:
                self._panel.show(trouble=str(error))
                key = self.ask("It was not armed.", {ENTER: "try again", "m": "I see all struts at mid stroke: arm"})
                at_mid_stroke = key == "m"
                self._panel.show(trouble="")
        self._armed(lab)

    def _armed(self, lab: RobotAccess) -> None:
        """What comes between arming and the first roll. Raises StackError."""
        if lab.watched:
            lab.wait_for_rest()

    def place(self, lab: RobotAccess, due: Sequence[Slot], watch: Callable[[], None]) -> None:
        """Have the robot where something is due. Raises StackError, SessionError."""
        face = placing(due)
        self._panel.show(source=face, target="?", primitive="", stands=lab.face)
        self.ask(f"Put the robot on {face}, then step back.", {ENTER: f"it stands on {face}"})
        if self._owns:
            lab.stop()
            lab.start(face)
            lab.arm(at_mid_stroke=True)
        else:
            lab.say_face(face)

    def judge(self, lab: RobotAccess, slot: Slot, rolled: Rolled) -> Verdict:
        """How a roll ended."""
        reason = void_of(rolled)
        if reason:
            self._panel.show(trouble=reason)
            return Verdict(Outcome.VOID, reason, self._where(lab, slot))
        return self._asked(lab, slot)

    def _asked(self, lab: RobotAccess, slot: Slot) -> Verdict:
        self._panel.show(phase="over", stands=lab.face)
        key = self.ask(
            f"Does it stand on {slot.target}, and did it after actuation?", {"y": "yes: success", "n": "no: failure", "v": "void"}
        )
        if key == "y":
            lab.say_face(slot.target)
            return Verdict(Outcome.SUCCESS, "", slot.target)
        if key == "n":
            face = self._where(lab, slot)
            short = f"seen on {face or 'no face'}, not on {slot.target}"
            return Verdict(Outcome.FAILURE, "not on the target after actuation" if face == slot.target else short, face)
        why = VOID_REASONS[self.ask("Why does it not count?", VOID_REASONS)]
        return Verdict(Outcome.VOID, why, self._where(lab, slot))

    def _where(self, lab: RobotAccess, slot: Slot) -> str:
        """Where it stands; told to the bridge."""
        near = dict.fromkeys((slot.source, *NEIGHBOURS[slot.source], *NEIGHBOURS[slot.target]))
        choices = {str(number): face for number, face in enumerate(near, start=1)} | {"0": "elsewhere"}
        key = self.ask("Where does it stand now?", choices)
        face = "" if key == "0" else choices[key]
        lab.say_face(face)
        return face

    def recover(self, lab: RobotAccess, due: Sequence[Slot], trouble: str) -> None:
        """Make the stack fit for another trial, and the robot armed. Raises StackError, SessionError."""
        self._panel.show(trouble=trouble)
        self.ask("Remove the cause; lift the robot, hands clear.", {ENTER: "reset and arm again"})
        self._panel.show(trouble="")
        if self._owns:
            lab.stop()
            lab.start(placing(due))
            lab.arm(at_mid_stroke=True)
            return
        lab.reset()
        self.arm(lab)
        self.place(lab, due, lambda: None)


class Feeler(Person):
    """An inertial sensor judges, and the robot rolls to where it is needed; a person does what these cannot."""

    def __init__(self, keys: Keys, panel: Panel, owns_prototype: bool, graph: FaceGraph):
        super().__init__(keys, panel, owns_prototype)
        self._graph = graph

    def _armed(self, lab: RobotAccess) -> None:
        """It was lifted: a person puts it down, and says where, before anything rolls. See `place`."""
        lab.lifted = True

    def place(self, lab: RobotAccess, due: Sequence[Slot], watch: Callable[[], None]) -> None:
        """Have the robot where something is due. Raises StackError, SessionError."""
        if not _rolled_there(lab, due, self._graph, self._panel.line, watch):
            super().place(lab, due, watch)

    def judge(self, lab: RobotAccess, slot: Slot, rolled: Rolled) -> Verdict:
        """How a roll ended; a person is asked where the sensor does not know."""
        if rolled.reason.startswith(UNDECIDED):
            return self._asked(lab, slot)
        if void_of(rolled) or not lab.watched:
            return super().judge(lab, slot, rolled)
        return _told(lab, rolled, self._panel.line)


Hands = Observer | Person
"""Who judges and places: the same four methods."""
