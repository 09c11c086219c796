# SPDX-License-Identifier: Apache-2.0
"""A session from its first trial due to its last: each is checked, rolled, judged, recorded. May be killed at any point."""

import math
import time
from contextlib import suppress
from dataclasses import replace
from typing import Any

from hardware_bridge.safety.duty_cycle import Duty
from hardware_bridge.safety.limits import Limits
from tensegrity_lab.errors import SessionError, StackError
from tensegrity_lab.session_data.bag_messages import lines_in_bag
from tensegrity_lab.session_data.folder import SessionFolder
from tensegrity_lab.session_data.ledger import Ledger, Standing
from tensegrity_lab.session_data.ledger_line import Event, Line, Outcome, utc_ns, utc_text
from tensegrity_lab.session_data.plan import DIGITS, Slot, due_of, next_due, placing
from tensegrity_lab.terminal.keys import Keys
from tensegrity_lab.trials.judge import Hands, Verdict
from tensegrity_lab.trials.panel import LEAVE, UNDO, Panel
from tensegrity_lab.trials.robot_access import RobotAccess, Rolled
from tensegrity_lab.trials.time_estimate import Work, work_of

VOIDS_ALLOWED = 3
"""In a row: then something is wrong that more trials do not mend."""
KILLED = "the session was killed, or lost its power, in the middle of it"
STOPPED = "the experimenter ended the session in the middle of it"
KEYS = (("space", "STOP"), UNDO, ("p", "pause"), ("q", "leave after this trial"))


class Session:
    """See the module. One call of `run` for each start of the program."""

    def __init__(
        self,
        folder: SessionFolder,
        ledger: Ledger,
        lab: RobotAccess,
        hands: Hands,
        panel: Panel,
        experimenter: str,
        speed_m_s: float,
        keys: Keys | None = None,
        forecast_s: float = 0.0,
    ):
        """Args: keys: of a person who may stop, undo, pause. speed_m_s: of an actuator. forecast_s: wall time of what is due."""
        self._folder, self._ledger, self._lab, self._hands, self._panel = folder, ledger, lab, hands, panel
        self._experimenter = experimenter
        self._speed_m_s = speed_m_s
        self._keys = keys
        self._forecast_s = forecast_s
        self._began_s = 0.0
        self._leave = False
        self._tried = 0
        self._unlogged: list[Line] = []

    def run(self) -> Standing:
        """Everything that is due, until all is done or the experimenter leaves. Returns how the ledger then stands.

        Raises:
            StackError, SessionError: it cannot go on; what is done is in the ledger.
            KeyboardInterrupt: interrupted; likewise.
        """
        standing = self._settle()
        due = due_of(self._folder.plan, standing.done())
        if not due:
            return standing
        self._unlogged = self._not_in_bags()
        self._panel.show(total=len(self._folder.plan), phase="starting", **self._progress(due))
        self._lab.start(self._start_face(standing, due))
        self._hands.arm(self._lab)
        self._began_s, voids = time.monotonic(), 0
        while due and not self._leave:
            if self._lab.trouble():
                self._hands.recover(self._lab, due, self._lab.trouble())
            self._log()
            slot = next_due(due, self._lab.face)
            if slot is None:
                self._panel.show(phase="going where the next trial begins")
                self._hands.place(self._lab, due, self._watch)
                continue
            outcome = self._trial(slot)
            if outcome is Outcome.VOID and self._lab.slow_down():
                self._panel.line("going on with half the time scale")
                self._hands.recover(self._lab, due, self._ledger.lines[-1].reason)
                continue
            voids = voids + 1 if outcome is Outcome.VOID else 0
            if voids == VOIDS_ALLOWED:
                last = self._ledger.lines[-1].reason
                raise SessionError(
                    f"{voids} trials in a row are void, the last because: {last}; mend that, then the same command again"
                )
            due = due_of(self._folder.plan, self._ledger.standing().done())
        self._lab.disarm()
        return self._ledger.standing()

    # ---- before the first trial -------------------------------------------------------------------------------------

    def _settle(self) -> Standing:
        """What a killed session left open is void."""
        began = self._ledger.standing().open
        if began is not None:
            self._ledger.append(replace(began, event=Event.TRIAL, recorded=_now(), outcome=Outcome.VOID, reason=KILLED))
            self._panel.line(f"trial {began.number} is void: {KILLED}; it will be tried again")
        if self._ledger.damaged:
            self._panel.line(f"{self._ledger.damaged} lines of the ledger are cut short; they never counted")
        return self._ledger.standing()

    def _not_in_bags(self) -> list[Line]:
        """Lines that are in no bag yet: the session was killed in between."""
        from hardware_bridge.recording.bag_on_disk import bags_in
        from hardware_bridge.recording.session_bag import mend_journals

        for told in mend_journals(self._folder.bags.resolve()):
            self._panel.line(told)
        logged = {(line.event, line.number) for bag in bags_in(self._folder.bags) for line in lines_in_bag(bag)}
        return [line for line in self._ledger.lines if line.event is not Event.BEGIN and (line.event, line.number) not in logged]

    def _start_face(self, standing: Standing, due: list[Slot]) -> str:
        """Where the robot was left, if something is due there."""
        last = standing.trials.get(standing.last_number)
        left = last.observed_face if last is not None else ""
        return left if next_due(due, left) is not None else placing(due)

    # ---- one trial --------------------------------------------------------------------------------------------------

    def _trial(self, slot: Slot) -> Outcome:
        """Check, roll, judge, record."""
        lab = self._lab
        _, *faces = slot.chain.split("-")
        what = f"{slot.primitive}, {len(faces)} rolls: {' '.join(faces)}" if faces else slot.primitive
        self._panel.show(source=slot.source, target=slot.target, primitive=what, phase="checking", keys=KEYS)
        self._watch()
        self._check(slot)
        began_ns, began_s = time.time_ns(), time.monotonic()
        bag, offset_s = lab.bag_place(began_ns)
        settings, number = self._folder.settings, self._ledger.standing().last_number + 1
        robot = settings.robot, settings.virtual_robot, settings.library, settings.library_hash
        line = Line(Event.BEGIN, number, _now(), settings.name, self._experimenter, *robot, **slot._asdict())
        line = replace(line, began=utc_text(began_ns), bag=bag, bag_offset_s=round(offset_s, DIGITS))
        rolled = Rolled(False, False, "", "", (slot.source,), math.nan, "")
        try:
            self._ledger.append(line)
            rolled = lab.roll(slot.source, slot.target, slot.primitive, self._on_feedback, self._watch, faces)
            verdict = self._hands.judge(lab, slot, rolled)
        except (KeyboardInterrupt, EOFError):
            if self._ledger.standing().open is not None:  # else it came before the trial began, or after its end
                self._record(line, Verdict(Outcome.VOID, STOPPED, ""), rolled, began_s)
            raise
        except StackError as error:
            self._record(line, Verdict(Outcome.VOID, str(error), ""), rolled, began_s)
            return Outcome.VOID
        self._record(line, verdict, rolled, began_s)
        return verdict.outcome

    def _check(self, slot: Slot) -> None:
        """What must be well before a trial. Raises StackError."""
        needs_s = self._work_of(slot).needs_s
        if self._lab.operator.bridge.duty_left_s < needs_s or self._still_warm_s(slot) > 0.0:
            self._panel.show(phase="resting: the actuators have run as long as their duty permits")
            self._lab.rest(needs_s, self._watch)
            self._cool_down(slot)
        self._lab.wait_for_growing_log()

    def _still_warm_s(self, slot: Slot) -> float:
        """How long a real robot must still rest for what it ran just before (s): by the ledger; the bridge remembers it, too."""
        if self._folder.settings.virtual_robot:
            return 0.0  # each start is another prototype, cold
        limits, now_s, duty = Limits(), time.time(), Duty()
        for line in self._ledger.lines:
            at_s = utc_ns(line.began) / 1e9 if line.event is Event.BEGIN else -math.inf
            if at_s > now_s - 2.0 * limits.duty_window_s:
                duty = duty.ran(self._work_of(line).runs_s.tolist(), at_s, limits)
        return min(duty.wait_s(self._work_of(slot).runs_s, now_s, limits), limits.longest_window_s)

    def _work_of(self, gait: Slot | Line) -> Work:
        return work_of(gait, self._folder.library, self._speed_m_s)

    def _cool_down(self, slot: Slot) -> None:
        end = time.monotonic() + self._still_warm_s(slot)
        while time.monotonic() < end:
            self._watch()
            time.sleep(0.05)

    def _record(self, begun: Line, verdict: Verdict, rolled: Rolled, began_s: float) -> None:
        """To the ledger first, then into the bag: a line in no bag is put into one at the next start."""
        lab = self._lab
        line = replace(
            begun,
            event=Event.TRIAL,
            recorded=_now(),
            outcome=verdict.outcome,
            reason=verdict.reason,
            observed_face=verdict.face,
            faces=rolled.faces,
            robot_s=round(rolled.robot_s, DIGITS),
            wall_s=round(time.monotonic() - began_s, DIGITS),
            battery_v=round(float(lab.operator.bridge.battery_v), DIGITS),
            faults=rolled.faults,
            rolls=rolled.rolls,
        )
        self._ledger.append(line)
        self._tried += 1
        self._tell(line)
        self._unlogged.append(line)
        with suppress(StackError):  # the stack is dead or dying: into the next bag, then
            self._log()

    def _log(self) -> None:
        """Into the bag what is in none. Raises StackError."""
        while self._unlogged:
            self._lab.log(self._unlogged[0])
            del self._unlogged[0]

    # ---- while it goes on -------------------------------------------------------------------------------------------

    def _watch(self) -> None:
        """Heed the keyboard; keep the panel true."""
        bridge = self._lab.operator.bridge
        self._panel.show(
            stands=self._lab.face,
            link="well" if bridge.link_ok else "LOST",
            duty=f"{bridge.duty_left_s:.0f} s left",
            battery="not told" if math.isnan(bridge.battery_v) else f"{bridge.battery_v:.1f} V",
            bag=f"bag {bridge.bag_messages} messages" if bridge.bag else "NO BAG",
            trouble="" if bridge.state == "ARMED" else f"{bridge.state} {bridge.reason}",
        )
        if self._keys is None:
            return
        key = self._keys.poll()
        if key == " ":
            self._lab.stop_motion()
        elif key == "u":
            self.undo()
        elif key == "q":
            self._leave = True
            self._panel.show(phase="leaving after this trial")
        elif key == "p":
            self._panel.show(question="Paused.", keys=(("p", "go on"), UNDO, LEAVE))
            while (key := self._keys.next()) != "p" and not self._leave:
                self._leave = key == "q"
                if key == "u":
                    self.undo()
            self._panel.show(question="", keys=KEYS)

    def undo(self) -> None:
        """Revoke the last trial that counts, void or not: its gait is due again."""
        standing = self._ledger.standing()
        if not standing.trials:
            return
        last = standing.trials[max(standing.trials)]
        line = replace(last, event=Event.REVOKE, recorded=_now())
        self._ledger.append(line)
        self._panel.line(f"trial {last.number} ({last.name}, {last.outcome}) is revoked")
        self._panel.show(last=f"trial {last.number} revoked")
        self._unlogged.append(line)

    def _on_feedback(self, feedback: Any) -> None:
        onto = f" to {feedback.next_face}, {feedback.rolls} rolls made" if feedback.next_face else ""
        self._panel.show(phase=f"{feedback.phase}{onto}, {100 * feedback.progress:.0f} %")

    def _progress(self, due: list[Slot]) -> dict[str, Any]:
        standing = self._ledger.standing()
        elapsed_s = time.monotonic() - self._began_s if self._began_s else 0.0
        left_s = elapsed_s / self._tried * len(due) if self._tried >= 5 else max(0.0, self._forecast_s - elapsed_s)
        return {"done": len(standing.valid), "successes": standing.successes, "left_s": left_s}

    def _tell(self, line: Line) -> None:
        due = due_of(self._folder.plan, self._ledger.standing().done())
        progress = self._progress(due)
        why = f": {line.reason}" if line.reason else ""
        text = f"{line.name} {line.ended}{why}"
        self._panel.show(last=text, **progress)
        self._panel.line(f"trial {line.number}: {text}  ({progress['done']} of {len(self._folder.plan)} done)")


def _now() -> str:
    return utc_text(time.time_ns())
