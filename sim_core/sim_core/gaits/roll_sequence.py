# SPDX-License-Identifier: Apache-2.0
"""The phases of one roll as a small state machine. Knows no ROS and no clock: told what is known, it answers what to do next.

    (go to neutral, settle,) actuate, settle, return to neutral, settle, have the face confirmed

or of a chain of rolls without a stop between:

    (go to neutral, settle,) roll on from face to face, return to neutral, settle, have the face confirmed

Times are robot time. Whatever face the robot lands on, it is brought back to neutral lengths before the roll is reported. In
a chain the next motion overtakes the one before as soon as the robot stands on the next face, seen, or predicted where a prediction
is enough; blind, after the roll's own time.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

from sim_core.errors import RollRefused

NEUTRAL_TOLERANCE_M = 0.0015
"""Struts farther than this from neutral are brought there before a gait begins."""

Lengths = tuple[float, ...]


class Phase(StrEnum):
    """What is going on, as the feedback says it."""

    TO_NEUTRAL = "going to neutral lengths"
    TO_NEUTRAL_SETTLE = "settling at neutral lengths"
    ACTUATE = "actuating"
    ROLL_ON = "rolling on"
    ACTUATE_SETTLE = "settling after actuation"
    RETURN = "returning to neutral lengths"
    RETURN_SETTLE = "settling after the return"
    CONFIRM = "waiting for somebody to say the face (set_face)"


_SETTLE_AFTER = {
    Phase.TO_NEUTRAL: Phase.TO_NEUTRAL_SETTLE,
    Phase.ACTUATE: Phase.ACTUATE_SETTLE,
    Phase.RETURN: Phase.RETURN_SETTLE,
}


@dataclass(frozen=True)
class Seen:
    """A face: None = on no face; whether the robot rested on it; when; who says so."""

    face: str | None
    settled: bool
    robot_time_ns: int
    source: str


@dataclass(frozen=True)
class View:
    """What is known now.

    Attributes:
        robot_time_ns: newest robot time heard of.
        lengths_m: rest lengths last sent.
        predicted: the twin's face; None if there is no twin. Its `settled` says that the twin is at rest.
        observed: the newest observation; None if nobody ever looked.
        observer: somebody looks all the time (the virtual prototype's observer, a camera), so an observation will come.
    """

    robot_time_ns: int
    lengths_m: Lengths
    predicted: Seen | None
    observed: Seen | None
    observer: bool


@dataclass(frozen=True)
class Link:
    """One roll of a chain.

    Attributes:
        lengths_m: to drive to.
        onto: the face that it leads onto.
        dwell_s: the chain goes on so long after that face was seen.
        time_s: blind, so long after the roll's beginning.
    """

    lengths_m: Lengths
    onto: str
    dwell_s: float
    time_s: float


@dataclass(frozen=True)
class RollPlan:
    """One gait: `source` to `target` by driving to `lengths_m` and back; or a chain of them, by its links and back.

    Attributes:
        source, target: the first face and the last.
        lengths_m: of one gait.
        via: lengths that it drives to before, without a stop.
        links: of a chain; none: it is one gait.
        blind: nobody looks: every link has its own time.
    """

    source: str
    target: str
    lengths_m: Lengths
    via: tuple[Lengths, ...] = ()
    links: tuple[Link, ...] = ()
    blind: bool = False


@dataclass(frozen=True)
class RollRules:
    """How a roll is judged.

    Attributes:
        neutral_m: neutral lengths.
        observe: the outcome needs an observation; else the twin's prediction is enough.
        settle_timeout_s: longest wait for rest, and for an observer's word of it, after a motion.
        confirm_timeout_s: longest wait for a person's word where no observer looks.
        link_timeout_s: longest wait for the next face of a chain, from the beginning of a link.
    """

    neutral_m: Lengths
    observe: bool
    settle_timeout_s: float
    confirm_timeout_s: float
    link_timeout_s: float = 12.0


@dataclass(frozen=True)
class Move:
    """Do this next: drive to `lengths_m`, then call `moved`.

    Attributes:
        overtakes: in the place of the motion that may be running still.
        via: lengths to drive to before, without a stop.
    """

    phase: Phase
    lengths_m: Lengths
    overtakes: bool = False
    via: tuple[Lengths, ...] = ()


@dataclass(frozen=True)
class RollOutcome:
    """The roll is over.

    Attributes:
        completed: all motions were made and the robot was judged.
        rolls: how many faces on it came.
        ended_early: of a chain: it was ended in neutral before its last face, though no roll had missed.
    """

    success: bool
    reason: str
    predicted_face: str
    observed_face: str
    faces: tuple[str, ...]
    duration_s: float
    completed: bool = True
    rolls: int = 0
    ended_early: bool = False


@dataclass
class RollSequence:
    """One roll, or a chain of them.

    Args:
        rules: how it is judged.
        plan_from: makes the plan when the face to start from is known; raises RollRefused.
    """

    rules: RollRules
    plan_from: Callable[[str], RollPlan]
    phase: Phase = Phase.ACTUATE
    plan: RollPlan | None = None
    _faces: list[str] = field(default_factory=list)
    _failure: str = ""
    _began_ns: int | None = None
    _moved_ns: int = 0
    _link: int = -1
    _link_ns: int = 0
    _landed_ns: int | None = None
    _ends_early: str = ""
    _ended_early: bool = False

    def begin(self, view: View) -> Move:
        """The first move. Raises RollRefused: the face is not known, or no plan leads from it."""
        source = known_face(view)
        plan = self.plan_from(source)  # asked in any case: a roll that cannot be is refused before anything moves
        self._faces = [source]
        self._began_ns = self._moved_ns = view.robot_time_ns
        away_m = max(abs(length - neutral) for length, neutral in zip(view.lengths_m, self.rules.neutral_m, strict=True))
        if away_m > NEUTRAL_TOLERANCE_M:
            return self._move(Phase.TO_NEUTRAL, self.rules.neutral_m)
        return self._start(plan, view)

    def moved(self, view: View) -> None:
        """The motion asked for has been sent to its end. A chain waits on for its next face."""
        self._moved_ns = view.robot_time_ns
        self.phase = _SETTLE_AFTER.get(self.phase, self.phase)

    @property
    def rolls(self) -> int:
        """Faces that it came onto so far."""
        return self._landings() if self.plan is not None and self.plan.links else max(0, len(self._faces) - 1)

    @property
    def next_face(self) -> str:
        """While it rolls on: the face that is to come; else empty."""
        return self.plan.links[self._link].onto if self.plan is not None and self.phase is Phase.ROLL_ON else ""

    @property
    def coming(self) -> tuple[str, ...]:
        """While it rolls on: the faces that are to come."""
        return tuple(link.onto for link in self.plan.links[self._link :]) if self.plan is not None and self.next_face else ()

    def end_early(self, reason: str) -> None:
        """A chain goes to neutral on the next TC, and ends there for this reason."""
        self._ends_early = self._ends_early or reason

    def give_up(self, reason: str, missed: bool = True) -> Move:
        """The next motion of a chain cannot be: back to neutral. `missed`: since a roll did."""
        self._fail(reason)
        self._ended_early = not missed
        return self._move(Phase.RETURN, self.rules.neutral_m, overtakes=True)

    def look(self, view: View) -> Move | RollOutcome | None:
        """What is known has changed, or time has passed; what to do now, if anything. Raises RollRefused as `begin`."""
        self._follow_faces(view)
        if self.phase in (Phase.CONFIRM, Phase.ROLL_ON):
            return self._confirm(view) if self.phase is Phase.CONFIRM else self._roll_on(view)
        if self.phase not in _SETTLE_AFTER.values():
            return None
        waited_s = (view.robot_time_ns - self._moved_ns) * 1e-9
        missing = self._missing(view)
        if missing and waited_s <= self.rules.settle_timeout_s:
            return None
        settled = not missing or (self.rules.observe and self._seen_since(view) is not None)
        if not settled:
            self._fail(f"{missing} within {self.rules.settle_timeout_s:g} s")
        if self.phase is Phase.TO_NEUTRAL_SETTLE:
            return self._start_from_neutral(view)
        if settled:
            self._judge(view)
        if self.phase is Phase.ACTUATE_SETTLE:
            return self._move(Phase.RETURN, self.rules.neutral_m)
        if self.rules.observe and not view.observer and not self._failure:
            self.phase = Phase.CONFIRM
            return self._confirm(view)
        return self.end(view)

    def end(self, view: View, reason: str = "") -> RollOutcome:
        """The roll ends here; a reason makes it a failure."""
        self._follow_faces(view)
        if reason:
            self._fail(reason)
        began_ns = self._moved_ns if self._began_ns is None else self._began_ns
        seen = self._seen_since(view)
        return RollOutcome(
            success=not self._failure,
            reason=self._failure,
            predicted_face=(view.predicted.face or "") if view.predicted else "",
            observed_face=(seen.face or "") if seen else "",
            faces=tuple(self._faces),
            duration_s=(self._moved_ns - began_ns) * 1e-9,
            completed=not reason and self.phase in (Phase.RETURN_SETTLE, Phase.CONFIRM),
            rolls=self.rolls,
            ended_early=self._ended_early,
        )

    # ---- parts ------------------------------------------------------------------------------------------------------

    def _move(self, phase: Phase, lengths_m: Lengths, overtakes: bool = False) -> Move:
        self.phase = phase
        return Move(phase, lengths_m, overtakes)

    def _start(self, plan: RollPlan, view: View) -> Move:
        self.plan = plan
        if plan.links:
            return self._next_link(view)
        self.phase = Phase.ACTUATE
        return Move(Phase.ACTUATE, plan.lengths_m, via=plan.via)

    def _next_link(self, view: View) -> Move:
        """Drive on to the next link's lengths, or to neutral after the last one."""
        assert self.plan is not None
        on_tc = self._link >= 0 and self.plan.links[self._link].onto.startswith("TC")
        if on_tc and self._ends_early and self._link + 1 < len(self.plan.links):
            return self.give_up(f"ended on {self.plan.links[self._link].onto}: {self._ends_early}", missed=False)
        if self._link + 1 == len(self.plan.links):
            return self._move(Phase.RETURN, self.rules.neutral_m, overtakes=True)
        self._link += 1
        self._link_ns, self._landed_ns = view.robot_time_ns, None
        return self._move(Phase.ROLL_ON, self.plan.links[self._link].lengths_m, overtakes=self._link > 0)

    def _roll_on(self, view: View) -> Move | None:
        """A link goes on, or the next one begins."""
        assert self.plan is not None
        link, link_s = self.plan.links[self._link], (view.robot_time_ns - self._link_ns) * 1e-9
        if self.plan.blind:
            return self._next_link(view) if link_s >= link.time_s else None
        if self.rules.observe and not view.observer:
            return self.give_up(f"on the way to {link.onto} nobody tells the face any more", missed=False)
        seen = self._teller(view)
        before = self.plan.links[self._link - 1].onto if self._link else self.plan.source
        if seen is not None and seen.robot_time_ns > self._link_ns:
            if seen.face == link.onto and self._landed_ns is None:
                self._landed_ns = seen.robot_time_ns
            elif seen.face not in (None, before, link.onto):
                return self.give_up(f"on the way to {link.onto} it came to {seen.face} ({seen.source})")
        if self._landed_ns is not None:
            return self._next_link(view) if (view.robot_time_ns - self._landed_ns) * 1e-9 >= link.dwell_s else None
        if link_s > self.rules.link_timeout_s:
            return self.give_up(f"it did not come onto {link.onto} within {self.rules.link_timeout_s:g} s")
        return None

    def _landings(self) -> int:
        """Links of a chain that are made."""
        return self._link + (self._landed_ns is not None) if self._link >= 0 else 0

    def _teller(self, view: View) -> Seen | None:
        """Who says where the robot is while it moves."""
        return view.observed if view.observer else view.predicted

    def _start_from_neutral(self, view: View) -> Move | RollOutcome:
        if self._failure:
            return self.end(view)
        plan = self.plan_from(known_face(view))
        self._faces = [plan.source]
        return self._start(plan, view)

    def _seen_since(self, view: View) -> Seen | None:
        """Where somebody saw the robot at rest since the last motion."""
        seen = view.observed
        return seen if seen is not None and seen.settled and seen.robot_time_ns > self._moved_ns else None

    def _missing(self, view: View) -> str:
        """What is not there yet after a motion; nothing if the robot has settled."""
        twin = view.predicted
        needs_observer = self.rules.observe and view.observer
        if needs_observer and self._seen_since(view) is None:
            return "no observer saw the robot at rest"
        if not needs_observer and twin is None:
            return "no twin is there to predict the face"
        if twin is not None and not (twin.settled and twin.robot_time_ns > self._moved_ns):
            return "the twin is not at rest"
        return ""

    def _stands_on(self, view: View) -> Seen | None:
        """The face after a motion: observed since then, else predicted."""
        return (self._seen_since(view) if self.rules.observe else None) or view.predicted

    def _judge(self, view: View) -> None:
        assert self.plan is not None
        stands = self._stands_on(view)
        target = self.plan.links[self._link].onto if self.plan.links else self.plan.target
        if stands is not None and stands.face != target:
            when = "actuation" if self.phase is Phase.ACTUATE_SETTLE else "the return"
            where = f"on {stands.face}" if stands.face else "on no face"
            self._fail(f"after {when} the robot stands {where} ({stands.source}), not on {target}")

    def _confirm(self, view: View) -> RollOutcome | None:
        if self._seen_since(view) is not None:
            self._judge(view)
            return self.end(view)
        if (view.robot_time_ns - self._moved_ns) * 1e-9 <= self.rules.confirm_timeout_s:
            return None
        told = (view.predicted.face if view.predicted else None) or "no face"
        return self.end(
            view,
            f"nobody said within {self.rules.confirm_timeout_s:g} s on which face the robot stands (the twin predicts {told}); "
            "call set_face, or start the planner with confirm:=predicted",
        )

    def _follow_faces(self, view: View) -> None:
        teller = self._teller(view)
        if teller is None or not teller.face or teller.robot_time_ns < (self._began_ns or 0):
            return
        if self._faces and teller.face != self._faces[-1]:
            self._faces.append(teller.face)

    def _fail(self, reason: str) -> None:
        self._failure = self._failure or reason


def known_face(view: View) -> str:
    """The face known now: observed, else predicted. Raises RollRefused if there is none."""
    known = view.observed or view.predicted
    if known is None:
        raise RollRefused("nobody knows the face: start the twin, or say it with set_face")
    if not known.face:
        raise RollRefused(f"the robot stands on no face ({known.source}): set it on one and say so with set_face")
    return known.face
