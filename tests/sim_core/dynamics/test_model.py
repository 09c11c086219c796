# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from sim_core.dynamics import vfife as k
from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.dynamics.stability import largest_stable_step_s
from sim_core.errors import DivergedError, ModelError, UnstableStepError
from sim_core.structure.elements import elements_of


def changed(array, index, value):
    copy = np.array(array)
    copy[index] = value
    return copy


@pytest.mark.parametrize(
    ("field", "index", "value", "message"),
    [
        ("mass_kg", 3, 0.0, r"mass_kg\[3\] = 0: valid is a positive number"),
        ("cable_stiffness_n_m", 7, -1.0, r"cable_stiffness_n_m\[7\] = -1"),
        ("cable_ends", (2, 1), 99, r"cable_ends\[2\] = .*99.*valid particles are 0\.\.12"),
        ("inertia_kg_m2", (1, 2), np.nan, "inertia_kg_m2 holds a value that is not finite"),
        ("friction", 0, -0.1, "friction .* zero or more"),
        ("cable_rest_m", 4, 0.3, r"the self-stress is slack: tendon T5 has rest length 0\.3 m over 0\.12"),
        ("cable_rest_m", 30, 0.3, "the self-stress is slack: box rope 7"),
    ],
)
def test_a_bad_model_dies_at_construction_with_the_offending_value(prototype, field, index, value, message):
    elements = elements_of(prototype)
    with pytest.raises(ModelError, match=message):
        build_model(prototype, replace(elements, **{field: changed(getattr(elements, field), index, value)}))


def test_an_unstable_step_is_refused_naming_both_numbers(prototype):
    with pytest.raises(UnstableStepError, match=r"time step 1\.000e-03 s is not stable.*limit is 7\.3\d*e-04 s.*>= 14\d\d"):
        build_model(replace(prototype, steps_per_second=1000))


def test_the_limit_is_where_a_run_really_diverges(prototype):
    shortest = np.full(6, prototype.strut_length_m - prototype.actuator_stroke_m)
    model = build_model(prototype)
    limit = largest_stable_step_s(model.elements, model.assembly, model.par, prototype.actuator_stroke_m)

    def survives(step_s):
        elements = replace(elements_of(prototype), steps_per_second=round(1 / step_s), gravity_m_s2=np.zeros(3), zeta_1_s=0.0)
        fast = build_model_unchecked(prototype, elements)
        robot = Robot(fast)
        robot.place(np.eye(3), np.array([0.0, 0.0, 10.0]))
        robot.set_targets(shortest)
        try:
            robot.advance(round(8 / step_s))
        except DivergedError:
            return False
        return bool(robot.joint_speeds_m_s().max() < 5.0)

    assert survives(0.95 * limit)
    assert not survives(1.1 * limit)


def build_model_unchecked(prototype, elements):
    """A model at a step that the guard would refuse: to see whether the guard is right."""
    safe = build_model(prototype, replace(elements, steps_per_second=20_000))
    scaled, lay = safe.par.copy(), safe.layout
    scaled[: lay.par_gravity].reshape(-1, k.PARTICLE_PAR)[:, k.DT_M] = 1.0 / (elements.steps_per_second * elements.mass_kg)
    scaled[lay.par_struts : lay.par_cables] = elements.strut_speed_m_s / elements.steps_per_second
    return replace(safe, elements=elements, par=scaled)


def test_the_model_is_symmetric_under_the_whole_group(prototype):
    from sim_core.structure.symmetry import GROUP

    e = elements_of(prototype)

    def tied(ends, point_1, point_2):
        at = [e.position_m[p] + e.frame[p] @ point for p, point in zip(ends, (point_1, point_2), strict=True)]
        return np.array(at)

    ropes = [tied(*row) for row in zip(e.cable_ends, e.cable_point_1_m, e.cable_point_2_m, strict=True)]
    contacts = np.concatenate([e.position_m[j] + e.contact_point_m[5 * j : 5 * j + 5] @ e.frame[j].T for j in range(12)])
    for element in GROUP:
        images = [rope @ element.matrix.T for rope in ropes]
        for image in images:
            gap = min(min(np.abs(image - rope).max(), np.abs(image[::-1] - rope).max()) for rope in ropes)
            assert gap < 1e-12
        assert all(np.abs(contacts - point @ element.matrix.T).sum(axis=1).min() < 1e-12 for point in contacts)


def test_the_hash_follows_every_number(prototype):
    base = elements_of(prototype)
    assert base.hash == elements_of(prototype).hash
    assert replace(base, cable_rest_m=changed(base.cable_rest_m, 5, base.cable_rest_m[5] * (1 + 1e-15))).hash != base.hash
