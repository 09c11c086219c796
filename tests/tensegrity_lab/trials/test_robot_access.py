# SPDX-License-Identifier: Apache-2.0
"""What a session asks the planner for, and what it makes of the answer; the stack is only imagined."""

from types import SimpleNamespace

import pytest

from tensegrity_lab.trials.judge import void_of
from tensegrity_lab.trials.robot_access import Hardware, RobotAccess
from tests.tensegrity_lab.trials.sessions import begun, with_chains

PLAN = with_chains("TC6-TO5-TC3-TO4-TC4")
FACES = PLAN[0].chain.split("-")


class Operator:
    """A client whose planner answers as the test says; `asked` has the goals."""

    def __init__(self, **answer):
        self.bridge = SimpleNamespace(write_errors=0, state="ARMED", reason="", time_scale=2.0)
        self.asked = []
        self._answer = {"success": False, "completed": True, "reason": "", "rolls": 0, "ended_early": False, **answer}

    def roll(self, target, source, primitive, tell, limit_s, watch, faces):
        watch()
        self.asked.append((target, source, primitive, tuple(faces), limit_s))
        return SimpleNamespace(**self._answer, observed_face="TC3", face_sequence=FACES[:3], duration_s=9.0)


def access(tmp_path, **answer):
    lab = RobotAccess(begun(tmp_path / "s", PLAN), Hardware("", "lsc", 0, "", 2.0, 0.0, False, True))
    lab.operator = Operator(**answer)
    return lab


def rolled(lab):
    return lab.roll("TC6", "TC4", "C1", lambda feedback: None, lambda: None, FACES[1:])


def test_the_planner_is_asked_for_all_faces_and_given_time_for_them(tmp_path):
    lab = access(tmp_path, success=True, rolls=4)
    end = rolled(lab)
    ((*goal, limit_s),) = lab.operator.asked
    assert goal == ["TC4", "TC6", "C1", tuple(FACES[1:])]
    assert limit_s == pytest.approx(30.0 + (150.0 + 4 * 15.0) / 2.0)
    assert (end.success, end.rolls, void_of(end), lab.slow_down()) == (True, 4, "", False)


def test_a_chain_that_ended_early_is_void_and_goes_on_with_half_the_time_scale_down_to_real_time(tmp_path):
    lab = access(tmp_path, rolls=2, ended_early=True, reason="ended on TC3: the struts may run for 12 s yet")
    end = rolled(lab)
    assert (end.success, end.rolls) == (False, 2)
    assert void_of(end) == "ended on TC3: the struts may run for 12 s yet"
    assert lab.slow_down()
    assert not lab.slow_down(), "that is real time"


def test_a_miss_is_no_void_and_nothing_is_slowed_down(tmp_path):
    lab = access(tmp_path, rolls=2, reason="on the way to TO4 it came to TO10 (prototype)")
    assert (void_of(rolled(lab)), lab.slow_down()) == ("", False)
