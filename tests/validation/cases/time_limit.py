# SPDX-License-Identifier: Apache-2.0
"""The stability estimate against the step at which a run really diverges.

The estimate has every contact closed, so it may be the smaller of the two.
"""

from dataclasses import replace

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.dynamics.stability import largest_stable_step_s
from sim_core.dynamics.vibration_modes import REFERENCE_FACE
from sim_core.structure.parameters import Prototype
from tests.validation.harness.case import Case, Comparison, Setting
from tests.validation.harness.run import Run

GROWTH = 1e3
"""A run whose fastest particle gets so much faster than it was first has diverged."""
SHAKE_M_S = 1e-5
STEPS = 4000
SETTLE_S, SETTLE_ZETA_1_S = 3, 60.0


def _settled(prototype: Prototype, stroke_m: float, ground: bool) -> Run:
    """The robot at rest with all struts shortened by the stroke, floating or on its reference face."""
    model = build_model(replace(prototype, mass_damping_ratio=0.0, gravity_m_s2=prototype.gravity_m_s2 if ground else 0.0))
    run = Run(model, ground=ground, zeta_1_s=SETTLE_ZETA_1_S)
    run.state[:] = Robot.placed_on(model, REFERENCE_FACE).rows()[0]
    run.struts[:, k.REST] = run.struts[:, k.TARGET] = model.elements.strut_mid_m - stroke_m
    run.advance(SETTLE_S * model.steps_per_second)
    return run


def _diverges(settled: Run, dt_s: float, ground: bool) -> bool:
    """Shake the settled robot a little and take many steps of this length."""
    run = Run(settled.model, ground=ground, dt_s=dt_s)
    run.state[:] = settled.state
    rng = np.random.default_rng(1)
    run.v[:] = SHAKE_M_S * rng.uniform(-1.0, 1.0, run.v.shape)
    run.s[:] = 1e-3 * SHAKE_M_S * rng.uniform(-1.0, 1.0, run.s.shape)
    run.advance(STEPS)
    return not float(np.abs(run.v).max()) < GROWTH * SHAKE_M_S


def _case(setting: Setting, stroke_m: float, where: str, ground: bool = False) -> Case:
    run = _settled(setting.prototype, stroke_m, ground)
    m = run.model
    estimate = largest_stable_step_s(m.elements, m.assembly, m.par, stroke_m)
    low, high = 0.5 * estimate, 2.0 * estimate
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _diverges(run, middle, ground) else (middle, high)
    return Case(
        f"largest stable time step, {where}",
        f"Estimate of the largest stable step against the step at which a run of the robot really diverges, {where}.",
        f"bisection over runs of {STEPS} steps, shaken by {SHAKE_M_S:g} m/s; diverged: a particle {GROWTH:g} "
        "times faster than that",
        Comparison(1e6 * estimate, 1e6 * high, "µs", 0.1),
    )


def limit_at_mid_stroke(setting: Setting) -> Case:
    """As the robot is built."""
    return _case(setting, 0.0, "floating, struts at mid stroke")


def limit_at_shortest(setting: Setting) -> Case:
    """Every strut drawn in to its stop."""
    return _case(setting, setting.prototype.actuator_stroke_m, "floating, struts at their shortest")


def limit_on_the_ground(setting: Setting) -> Case:
    """The same on the ground, contacts and their dampers closed."""
    return _case(
        setting, setting.prototype.actuator_stroke_m, f"resting on {REFERENCE_FACE}, struts at their shortest", ground=True
    )
