# SPDX-License-Identifier: Apache-2.0
"""The elements against closed forms and conservation laws."""

from dataclasses import replace

import numpy as np
import pytest

from sim_core.dynamics import vfife as k
from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.dynamics.stability import NO_GROUND, stiffness
from sim_core.structure.elements import elements_of
from sim_core.structure.rotations import matrix_of


def raised(model, height_m=1.0):
    """A robot in its ideal shape, clear of the ground."""
    robot = Robot(model)
    robot.place(np.eye(3), np.array([0.0, 0.0, height_m]))
    return robot


def element_forces(robot):
    """(P, 6) force and moment of the elements alone in the robot's present state."""
    m = robot.model
    work = np.zeros(m.assembly.particles * k.WORK_ROWS)
    k.forces(robot._state.copy(), m.par, work, m.assembly, m.dt_s, NO_GROUND)
    return work.reshape(-1, k.WORK_ROWS)[:, k.F : k.M + 3]


def elastic_energy(model, state):
    """Elastic energy by the potentials of the kernel's docstring, independently of its forces."""
    e, rows = model.elements, state[: model.layout.struts].reshape(-1, k.PARTICLE_ROWS)
    rest = state[model.layout.struts : model.layout.contacts].reshape(6, k.STRUT_ROWS)[:, k.REST]
    x, r = rows[:, k.X : k.X + 3], matrix_of(rows[:, k.Q : k.Q + 4])
    total = 0.0
    for b, (p1, p2) in enumerate(e.beam_ends):
        l0 = rest[e.beam_strut[b]] * e.beam_share[b]
        chord = x[p2] - x[p1]
        length = np.linalg.norm(chord)
        t1, t2 = (np.cross(chord / length, r[p][:, 0]) for p in (p1, p2))
        twist = 0.5 * (r[p2][:, 1] @ r[p1][:, 2] - r[p2][:, 2] @ r[p1][:, 1])
        total += 0.5 * e.beam_ea_n[b] / l0 * (length - l0) ** 2
        total += 2.0 * e.beam_ei_n_m2[b] / l0 * (t1 @ t1 + t1 @ t2 + t2 @ t2) + 0.5 * e.beam_gj_n_m2[b] / l0 * twist**2
    for c, (p1, p2) in enumerate(e.cable_ends):
        gap = x[p2] + r[p2] @ e.cable_point_2_m[c] - x[p1] - r[p1] @ e.cable_point_1_m[c]
        total += 0.5 * e.cable_stiffness_n_m[c] * max(0.0, np.linalg.norm(gap) - e.cable_rest_m[c]) ** 2
    return total


def shaken(model, seed, size):
    """A robot off the ground with every particle displaced and turned at random."""
    robot, rng = raised(model), np.random.default_rng(seed)
    rows = robot._particles
    rows[:, k.X : k.X + 3] += size * 0.234 * rng.uniform(-1, 1, (len(rows), 3))
    rows[:, k.Q : k.Q + 4] += size * rng.uniform(-1, 1, (len(rows), 4))
    rows[:, k.Q : k.Q + 4] /= np.linalg.norm(rows[:, k.Q : k.Q + 4], axis=1, keepdims=True)
    return robot


@pytest.mark.parametrize("elements", [1, 3])
def test_forces_are_the_exact_derivatives_of_the_elastic_energy(prototype, elements):
    model = build_model(replace(prototype, gravity_m_s2=0.0, strut_elements=elements, steps_per_second=20_000))
    robot = shaken(model, 1, 0.05)
    computed = element_forces(robot)
    h = 1e-6
    for p in (0, 3, 12, len(computed) - 1):
        for axis in range(6):
            energies = []
            for sign in (1.0, -1.0):
                moved = robot._state.copy()
                row = p * k.PARTICLE_ROWS
                if axis < 3:
                    moved[row + axis] += sign * h
                else:
                    spin = np.eye(3)[axis - 3]
                    moved[row + k.Q : row + k.Q + 4] = k.turned(*moved[row + k.Q : row + k.Q + 4], *spin, sign * h / 2)
                energies.append(elastic_energy(model, moved))
            assert computed[p, axis] == pytest.approx(-(energies[0] - energies[1]) / (2 * h), abs=2e-6, rel=1e-6)


def test_internal_forces_have_no_resultant(floating):
    robot = shaken(floating, 2, 0.1)
    pushes, x = element_forces(robot), robot._particles[:, k.X : k.X + 3]
    assert np.allclose(pushes[:, :3].sum(axis=0), 0.0, atol=1e-10)
    assert np.allclose((np.cross(x, pushes[:, :3]) + pushes[:, 3:]).sum(axis=0), 0.0, atol=1e-10)


def without_ropes(prototype):
    """The struts alone: every rope is twice too long."""
    elements = elements_of(prototype)
    return build_model(prototype, replace(elements, cable_rest_m=elements.cable_rest_m * 2.0), allow_slack=True)


def test_a_bent_strut_answers_with_4ei_and_2ei_over_l(prototype):
    robot, angle = raised(without_ropes(prototype)), 1e-4
    row = robot._particles[0]
    axis = matrix_of(row[k.Q : k.Q + 4])[:, 1]
    row[k.Q : k.Q + 4] = k.turned(*row[k.Q : k.Q + 4], *axis, angle / 2)
    moments = element_forces(robot)[:, 3:]
    ei_l = prototype.strut_bending_stiffness_n_m2 / prototype.strut_length_m
    assert moments[0] @ axis == pytest.approx(-4 * ei_l * angle, rel=1e-6)
    assert moments[1] @ axis == pytest.approx(-2 * ei_l * angle, rel=1e-6)


def test_strut_and_tendon_forces_of_self_stress_are_minus_root_six_to_one(prototype):
    """Pin joints, no box ropes to speak of: the ideal tensegrity."""
    ideal = replace(
        prototype, gravity_m_s2=0.0, tendon_point_radius_m=0.0, box_rope_stiffness_n_m=1.0, strut_axial_stiffness_n_m=1e7,
        steps_per_second=40_000,
    )  # fmt: skip
    elements = elements_of(ideal)
    rest = elements.cable_rest_m.copy()
    rest[24:] *= 100.0
    robot = raised(build_model(ideal, replace(elements, cable_rest_m=rest), allow_slack=True))
    forces = element_forces(robot)
    tendon = robot.cable_forces_n()[:24]
    assert np.ptp(tendon) < 1e-9
    pull = -forces[0, :3] @ (robot.joints_m()[1] - robot.joints_m()[0]) / 0.234
    assert pull / tendon[0] == pytest.approx(-np.sqrt(6.0), rel=1e-9)


def test_a_slack_cable_carries_nothing(prototype):
    slack = without_ropes(prototype)
    assert not raised(slack).cable_forces_n().any()
    assert np.allclose(element_forces(raised(slack))[:, :3], slack.elements.mass_kg[:, None] * slack.elements.gravity_m_s2)


def test_a_free_body_keeps_momentum_angular_momentum_and_energy(prototype):
    tumbling = build_model(
        replace(
            prototype, mass_damping_ratio=0.0, gravity_m_s2=0.0, steps_per_second=2000,
            box_inertia_kg_m2=(1.0e-4, 1.4e-4, 2.0e-4), joint_inertia_kg_m2=(2.4e-5, 2.9e-5, 3.8e-5),
        )
    )  # fmt: skip
    robot = raised(tumbling)
    rows, rng = robot._particles, np.random.default_rng(3)
    spin = np.array([1.0, -2.0, 3.0])
    mass, inertia = tumbling.elements.mass_kg, tumbling.elements.inertia_kg_m2
    centre = robot.center_of_mass_m()
    rows[:, k.V : k.V + 3] = np.array([0.3, -0.2, 0.1]) + np.cross(spin, rows[:, k.X : k.X + 3] - centre)
    rows[:, k.V : k.V + 3] += 0.02 * rng.uniform(-1, 1, (len(rows), 3))
    frames = matrix_of(rows[:, k.Q : k.Q + 4])
    rows[:, k.S : k.S + 3] = np.einsum("nij,nj,nkj,k->ni", frames, inertia, frames, spin)

    def measures():
        # momenta at the half step, positions at the whole steps on either side: angular momentum uses their middle
        before = rows[:, k.X : k.X + 3].copy()
        robot.advance(1)
        middle = 0.5 * (before + rows[:, k.X : k.X + 3])
        momentum = mass[:, None] * rows[:, k.V : k.V + 3]
        angular = (np.cross(middle, momentum) + rows[:, k.S : k.S + 3]).sum(axis=0)
        frames = matrix_of(rows[:, k.Q : k.Q + 4])
        body = np.einsum("nji,nj->ni", frames, rows[:, k.S : k.S + 3])
        kinetic = 0.5 * (mass[:, None] * rows[:, k.V : k.V + 3] ** 2).sum() + 0.5 * (body**2 / inertia).sum()
        return momentum.sum(axis=0), angular, kinetic + elastic_energy(tumbling, robot._state)

    momentum, angular, energy = measures()
    lowest, highest = energy, energy
    for _ in range(40):
        robot.advance(1499)
        later = measures()
        assert np.allclose(later[0], momentum, rtol=1e-9, atol=1e-10)
        assert np.allclose(later[1], angular, rtol=1e-9, atol=1e-10)
        lowest, highest = min(lowest, later[2]), max(highest, later[2])
    assert highest - lowest < 0.02 * energy


def test_a_dropped_robot_falls_half_g_t_squared(undamped):
    robot = raised(undamped, 10.0)
    steps = undamped.steps_per_second
    start = robot.center_of_mass_m()
    # leapfrog started with v(−Δt/2) = 0 is exact for constant force up to that half step
    robot.advance(steps)
    fallen = start[2] - robot.center_of_mass_m()[2]
    assert fallen == pytest.approx(0.5 * 9.81 * (1 + undamped.dt_s), rel=1e-9)


def test_mass_damping_brings_a_fall_to_g_over_zeta(model):
    robot = raised(model, 100.0)
    robot.advance(6 * model.steps_per_second)
    assert robot._particles[:, k.V + 2].mean() == pytest.approx(-9.81 / model.elements.zeta_1_s, rel=1e-6)


def test_a_strut_moves_at_its_speed_to_its_target_and_stops_there(model):
    robot = raised(model, 1000.0)
    robot.set_targets(np.array([0.234 + d for d in (0.03, -0.03, 0.015, 0.0, 0.001, -0.0075)]))
    robot.advance(model.steps_per_second)
    assert np.allclose(robot.rest_lengths_m() - 0.234, [0.015, -0.015, 0.015, 0.0, 0.001, -0.0075], atol=1e-12)
    robot.advance(2 * model.steps_per_second)
    assert np.array_equal(robot.rest_lengths_m(), robot.targets_m())


def test_resting_robots_stick_on_a_slope_below_the_friction_angle_and_slide_above(prototype):
    def creep(tilt_rad):
        model = build_model(replace(prototype, ground_slope_rad=(0.0, tilt_rad)))
        robot = Robot.resting_on(model, "TC6")
        robot.advance(model.steps_per_second)
        start = robot.center_of_mass_m()
        robot.advance(2 * model.steps_per_second)
        return np.linalg.norm(robot.center_of_mass_m() - start)

    assert creep(0.25) < 1e-6
    assert creep(np.arctan(0.6) + 0.1) > 0.05


def test_stiffness_of_the_unloaded_body_is_symmetric_with_six_rigid_motions(prototype):
    elements = elements_of(replace(prototype, gravity_m_s2=0.0))
    model = build_model(prototype, replace(elements, cable_rest_m=elements.cable_rest_m * 1.2), allow_slack=True)
    robot = raised(model)
    matrix = stiffness(robot._state, model.par, model.assembly)
    assert np.allclose(matrix, matrix.T, atol=1e-3 * np.abs(matrix).max())
