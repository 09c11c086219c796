# SPDX-License-Identifier: Apache-2.0
"""Who judges where: a person who is asked what an inertial sensor does not know, and who puts down what was lifted.

The lab and the panel are stand-ins: what is tested is which questions come, and that nothing rolls before them.
"""

from types import SimpleNamespace

import pytest

from sim_core.gaits.library import load_library
from sim_core.gaits.success_counts import load_success_counts
from sim_core.planning.face_graph import FaceGraph
from tensegrity_lab.session_data.ledger_line import Outcome
from tensegrity_lab.session_data.plan import Slot
from tensegrity_lab.terminal.keys import ENTER
from tensegrity_lab.trials.judge import UNDECIDED, Feeler
from tensegrity_lab.trials.robot_access import Rolled

SLOT = Slot("P1", "TC6-TO5", "TC6", "TO5", 1, True, (0,) * 6, 0.9, True, "")
DONE = Rolled(True, True, "", "TO5", ("TC6", "TO5"), 12.0, "")


class Lab:
    """A robot whose sensor says that it stands on `felt`, and that rolls where it is asked to."""

    def __init__(self, felt="TC6", watched=True):
        self.felt, self.watched, self.lifted = felt, watched, False
        self.done = []

    @property
    def face(self):
        return "" if self.lifted else self.felt

    def arm(self, at_mid_stroke):
        self.done.append("arm")

    def say_face(self, face):
        self.lifted = False
        self.felt = face
        self.done.append(f"say {face}")

    def roll(self, source, target, *_):
        self.done.append(f"roll {source}-{target}")
        self.felt = target
        return DONE

    def rest(self, needed_s, watch):
        pass

    def trouble(self):
        return ""

    def compare(self, face):
        return ""


@pytest.fixture
def feeler():
    """With keys that are pressed one after the other, and questions that are kept."""
    pressed, asked = [], []
    keys = SimpleNamespace(next=lambda: pressed.pop(0))
    panel = SimpleNamespace(show=lambda **told: asked.append(told.get("question")), line=lambda text: None)
    library = load_library("robust")
    feeler = Feeler(keys, panel, False, FaceGraph(library, load_success_counts(library)))
    return SimpleNamespace(hands=feeler, pressed=pressed, asked=lambda: [text for text in asked if text])


def test_what_was_lifted_is_put_down_and_said_before_anything_rolls(feeler):
    lab = Lab()
    feeler.pressed += [ENTER, ENTER]
    feeler.hands.arm(lab)
    assert lab.face == "", "what the sensor told before it was lifted is not so any more"
    feeler.hands.place(lab, [SLOT], lambda: None)
    assert lab.done == ["arm", "say TC6"]
    assert feeler.asked() == [
        "Lift the robot, keep hands clear, switch of the supply within reach.",
        "Put the robot on TC6, then step back.",
    ]


def test_on_the_floor_it_rolls_to_where_it_is_needed_without_a_question(feeler):
    lab = Lab(felt="TO5")
    feeler.hands.place(lab, [SLOT], lambda: None)
    assert [word for word in lab.done if word.startswith("roll")]
    assert lab.face == "TC6"
    assert feeler.asked() == []


def test_a_roll_that_the_sensor_decides_needs_nobody_and_one_that_it_does_not_is_asked(feeler):
    assert feeler.hands.judge(Lab("TO5"), SLOT, DONE).outcome is Outcome.SUCCESS
    assert feeler.asked() == []
    feeler.pressed += ["y"]
    unknown = DONE._replace(success=False, completed=False, reason=f"{UNDECIDED} 10 s on which face the robot stands")
    verdict = feeler.hands.judge(Lab(""), SLOT, unknown)
    assert (verdict.outcome, verdict.face) == (Outcome.SUCCESS, "TO5")
    assert feeler.asked() == ["Does it stand on TO5, and did it after actuation?"]
