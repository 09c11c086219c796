# SPDX-License-Identifier: Apache-2.0
"""Motion against solutions that share nothing with the kernel, and the order with which the time step approaches them."""

from functools import lru_cache

import numpy as np
from scipy.integrate import solve_ivp

from sim_core.dynamics import vfife as k
from sim_core.structure.arrays import Array
from sim_core.structure.rotations import matrix_of
from tests.validation.cases.free_body import OWN_SPIN_RAD_S, tumbling
from tests.validation.harness.bodies import bodies
from tests.validation.harness.case import Case, Comparison, Curve, Picture, Setting
from tests.validation.harness.reference import motion
from tests.validation.harness.run import Run, ready

STEPS = (200, 400, 800, 1600)
ROBOT_S = 0.01
TOP_INERTIA = np.array([1.0e-5, 2.0e-5, 2.7e-5])
TOP_SPIN_RAD_S = np.array([0.5, 20.0, 1.0])
TOP_S = 0.5


def _order(steps: tuple[int, ...], errors: list[float]) -> float:
    """Slope of log error over log step, all points."""
    return float(-np.polyfit(np.log(steps), np.log(errors), 1)[0])


def _picture(seconds: float, errors: list[float], label: str) -> Picture:
    steps = [seconds / n for n in STEPS]
    second = [errors[-1] * (step / steps[-1]) ** 2 for step in steps]
    return Picture(
        "time step (s)", label, (Curve("order 2", steps, second), Curve("solver", steps, errors, marks=True)), True, True
    )


@lru_cache(maxsize=2)
def _against_exact_motion(setting: Setting) -> tuple[list[float], list[float]]:
    """Errors of positions (m) and rotation matrices of the whole robot for every number of steps.

    It tumbles and shakes, and every particle spins by itself, so that struts bend, stretch and twist.
    """
    start = tumbling(setting.prototype, own_spin_rad_s=OWN_SPIN_RAD_S)
    e = start.model.elements
    v, s, pushes = start.v.copy(), start.s.copy(), start.pushes()
    v += 0.5 * start.particles_par[:, k.DT_M, None] * pushes[:, :3]
    s += 0.5 * start.dt_s * pushes[:, 3:]
    exact, turned = motion(e, e.strut_mid_m, (start.x.copy(), v, start.frames(), s), ROBOT_S)
    errors, angles = [], []
    for steps in STEPS:
        run = Run(start.model, dt_s=ROBOT_S / steps)
        run.v[:], run.s[:] = v, s
        run.begin()
        run.advance(steps)
        errors.append(float(np.abs(run.x - exact).max()))
        angles.append(float(np.abs(run.frames() - turned).max()))
    return errors, angles


def robot_motion(setting: Setting) -> Case:
    """The finest step."""
    errors, angles = _against_exact_motion(setting)
    return Case(
        "motion of the whole robot",
        f"Largest error of a rotation matrix of the floating, shaking robot after {ROBOT_S:g} s in {STEPS[-1]} steps.",
        "forces by complex-step derivatives of the energy, motion by DOP853 at 10⁻¹⁰",
        Comparison(angles[-1], 0.0, "1", 2e-5, relative=False),
        note=f"Largest error of a position: {errors[-1]:.1e} m.",
    )


def robot_order(setting: Setting) -> Case:
    """The step halved thrice."""
    errors, angles = _against_exact_motion(setting)
    return Case(
        "order of the time step: whole robot",
        f"Order with which the floating robot's positions after {ROBOT_S:g} s approach the exact motion as "
        "the step is halved thrice.",
        "as before; 2 is the central difference's order",
        Comparison(_order(STEPS, errors), 2.0, "1", 0.1, relative=False),
        note=f"Order of the rotations: {_order(STEPS, angles):.2f}.",
        picture=_picture(ROBOT_S, errors, "largest error of a particle (m)"),
    )


def euler_top(seconds: float) -> Array:
    """Rotation matrix of the free asymmetric top: Euler's equations in body axes with the quaternion, DOP853 at 10⁻¹³."""

    def rates(_: float, y: Array) -> Array:
        w, q = y[:3], y[3:]
        turning = -np.cross(w, TOP_INERTIA * w) / TOP_INERTIA
        return np.concatenate([turning, 0.5 * np.array([-q[1:] @ w, *(q[0] * w + np.cross(q[1:], w))])])

    begin = np.concatenate([TOP_SPIN_RAD_S, [1.0, 0.0, 0.0, 0.0]])
    q = solve_ivp(rates, (0.0, seconds), begin, method="DOP853", rtol=1e-13, atol=1e-14, t_eval=[seconds]).y[3:, -1]
    return np.asarray(matrix_of(q / np.linalg.norm(q)))


def top_order(setting: Setting) -> Case:
    """An asymmetric top near its unstable axis."""
    model = ready(setting.prototype, bodies(setting.prototype, np.ones(12), np.tile(TOP_INERTIA, (12, 1)), np.zeros((5, 3))))
    exact, errors = euler_top(TOP_S), []
    for steps in STEPS:
        run = Run(model, dt_s=TOP_S / steps)
        run.s[:12] = TOP_INERTIA * TOP_SPIN_RAD_S
        run.begin()
        run.advance(steps)
        errors.append(float(np.abs(run.frames()[0] - exact).max()))
    return Case(
        "order of the time step: asymmetric top",
        f"Order with which the attitude of a free top spun about its middle axis after {TOP_S:g} s approaches Euler's equations.",
        "I ω̇ = −ω × I ω in body axes, DOP853 at 10⁻¹³",
        Comparison(_order(STEPS, errors), 2.0, "1", 0.1, relative=False),
        note=f"Error of the rotation matrix at the finest step: {errors[-1]:.1e}.",
        picture=_picture(TOP_S, errors, "largest error of the rotation matrix"),
    )
