# SPDX-License-Identifier: Apache-2.0
"""How a session goes on, with a lab that is only imagined: every branch that the whole stack meets too seldom to wait for."""

import math
from types import SimpleNamespace

import pytest

from tensegrity_lab.errors import SessionError, StackError
from tensegrity_lab.session_data.ledger import Ledger
from tensegrity_lab.session_data.ledger_line import Event, Outcome
from tensegrity_lab.trials.judge import Observer
from tensegrity_lab.trials.panel import Panel, Shown, big, picture
from tensegrity_lab.trials.robot_access import Rolled
from tensegrity_lab.trials.session import KILLED, VOIDS_ALLOWED, Session
from tensegrity_lab.trials.time_estimate import work_of
from tests.tensegrity_lab.trials.sessions import add, begun, cyclic, graph, line_of, planned, with_chains


class Imagined:
    """A lab whose robot does as it is told, but for what the test says.

    Attributes:
        rolls: (source, target, primitive) asked for; primitive is empty on the way to another face. starts: faces started on.
        over: faces of the chains asked for. bag: lines logged.
        behave: (number of the roll from 0, source, target) -> Rolled, or raises; default: success.
    """

    def __init__(self, behave=None):
        self.face, self.starts, self.rolls, self.bag, self.problem, self.late = "", [], [], [], "", False
        self._behave = behave
        self.rested_s, self.over = [], []
        bridge = SimpleNamespace(
            link_ok=True, duty_left_s=120.0, battery_v=math.nan, bag="b", bag_messages=1, state="ARMED", reason=""
        )
        self.operator = SimpleNamespace(bridge=bridge)

    def start(self, face):
        self.face, self.problem = face, ""
        self.starts.append(face)

    def stop(self):
        self.face = ""

    def trouble(self):
        return self.problem

    def compare(self, face):
        return ""

    def wait_for_rest(self):
        return self.face

    def bag_place(self, time_ns):
        return "b.mcap", 1.0

    def rest(self, needed_s, watch):
        watch()
        self.rested_s.append(needed_s)
        self.operator.bridge.duty_left_s = 120.0

    def log(self, line):
        if self.problem:
            raise StackError("the bridge is dead")
        self.bag.append(line)

    def arm(self, at_mid_stroke):
        pass

    disarm = wait_for_growing_log = lambda self: None

    def slow_down(self):
        was, self.late = self.late, False
        return was

    def roll(self, source, target, primitive, tell, watch, faces=()):
        assert source == self.face, "a roll begins where the robot is"
        watch()
        number = len(self.rolls)
        self.rolls.append((source, target, primitive))
        if faces:
            self.over.append("-".join((source, *faces)))
        rolled = self._behave and self._behave(self, number, source, target)
        rolled = rolled or Rolled(True, True, "", target, (source, target), 7.0, "")
        self.face = rolled.observed_face
        return rolled


@pytest.fixture
def session(tmp_path):
    """Makes a session of a plan in an imagined lab."""

    def make(plan, lab, keys=None):
        folder = begun(tmp_path / "s", plan) if not (tmp_path / "s" / "session.yaml").exists() else make.folder
        make.folder = folder
        hands = Observer(graph(), True, lambda text: None)
        return Session(folder, Ledger(folder.path), lab, hands, Panel("virtual trials"), "Ada", 0.015, keys)

    return make


def missed(lab, number, source, target, where, completed=True):
    return Rolled(False, completed, f"it stands on {where}", where, (source, where), 7.0, "")


def test_it_tries_everything_once_and_logs_every_record(session):
    plan, lab = planned("1,21"), Imagined()
    standing = session(plan, lab).run()
    assert standing.done() == {slot.gait for slot in plan}
    assert [line.number for line in lab.bag] == list(range(1, 49))
    assert len(lab.starts) == 1
    assert {line.outcome for line in standing.valid} == {Outcome.SUCCESS}


def test_landing_elsewhere_it_goes_on_from_there(session):
    plan = planned("1-2,21-22")

    def behave(lab, number, source, target):
        return missed(lab, number, source, target, source) if number % 3 == 1 else None

    lab = Imagined(behave)
    standing = session(plan, lab).run()
    outcomes = [line.outcome for line in standing.valid]
    assert len(outcomes) == len(plan), "a failure is an outcome: it is not tried again"
    assert Outcome.FAILURE in outcomes
    trials = [roll for roll in lab.rolls if roll[2]]
    assert len(trials) == len(plan)
    assert len(lab.rolls) - len(trials) < len(plan) / 2, "with every third a failure, it seldom must go elsewhere"


def test_on_no_face_the_prototype_is_put_on_one(session):
    plan = planned("1", "TC6-TO5,TC1-TO1")
    lab = Imagined(lambda lab, number, source, target: missed(lab, number, source, target, "") if number == 0 else None)
    standing = session(plan, lab).run()
    assert len(lab.starts) == 2
    assert lab.starts[1] == plan[1].source
    assert standing.valid[0].observed_face == ""


def test_void_is_tried_again_and_three_in_a_row_end_the_session(session):
    def behave(lab, number, source, target):
        return missed(lab, number, source, target, source, completed=False) if number in (0, 1) else None

    lab = Imagined(behave)
    standing = session(planned("1", "reference"), lab).run()
    assert [line.outcome for line in standing.trials.values()] == ["void", "void", "success"]


def test_what_only_ever_fails_to_run_ends_with_its_reason(session):
    lab = Imagined(lambda lab, number, source, target: missed(lab, number, source, target, source, completed=False))
    with pytest.raises(SessionError, match=f"{VOIDS_ALLOWED} trials in a row are void, the last because: it stands on TC6"):
        session(planned("1", "reference"), lab).run()


def test_orders_that_came_too_late_are_void_and_the_same_robot_goes_on_more_slowly(session):
    def behave(lab, number, source, target):
        lab.late = number < VOIDS_ALLOWED
        return missed(lab, number, source, target, source, completed=False) if lab.late else None

    lab = Imagined(behave)
    standing = session(planned("1", "reference"), lab).run()
    outcomes = [line.outcome for line in standing.trials.values()]
    assert outcomes == ["void"] * VOIDS_ALLOWED + ["success"], "slower each time: nothing that more trials would not mend"
    assert len(lab.starts) == 1 + VOIDS_ALLOWED


def test_a_stack_that_dies_makes_a_void_trial_is_started_anew_and_its_record_is_in_the_next_bag(session):
    def behave(lab, number, source, target):
        if number == 0:
            lab.problem = "the hardware bridge is silent"
            raise StackError("hardware_bridge ended with exit code -9")

    lab = Imagined(behave)
    standing = session(planned("1", "reference"), lab).run()
    assert [line.outcome for line in standing.trials.values()] == ["void", "success"]
    assert "exit code -9" in standing.trials[1].reason
    assert len(lab.starts) == 2
    assert [(line.number, line.outcome) for line in lab.bag] == [(1, "void"), (2, "success")]


def test_what_a_kill_left_open_is_void_and_what_is_in_no_bag_is_logged(session, tmp_path):
    plan = planned("1,21", "reference")
    first = session(plan, Imagined())
    ledger = Ledger(tmp_path / "s")
    done = add(ledger, plan[0], Outcome.SUCCESS)
    ledger.append(line_of(plan[1], 2))
    lab = Imagined()
    standing = session(plan, lab).run()
    assert first is not None
    assert [(line.number, line.outcome) for line in standing.trials.values()] == [(1, "success"), (2, "void"), (3, "success")]
    assert standing.trials[2].reason == KILLED
    assert [(line.event, line.number) for line in lab.bag] == [("trial", 1), ("trial", 2), ("trial", 3)]
    assert lab.bag[0].gait == done.gait


def test_it_rests_until_the_duty_permits_a_whole_trial(session):
    lab = Imagined()
    lab.operator.bridge.duty_left_s = 3.0
    plan = planned("1", "reference")
    session(plan, lab).run()
    assert lab.rested_s == [pytest.approx(2 * max(map(abs, plan[0].policy_mm)) / 15)]


def chained(rolls, where, success=False, completed=True, early=False):
    """How a chain ended."""
    return Rolled(success, completed, "" if success else "why", where, ("TC6",), 7.0, "", rolls, early)


@pytest.mark.parametrize(
    ("ends", "outcomes", "rolls"),
    [
        ([chained(4, "TC4", success=True)], ["success"], [4]),
        ([chained(2, "TO10")], ["failure"], [2]),
        ([chained(4, "TO12")], ["failure"], [4]),  # it made all rolls and did not stay
        ([chained(2, "TC6", early=True), chained(4, "TC4", success=True)], ["void", "success"], [2, 4]),
        ([chained(1, "TC6", completed=False), chained(4, "TC4", success=True)], ["void", "success"], [1, 4]),
    ],
)
def test_a_chain_is_one_trial_made_whole_missed_or_void_with_the_rolls_it_made(session, ends, outcomes, rolls):
    plan = with_chains("TC6-TO5-TC3-TO4-TC4")
    lab = Imagined(lambda lab, number, source, target: ends[number])
    standing = session(plan, lab).run()
    assert set(lab.over) == {plan[0].chain}
    assert lab.rolls[0] == ("TC6", "TC4", "C1")
    lines = list(standing.trials.values())
    assert [line.outcome for line in lines] == outcomes
    assert [line.rolls for line in lines] == rolls
    assert [line.reason for line in lines] == ["" if outcome == "success" else "why" for outcome in outcomes]
    assert [(line.chain, line.target) for line in lab.bag] == [(plan[0].chain, "TC4")] * len(lines)


def test_it_rests_until_duty_permits_a_whole_chain_and_says_how_far_it_is(session, capsys):
    plan = with_chains("TC6-TO5-TC3-TO4-TC4")
    lab = Imagined(lambda lab, number, source, target: chained(3, "TO4"))
    lab.operator.bridge.duty_left_s = 20.0
    session(plan, lab).run()
    assert lab.rested_s == [pytest.approx(work_of(plan[0], cyclic(), 0.015).needs_s)]
    assert "trial 1: C1 TC6→TO5→TC3→TO4→TC4 failure, 3 of 4 rolls: why" in capsys.readouterr().out


def test_the_panel_tells_the_faces_of_a_chain_and_the_rolls_made(session):
    plan, told = with_chains("TC6-TO5-TC3-TO4-TC4"), []
    lab = Imagined(lambda lab, number, source, target: chained(4, "TC4", success=True))
    one = session(plan, lab)
    roll = lab.roll

    def telling(source, target, primitive, tell, watch, faces):
        tell(SimpleNamespace(phase="rolling on", next_face="TO4", rolls=2, progress=0.4))
        told.append(one._panel.shown)
        return roll(source, target, primitive, tell, watch, faces)

    lab.roll = telling
    one.run()
    (shown,) = told
    assert (shown.source, shown.target, shown.primitive) == ("TC6", "TC4", "C1, 4 rolls: TO5 TC3 TO4 TC4")
    assert shown.phase == "rolling on to TO4, 2 rolls made, 40 %"


class Pressed:
    """Keys that are pressed one after the other, one at each look."""

    def __init__(self, *keys):
        self.keys = list(keys)

    def poll(self, wait_s=0.0):
        return self.keys.pop(0) if self.keys else None

    next = poll


def test_keys_undo_pause_and_leave(session):
    plan, lab = planned("1,21"), Imagined()
    # looks: before and during each of the trials 1, 2, 3
    standing = session(plan, lab, Pressed(None, None, None, "u", "p", "u", "p", None, "q")).run()
    assert standing.revoked == {1, 2}
    assert list(standing.trials) == [3, 4]
    assert len(due := standing.done()) == 2, due
    assert [line.number for line in lab.bag if line.event is Event.REVOKE] == [1, 2]


def test_the_panel_can_be_read_from_afar():
    from rich.console import Console

    console = Console(width=110, record=True)
    shown = Shown(
        "virtual trials", "resting", "TC6", "TO5", "P1", "TC6", 48, 96, 40, 4000.0, "well", "12 s left", question="Is it?"
    )
    console.print(picture(shown))
    text = console.export_text()
    for row in big("TC6 → TO5").splitlines():
        assert row.strip() in text
    for words in (
        "48 of 96 trials",
        "40 of 48 succeeded",
        "1 h 07 min left",
        "the robot stands on TC6",
        "duty 12 s left",
        "Is it?",
    ):
        assert words in text
