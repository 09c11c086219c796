# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from sim_core.dynamics.robot import Robot
from sim_core.errors import UnknownFaceError
from sim_core.structure.policy import lengths_of
from sim_core.structure.roll_classes import TC_TO, TO_TC
from sim_core.structure.symmetry import GROUP
from sim_core.structure.topology import FACES


@pytest.mark.parametrize("face", FACES)
def test_it_rests_on_every_face_and_stays(model, face):
    robot = Robot.resting_on(model, face, (0.3, -0.2), 0.5)
    assert robot.footing().face == face
    assert np.allclose(robot.center_of_mass_m()[:2], [0.3, -0.2])
    start = robot.joints_m()
    robot.advance(model.steps_per_second)
    assert robot.footing().face == face
    assert robot.is_slow()
    assert np.abs(robot.joints_m() - start).max() < 1e-4
    assert robot.ground_forces_n().sum() == pytest.approx(model.weight_n, rel=1e-3)


def test_an_unknown_face_is_refused(model):
    with pytest.raises(UnknownFaceError, match="'TO13'"):
        Robot.resting_on(model, "TO13")


def test_same_input_same_bits_however_the_steps_are_cut(model):
    whole, cut = Robot.resting_on(model, "TC6"), Robot.resting_on(model, "TC6")
    lengths = lengths_of(model.prototype, (-31, 36, 17, 37, -34, -43))
    whole.set_targets(lengths)
    cut.set_targets(lengths)
    whole.advance(4000)
    for steps in (1, 7, 992, 3000):
        cut.advance(steps)
    assert whole.digest() == cut.digest()
    cut.advance(1)
    assert whole.digest() != cut.digest()


def test_a_copy_goes_its_own_way(model):
    robot = Robot.resting_on(model, "TC6")
    before, twin = robot.digest(), robot.copy()
    twin.set_targets(lengths_of(model.prototype, (10, 0, 0, 0, 0, 0)))
    twin.advance(100)
    assert robot.digest() == before != twin.digest()


def isometry(source, image):
    """The orthogonal matrix (reflections included) that carries centred points onto centred points."""
    a, b = source - source.mean(axis=0), image - image.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    return u @ vt


@pytest.mark.parametrize(("roll_class", "policy"), [(TC_TO, (-31, 36, 17, 37, -34, -43)), (TO_TC, (43, -33, -33, -10, -4, -15))])
def test_every_symmetry_of_the_group_carries_the_whole_motion(model, roll_class, policy):
    """model of docs/model.md "The 24 gaits": x′ = Q x + t to 1e-9 L up to the first tip, the same face after it."""
    tolerance = 1e-9 * model.prototype.strut_length_m
    chunk, rolling = model.steps_per_second // 20, 10 * 20
    original = Robot.resting_on(model, roll_class.source)
    original.set_targets(lengths_of(model.prototype, policy))
    path, faces = [original.joints_m()], [original.footing().face]
    for _ in range(rolling):
        original.advance(chunk)
        path.append(original.joints_m())
        faces.append(original.footing().face)
    assert faces[-1] == roll_class.target
    tip = next(i for i, face in enumerate(faces) if face != roll_class.source)
    for element in GROUP:
        robot = Robot.resting_on(model, element.face(roll_class.source))
        nodes = list(element.nodes)
        q = isometry(path[0], robot.joints_m()[nodes])
        assert np.linalg.det(q) == pytest.approx(1.0 if element.proper else -1.0)
        assert np.allclose(q[2], [0, 0, 1], atol=1e-9)
        shift = robot.joints_m()[nodes[0]] - q @ path[0][0]
        robot.set_targets(lengths_of(model.prototype, element.relabel(policy)))
        for i in range(1, rolling + 1):
            robot.advance(chunk)
            if i < tip:
                assert np.abs(robot.joints_m()[nodes] - path[i] @ q.T - shift).max() < tolerance
        assert robot.footing().face == element.face(roll_class.target)
