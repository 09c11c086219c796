# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from sim_core.dynamics.footing import FACE_JOINTS, FACE_NAMES, clearance_m, judge_footing, under
from sim_core.dynamics.robot import Robot
from sim_core.structure.topology import FACES, NODES

DOWN = np.array([0.0, 0.0, -1.0])


def standing(joints, center, carrying, force=1.0):
    forces = np.zeros(12)
    forces[list(carrying)] = force
    return judge_footing(joints, np.asarray(center), forces, 0.01, DOWN)


@pytest.fixture
def joints(model):
    return Robot.resting_on(model, "TC6").joints_m()


def test_three_carrying_joints_with_the_centre_inside_are_a_face(joints):
    footing = standing(joints, (0, 0, 0.1), FACES["TC6"])
    assert (footing.face, footing.joints) == ("TC6", FACES["TC6"])
    assert footing.margin_m > 0.03


def test_more_than_three_joints_are_reported_and_never_rounded_to_a_face(joints):
    footing = standing(joints, (0, 0, 0.1), (*FACES["TC6"], 1))
    assert footing.face is None
    assert footing.detail == "rests on 4 joints (2, 3, 9, 11)"


def test_a_centre_outside_the_triangle_is_reported(joints):
    footing = standing(joints, (0.3, 0, 0.1), FACES["TC6"])
    assert footing.face is None
    assert footing.margin_m < 0
    assert "outside" in footing.detail


def test_three_joints_that_are_no_face_are_reported(joints):
    assert "no face" in standing(joints, (0, 0, 0.1), (0, 1, 2)).detail


def test_no_ground_is_reported(joints):
    assert standing(joints, (0, 0, 0.1), ()).detail == "does not touch the ground"


def test_a_joint_that_barely_touches_carries_nothing(joints):
    forces = np.zeros(12)
    forces[list(FACES["TC6"])] = 1.0
    forces[1] = 0.009
    assert judge_footing(joints, np.array([0, 0, 0.1]), forces, 0.01, DOWN).face == "TC6"


def test_the_projection_follows_gravity_on_a_slope(joints):
    tilted = np.array([np.sin(0.6), 0.0, -np.cos(0.6)])
    forces = np.zeros(12)
    forces[list(FACES["TC6"])] = 1.0
    level = judge_footing(joints, np.array([0.0, 0.0, 0.105]), forces, 0.01, DOWN)
    sloped = judge_footing(joints, np.array([0.0, 0.0, 0.105]), forces, 0.01, tilted)
    assert level.face == "TC6"
    assert sloped.face is None


def below(joints, center, down=DOWN):
    face = under(joints, np.asarray(center, dtype=float), down, FACE_JOINTS)
    return FACE_NAMES[face] if face >= 0 else None


def test_in_motion_the_face_is_the_one_below_the_centre_whatever_carries(joints):
    lifted = joints + np.array([0.0, 0.0, 0.004])  # as in a bounce
    assert below(joints, (0, 0, 0.1)) == below(lifted, (0, 0, 0.1)) == "TC6"
    assert below(joints, (0.3, 0, 0.1)) is None, "it falls"
    assert below(joints, (0, 0, 0.105), np.array([np.sin(0.6), 0.0, -np.cos(0.6)])) is None, "on a slope"


def test_of_four_low_joints_the_centre_tells_the_face_and_a_high_one_is_on_none(joints):
    a, b = sorted(set(FACES["TC6"]) & set(FACES["TO5"]))
    (third,) = set(FACES["TO5"]) - {a, b}
    edge = (joints[a] + joints[b])[:2] / 2
    beyond = joints.copy()
    beyond[third, :2], beyond[third, 2] = 2.5 * edge, joints[:, 2].min() + 0.005  # a fourth joint on the ground, past the edge
    assert below(beyond, (0, 0, 0.1)) == "TC6"
    assert below(beyond, (*(1.3 * edge), 0.1)) == "TO5"
    beyond[third, 2] += 0.02
    assert below(beyond, (*(1.3 * edge), 0.1)) is None, "it is still falling onto it"


def test_clearance_of_the_ideal_shape_in_closed_form():
    length = 0.234
    joints = length * NODES
    # perpendicular struts and the box are all L/4 from each other's axes
    assert clearance_m(joints, np.zeros(3), 0.015, 0.0) == pytest.approx(length / 4 - 0.015)
    assert clearance_m(joints, np.zeros(3), 0.015, 0.015) == pytest.approx(length / 4 - 0.0225)
    assert clearance_m(joints, np.array([0.0, 0.02, 0.0]), 0.015, 0.015) == pytest.approx(length / 4 - 0.0425)
