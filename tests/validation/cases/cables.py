# SPDX-License-Identifier: Apache-2.0
"""Ropes carry tension only; prestress is the ideal tensegrity's."""

from dataclasses import replace

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.structure.elements import elements_of
from tests.validation.harness.bodies import CLAMP, bodies
from tests.validation.harness.case import Case, Comparison, Curve, Picture, Setting
from tests.validation.harness.run import Run, ready

STRETCHES = np.array([0.02, 0.04, 0.08, 0.12, 0.16, 0.2])
"""First stretch of six ropes, per rest length."""


def cable_slackening(setting: Setting) -> Case:
    """Six masses on stretched ropes, let go."""
    p = setting.prototype
    rest, stiffness, mass = 0.5, p.tendon_stiffness_n_m, p.joint_mass_kg
    masses = np.tile([CLAMP, mass], 6)
    arm = np.array([0.01, 0.0, 0.0])
    elements = bodies(p, masses, np.full((12, 3), 1e-4), np.zeros((5, 3)))
    elements = replace(
        elements,
        gravity_m_s2=np.zeros(3),
        cable_ends=np.arange(12, dtype=np.int32).reshape(6, 2),
        cable_stiffness_n_m=np.full(6, stiffness),
        cable_rest_m=np.full(6, rest),
        cable_point_1_m=np.tile(arm, (6, 1)),
        cable_point_2_m=np.tile(-arm, (6, 1)),
    )
    omega = np.sqrt(stiffness / mass)
    # steps of a thousandth of a period
    run = Run(ready(p, elements), dt_s=2.0 * np.pi / omega / 1000.0)
    run.x[::2][:6, 0] = 0.0
    run.x[1:12:2, 1] = run.x[:12:2, 1]
    run.x[1:12:2, 0] = rest * (1.0 + STRETCHES) + 2.0 * arm[0]
    run.begin()
    quarter = 0.5 * np.pi / omega
    # until the fastest has come half way to the other end
    seconds = quarter + 0.5 / (STRETCHES[-1] * omega)
    samples = 200
    every = int(seconds / (samples - 1) / run.dt_s)
    states = run.record(samples, every)
    times = np.arange(samples) * every * run.dt_s
    gap = states[:, 1:12:2, k.X] - states[:, :12:2, k.X] - 2.0 * arm[0] - rest
    first = rest * STRETCHES
    exact = np.where(times[:, None] < quarter, first * np.cos(omega * times[:, None]), -first * omega * (times[:, None] - quarter))
    worst = np.abs(gap - exact) / first
    show = (1, 3, 5)
    lines = [Curve(f"closed form, {100 * STRETCHES[i]:g} %", times * 1e3, 1e3 * exact[:, i]) for i in show]
    dots = [Curve(f"solver, {100 * STRETCHES[i]:g} %", times[::20] * 1e3, 1e3 * gap[::20, i], marks=True) for i in show]
    return Case(
        "rope going slack",
        "A mass let go on a stretched rope swings a quarter period, then flies on free; largest error of its "
        "place, per first stretch.",
        "a cos ωt while taut (ω² = k/m), then constant speed aω",
        Comparison(float(worst.max()), 0.0, "1", 1e-3, relative=False),
        picture=Picture("time (ms)", "length − rest length (mm)", (*lines, *dots)),
    )


def self_stress_ratio(setting: Setting) -> Case:
    """The robot made ideal: pin joints, no box; let it find its own rest."""
    ideal = replace(setting.prototype, gravity_m_s2=0.0, tendon_point_radius_m=0.0, strut_elements=1)
    elements = elements_of(ideal)
    rest = elements.cable_rest_m.copy()
    rest[24:] *= 100.0
    run = Run(ready(ideal, replace(elements, cable_rest_m=rest)), zeta_1_s=60.0)
    run.advance(round(2.0 / run.dt_s))
    e = run.model.elements
    first, second = e.cable_ends[:24].T
    tension = e.cable_stiffness_n_m[:24] * (np.linalg.norm(run.x[second] - run.x[first], axis=1) - e.cable_rest_m[:24])
    return Case(
        "self-stress: strut to tendon force",
        "Ratio of strut force to tendon force of the ideal robot (pin joints, no box) after it has come to rest by itself.",
        "virtual work on l² = (d² + (L − d)² + L²)/4 at d = L/2: −√6",
        Comparison(float(run.struts[:, k.AXIAL].mean() / tension.mean()), -float(np.sqrt(6.0)), "1", 1e-9),
        note=f"Scatter between members: struts {np.ptp(run.struts[:, k.AXIAL]):.1e} N, tendons {np.ptp(tension):.1e} N.",
    )
