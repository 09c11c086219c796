# SPDX-License-Identifier: Apache-2.0
"""Ground contact and friction, on separate bodies."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.structure.arrays import Array
from sim_core.structure.elements import Elements
from sim_core.structure.parameters import Prototype
from sim_core.structure.topology import POINTS_PER_JOINT
from tests.validation.harness.bodies import bodies
from tests.validation.harness.case import Case, Comparison, Curve, Picture, Setting
from tests.validation.harness.run import Run

HALF_M, HEIGHT_M = 0.03, 0.005
"""Half side of the block's square sole, and its centre of mass above it."""
SPEEDS_M_S = np.linspace(0.2, 1.3, 12)
SHARES = np.array([0.8, 0.9, 0.95, 0.98, 0.99, 0.999, 1.001, 1.01, 1.02, 1.05, 1.1, 1.2])
"""Slopes of twelve blocks: tan(slope) / μ_s."""
JUST_BELOW, JUST_ABOVE = 5, 6
TILT_S, SETTLE_S, WATCH_S = 4.0, 2.0, 10.0
RATIOS = np.linspace(0.05, 0.6, 12)
"""Damping ratios c/(2 √(k m)) of twelve balls."""
DROP_M_S = 0.3
FINE_STEPS_PER_S = 400_000
BLOCK_FINER = 4


def _node_mass(prototype: Prototype) -> float:
    return prototype.joint_mass_kg + 0.5 * prototype.actuator_mass_kg


def _blocks(prototype: Prototype, height_m: float) -> Elements:
    """Twelve blocks of a joint's mass on five points: a square's corners and its middle.

    Five springs and dampers under so light a block, which a joint never has, need a finer step than the robot.
    """
    sole = [(HALF_M * a, HALF_M * b, -height_m) for a in (-1, 1) for b in (-1, 1)] + [(0.0, 0.0, -height_m)]
    mass = _node_mass(prototype)
    flat = mass * HALF_M**2 / 3.0
    elements = bodies(prototype, np.full(12, mass), np.tile([flat, flat, 2.0 * flat], (12, 1)), np.array(sole))
    return replace(elements, steps_per_second=BLOCK_FINER * prototype.steps_per_second)


def _settled(elements: Elements, weight_n: Array, height_m: float) -> Array:
    """Heights at which five springs carry the weights."""
    return np.asarray(height_m - weight_n / (POINTS_PER_JOINT * elements.ground_stiffness_n_m[0]))


def block_sliding_to_rest(setting: Setting) -> Case:
    """Twelve speeds in one run."""
    p = setting.prototype
    elements = _blocks(p, HEIGHT_M)
    run = Run(build_model(replace(p, strut_elements=1), elements, allow_slack=True), ground=True)
    weight = elements.mass_kg[:12] * p.gravity_m_s2
    run.x[:12, 2] = _settled(elements, weight, HEIGHT_M)
    run.v[:12, 0] = SPEEDS_M_S
    run.begin()
    run.advance(round(1.0 / run.dt_s))
    way = run.x[:12, 0]
    exact = SPEEDS_M_S**2 / (2.0 * p.friction_kinetic * p.gravity_m_s2)
    worst = int(np.argmax(np.abs(way / exact - 1.0)))
    return Case(
        "block sliding to rest",
        f"Way of a block that slides to rest, twelve speeds from {SPEEDS_M_S[0]:g} to {SPEEDS_M_S[-1]:g} m/s; the worst is shown.",
        "v²/(2 μ_k g)",
        Comparison(float(way[worst]), float(exact[worst]), "m", 5e-3),
        picture=Picture(
            "speed (m/s)", "way (m)", (Curve("v²/(2 μ_k g)", SPEEDS_M_S, exact), Curve("solver", SPEEDS_M_S, way, marks=True))
        ),
    )


@lru_cache(maxsize=2)
def _slopes(prototype: Prototype) -> tuple[Array, Array, Array]:
    """Twelve slopes, tilted slowly; times, ways of a block down each slope (samples, 12) from then on, final speeds."""
    runs = [_tilted(prototype, angle) for angle in np.arctan(SHARES * prototype.friction_static)]
    every = round(0.1 / runs[0].dt_s)
    states = np.stack([run.record(round(WATCH_S / (every * run.dt_s)) + 1, every)[:, 0] for run in runs], axis=1)
    ways = states[:, :, k.X] - states[0, :, k.X]
    return every * runs[0].dt_s * np.arange(len(ways), dtype=float), ways, states[-1, :, k.V]


def _tilted(prototype: Prototype, angle: float) -> Run:
    """Blocks on level ground that is tilted slowly to an angle, and then left to settle."""
    elements = _blocks(prototype, 0.0)
    run = Run(build_model(replace(prototype, strut_elements=1), elements, allow_slack=True), ground=True)
    run.x[:12, 2] = _settled(elements, elements.mass_kg[:12] * prototype.gravity_m_s2, 0.0)
    chunk = 10
    ramp = round(TILT_S / run.dt_s / chunk)
    for n in range(ramp):
        now = angle * (n + 1) / ramp
        run.gravity[:] = prototype.gravity_m_s2 * np.array([np.sin(now), 0.0, -np.cos(now)])
        run.advance(chunk)
    run.advance(round(SETTLE_S / run.dt_s))
    return run


def slope_below_friction_angle(setting: Setting) -> Case:
    """No creep."""
    _, ways, _ = _slopes(setting.prototype)
    return Case(
        "block on a slope below the friction angle",
        f"Creep in {WATCH_S:g} s of a block on a slope of tan = {SHARES[JUST_BELOW]:g} μ_s, slowly tilted to it and settled.",
        "Coulomb: at rest while tan(slope) < μ_s",
        Comparison(float(np.abs(ways[:, : JUST_BELOW + 1]).max()), 0.0, "m", 1e-6, relative=False),
        note=f"The largest of six blocks, {SHARES[0]:g} to {SHARES[JUST_BELOW]:g} μ_s; mass in the plane of the "
        "sole, so that its points share the load.",
    )


def slope_above_friction_angle(setting: Setting) -> Case:
    """It slides, with the acceleration of sliding friction."""
    p = setting.prototype
    times, ways, speeds = _slopes(p)

    def law(share: Array) -> Array:
        angle = np.arctan(share * p.friction_static)
        return np.asarray(p.gravity_m_s2 * (np.sin(angle) - p.friction_kinetic * np.cos(angle)))

    exact, middle = law(SHARES), len(times) // 2
    measured = (ways[2 * middle] - 2.0 * ways[middle] + ways[0]) / times[middle] ** 2
    line = np.linspace(1.0, SHARES[-1], 30)
    return Case(
        "block on a slope above the friction angle",
        f"Acceleration of a block on a slope of tan = {SHARES[JUST_ABOVE]:g} μ_s.",
        "g (sin φ − μ_k cos φ)",
        Comparison(float(measured[JUST_ABOVE]), float(exact[JUST_ABOVE]), "m/s²", 1e-3),
        note=f"Every block from {SHARES[JUST_ABOVE]:g} μ_s on slides: the slowest does "
        f"{speeds[JUST_ABOVE:].min():.1f} m/s at the end.",
        picture=Picture(
            "tan(slope) / μ_s",
            "acceleration down the slope (m/s²)",
            (
                Curve("Coulomb", [SHARES[0], 1.0, *line], [0.0, 0.0, *law(line)]),
                Curve("solver", SHARES, measured, marks=True),
            ),
        ),
    )


def robot_on_slope(setting: Setting) -> Case:
    """The robot itself, on a closed triangle."""
    p = setting.prototype
    slope = np.deg2rad(15.0)
    robot = Robot.resting_on(build_model(replace(p, ground_slope_rad=(0.0, float(slope)))), "TC6")
    robot.advance(round(SETTLE_S * p.steps_per_second))
    start = robot.joints_m()
    robot.advance(round(WATCH_S * p.steps_per_second))
    return Case(
        "robot resting on a slope",
        f"Creep of the robot's joints in {WATCH_S:g} s on TC6 on a slope of 15°, after settling.",
        "Coulomb: at rest while tan(slope) < μ_s (mass damping on: this is a rest)",
        Comparison(float(np.linalg.norm(robot.joints_m() - start, axis=1).max()), 0.0, "m", 1e-6, relative=False),
    )


def restitution(ratio: Array) -> Array:
    """Restitution e of a linear spring and damper whose force is clipped at zero, by the damping ratio."""
    # with ω₀ = 1: β = ratio, ω_d² = 1 − β²; the angle is in (0, π)
    damped = np.sqrt(1.0 - ratio**2)
    return np.asarray(np.exp(-ratio / damped * (np.pi - np.arctan2(2.0 * ratio * damped, damped**2 - ratio**2))))


def _rebounds(prototype: Prototype, steps_per_second: int, ratios: Array, heights_m: Array) -> Array:
    """Rebound / approach speed of twelve balls without gravity, let go at these heights; the ratio is made with the mass."""
    stiffness = prototype.contact_stiffness_n_m
    damping = 2.0 * prototype.contact_damping_ratio * np.sqrt(stiffness * _node_mass(prototype))
    mass = damping**2 / (4.0 * stiffness * ratios**2)
    points = np.array([[0.0, 0.0, 0.0]] + [[0.0, 0.0, 0.05]] * 4)
    elements = bodies(prototype, mass, np.full((12, 3), 1e-4), points)
    elements = replace(elements, gravity_m_s2=np.zeros(3), steps_per_second=steps_per_second)
    run = Run(build_model(replace(prototype, strut_elements=1), elements, allow_slack=True), ground=True)
    run.x[:12, 2] = heights_m
    run.v[:12, 2] = -DROP_M_S
    # the slowest ball is through after half a period of its undamped spring
    run.advance(round((heights_m.max() / DROP_M_S + 1.2 * np.pi * np.sqrt(mass.max() / stiffness)) / run.dt_s))
    return np.asarray(run.v[:12, 2] / DROP_M_S)


def restitution_law(setting: Setting) -> Case:
    """Twelve damping ratios at a fine step."""
    measured, exact = _rebounds(setting.prototype, FINE_STEPS_PER_S, RATIOS, np.full(12, 1e-5)), restitution(RATIOS)
    worst = int(np.argmax(np.abs(measured / exact - 1.0)))
    fine = np.linspace(0.01, 0.65, 60)
    textbook = np.exp(-np.pi * fine / np.sqrt(1.0 - fine**2))
    return Case(
        "restitution of a damped contact",
        f"Coefficient of restitution for damping ratios {RATIOS[0]:g} to {RATIOS[-1]:g}; the worst (ratio "
        f"{RATIOS[worst]:.2f}) is shown.",
        "e = exp[−(β/ω_d)(π − atan(2βω_d/(ω_d² − β²)))], β = c/2m, ω_d² = k/m − β²: force clipped at zero",
        Comparison(float(measured[worst]), float(exact[worst]), "1", 2e-3),
        picture=Picture(
            "damping ratio",
            "coefficient of restitution",
            (
                Curve("force clipped at zero", fine, restitution(fine)),
                Curve("unclipped: exp(−πβ/ω_d)", fine, textbook),
                Curve("solver", RATIOS, measured, marks=True),
            ),
        ),
    )


def restitution_at_own_step(setting: Setting) -> Case:
    """The robot's own time step: twelve balls that meet the ground at different moments within a step."""
    p = setting.prototype
    heights = (1.0 + np.arange(12) / 12.0) * DROP_M_S / p.steps_per_second
    own = _rebounds(p, p.steps_per_second, np.full(12, 0.3), heights)
    return Case(
        "restitution at the robot's own time step",
        "Coefficient of restitution at damping ratio 0.3 with the robot's own step; mean of twelve moments "
        "of impact within a step.",
        "the same formula (0.451; the unclipped textbook value is 0.372)",
        Comparison(float(own.mean()), float(restitution(np.array(0.3))), "1", 0.05),
        note=f"Single impacts: {own.min():.3f} to {own.max():.3f}.",
    )
