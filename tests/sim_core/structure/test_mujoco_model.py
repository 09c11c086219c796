# SPDX-License-Identifier: Apache-2.0
"""The robot as MuJoCo gets it, read as XML, and put down in MuJoCo."""

import importlib
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from sim_core.structure.elements import elements_of, previous_elements_of
from sim_core.structure.mujoco_model import damped, mjcf, positions_of, read_sensors
from sim_core.structure.parameters import load_prototype
from sim_core.structure.topology import FACES


@pytest.fixture(scope="module")
def elements():
    return elements_of(load_prototype())


@pytest.fixture(scope="module")
def tree(elements):
    return ElementTree.fromstring(mjcf(elements, 0.002, sensors=True))


def numbers(text):
    return np.array([float(word) for word in text.split()])


def test_it_has_the_robot_s_mass(tree, elements):
    assert sum(float(i.get("mass")) for i in tree.iter("inertial")) == pytest.approx(elements.mass_kg.sum(), rel=1e-12)


def test_its_cables_only_pull_and_keep_stiffness_and_length(tree, elements):
    tendons = tree.findall("tendon/spatial")
    assert [float(t.get("stiffness")) for t in tendons] == elements.cable_stiffness_n_m.tolist()
    assert [numbers(t.get("springlength")).tolist() for t in tendons] == [[0.0, rest] for rest in elements.cable_rest_m]


def test_its_points_lie_where_the_robot_s_do(tree, elements):
    """Every cable's length in the ideal shape, through bodies and sites."""
    sites = {}

    def visit(body, turn, shift):
        turn = turn @ turn_of(numbers(body.get("quat", "1 0 0 0")))
        shift = shift + parent_turn[0] @ numbers(body.get("pos", "0 0 0"))
        for site in body.findall("site"):
            sites[site.get("name")] = shift + turn @ numbers(site.get("pos"))
        for inner in body.findall("body"):
            parent_turn[0] = turn
            visit(inner, turn, shift)

    for body in tree.findall("worldbody/body"):
        parent_turn = [np.eye(3)]
        visit(body, np.eye(3), np.zeros(3))
    for cable, (p1, p2) in enumerate(elements.cable_ends):
        ours = [
            elements.position_m[p] + elements.frame[p] @ point[cable]
            for p, point in ((p1, elements.cable_point_1_m), (p2, elements.cable_point_2_m))
        ]
        for side in (0, 1):
            assert sites[f"c{cable}_{side}"] == pytest.approx(ours[side], abs=1e-12)
    for joint in range(12):
        assert sites[f"N{joint + 1}"] == pytest.approx(elements.position_m[joint], abs=1e-12)


def turn_of(q):
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_generalised_positions_are_six_struts_and_the_box(elements):
    quaternions = np.tile([1.0, 0.0, 0.0, 0.0], (13, 1))
    positions = positions_of(elements.position_m, quaternions)
    assert positions.shape == (6 * 8 + 7,)
    assert positions[-7:].tolist() == [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]


def test_another_model_is_refused():
    with pytest.raises(ValueError, match="improved model"):
        mjcf(previous_elements_of(load_prototype()), 0.001)


@pytest.mark.parametrize("face", ["TC6", "TO5"])
def test_put_down_its_feet_touch_the_ground(elements, face):
    tree = ElementTree.fromstring(mjcf(elements, 0.001, face=face))
    heights = []

    def visit(body, turn, shift):
        shift = shift + turn @ numbers(body.get("pos", "0 0 0"))
        turn = turn @ turn_of(numbers(body.get("quat", "1 0 0 0")))
        heights.extend((shift + turn @ numbers(foot.get("pos")))[2] for foot in body.findall("geom"))
        for inner in body.findall("body"):
            visit(inner, turn, shift)

    for body in tree.findall("worldbody/body"):
        visit(body, np.eye(3), np.zeros(3))
    lowest = sorted(heights)[:3]
    assert len(heights) == 60
    assert lowest[0] == pytest.approx(0.0, abs=1e-12)
    assert lowest[2] < 0.001


@pytest.mark.slow
@pytest.mark.parametrize("face", ["TC6", "TO5"])
def test_in_mujoco_it_rests_as_high_as_the_twin(elements, face):
    mujoco = importlib.import_module("mujoco")
    from sim_core.dynamics.model import build_model
    from sim_core.dynamics.robot import Robot

    model = damped(mujoco.MjModel.from_xml_string(mjcf(elements, 0.001, sensors=True, face=face)))
    data = mujoco.MjData(model)
    for _ in range(8000):
        mujoco.mj_step(model, data)
    joints, box, speeds, _ = read_sensors(data.sensordata)
    robot = Robot.resting_on(build_model(load_prototype()), face)
    height = float(elements.mass_kg @ np.append(joints[:, 2], box[2]) / elements.mass_kg.sum())
    assert height == pytest.approx(float(robot.center_of_mass_m()[2]), rel=0.01)
    assert set(np.argsort(joints[:, 2])[:3]) == set(FACES[face])
    assert np.abs(speeds).max() < 1e-3
