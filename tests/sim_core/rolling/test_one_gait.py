# SPDX-License-Identifier: Apache-2.0
"""Why one gait stands for 24: gait g on the image of a prototype is the reference gait on the prototype itself."""

import numpy as np
import pytest

from sim_core.gaits.library import gait_of, load_library
from sim_core.rolling.roll import roll
from sim_core.structure.roll_classes import TO_TC
from sim_core.structure.symmetry import carrier
from sim_core.uncertainty.perturbation_law import GROUPS, Law, errors_of, prototype_of

LAW = Law(0.2, tuple(GROUPS)).without("slope")


def image(e, element, errors):
    """The errors of the robot whose every member is that of `errors` carried by the element."""
    joints = list(element.nodes)
    ends = [
        e.position_m[p] + np.einsum("nij,nj->ni", e.frame[p], point)
        for p, point in zip(e.cable_ends.T, (e.cable_point_1_m, e.cable_point_2_m), strict=True)
    ]
    middle, along = ends[0] + ends[1], ends[1] - ends[0]
    carried = {name: rows.copy() for name, rows in errors.items()}
    for rope in range(48):
        same_place = np.linalg.norm(middle - element.matrix @ middle[rope], axis=1)
        turned = [min(np.linalg.norm(a - b), np.linalg.norm(a + b)) for a in along for b in [element.matrix @ along[rope]]]
        onto = int(np.argmin(same_place + turned))
        assert same_place[onto] + turned[onto] < 1e-12
        for name in ("stiffness", "rest_length"):
            carried[name][onto] = errors[name][rope]
    carried["mass"][joints] = errors["mass"][:12]
    carried["joint_size"][joints] = errors["joint_size"]
    carried["stroke"][list(element.struts)] = errors["stroke"]
    carried["payload"] = element.matrix @ errors["payload"]
    return carried


@pytest.mark.parametrize(
    ("number", "source", "target", "proper"), [(1, "TO12", "TC4", True), (10, "TO7", "TC8", False), (17, "TO3", "TC2", False)]
)
def test_a_gait_on_the_image_of_a_prototype_is_the_reference_gait_on_the_prototype(model, number, source, target, proper):
    primitive = next(p for p in load_library("robust").primitives if p.roll_class is TO_TC)
    element = carrier(source, target)
    assert element.proper == proper
    errors = {name: rows[0] for name, rows in errors_of(model, LAW, 4, [number]).items()}
    reference = roll(prototype_of(model, LAW, errors), *TO_TC, primitive.policy)
    robot = prototype_of(model, LAW, image(model.elements, element, errors))
    carried = roll(robot, source, target, gait_of(primitive, source, target).policy)
    assert carried.feasible == reference.feasible
    assert carried.faces == tuple(element.face(face) for face in reference.faces)
    assert carried.margin_m == pytest.approx(reference.margin_m, abs=1e-5)
    assert carried.peak_force_n == pytest.approx(reference.peak_force_n, rel=1e-4)
