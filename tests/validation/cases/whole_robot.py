# SPDX-License-Identifier: Apache-2.0
"""The robot as a whole: its first frequency, elements per strut, symmetry, and equal bits in every lane."""

from dataclasses import replace

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.dynamics.simd import WIDTH
from sim_core.dynamics.vibration_modes import REFERENCE_FACE, first_frequency_hz, resting_modes, vibrated_frequency_hz
from sim_core.gaits.library import load_library
from sim_core.rolling.batch import aligned_rows
from sim_core.structure.elements import elements_of
from sim_core.structure.parameters import Prototype
from sim_core.structure.policy import lengths_of
from sim_core.structure.symmetry import GROUP, REFERENCE_TC, REFERENCE_TO
from sim_core.structure.topology import FACES, JOINTS
from sim_core.uncertainty.perturbation_law import perturb
from tests.validation.harness.case import Case, Comparison, Curve, Picture, Setting
from tests.validation.harness.run import ready

PAPER_HZ = 4.53
COUNTS = (1, 2, 4, 8)
LINE = np.linspace(1.0, 8.0, 60)
LOOK_S = 0.01
LANES_S = 1.0
REST_S = 6.0


def frequency_by_eigenvalues(setting: Setting) -> Case:
    """Linearised."""
    model = build_model(setting.prototype)
    return Case(
        "first frequency by eigenvalues",
        f"Lowest natural frequency of the robot at rest on {REFERENCE_FACE}, feet sticking, linearised.",
        "the paper's 4.53 Hz, to which the ropes are calibrated",
        Comparison(first_frequency_hz(model), PAPER_HZ, "Hz", 1e-3),
    )


def frequency_by_spectrum(setting: Setting) -> Case:
    """From a simulated free vibration."""
    model = build_model(setting.prototype)
    return Case(
        "first frequency by spectrum",
        f"Peak of the spectrum of a simulated free vibration on {REFERENCE_FACE}, ζ = 0.",
        "the same",
        Comparison(vibrated_frequency_hz(model), PAPER_HZ, "Hz", 5e-3),
    )


def _frequency_with(prototype: Prototype, count: int) -> tuple[float, float]:
    """First frequency with so many elements per strut, and a strut's lumped inertia across its axis / mL²/12.

    The rest does not depend on the inner particles' own inertia; for the vibration it is made next to nothing, as a slender
    strut's is.
    """
    fine = replace(prototype, strut_elements=count)
    # smooth ground has one rest; with friction it would depend a little on the way there
    smooth = replace(elements_of(fine), friction=np.zeros(2))
    robot = Robot.resting_on(ready(fine, smooth), REFERENCE_FACE)
    e = robot.model.elements
    inertia = e.inertia_kg_m2.copy()
    inertia[JOINTS:-1] *= 1e-3
    e = replace(e, inertia_kg_m2=inertia)
    robot.model = replace(robot.model, elements=e)
    chain = np.unique(e.beam_ends[e.beam_strut == 0])
    mass = e.mass_kg[chain] - prototype.joint_mass_kg * (chain < JOINTS)
    arm = np.linalg.norm(e.position_m[chain] - e.position_m[chain].mean(axis=0), axis=1)
    whole = prototype.actuator_mass_kg * prototype.strut_length_m**2 / 12.0
    return float(resting_modes(robot).frequency_hz[0]), float((mass * arm**2).sum() / whole)


def elements_per_strut(setting: Setting) -> Case:
    """One, two, four, eight."""
    found = [_frequency_with(setting.prototype, count) for count in COUNTS]
    f = np.array([frequency for frequency, _ in found])
    steps = -np.diff(f**-2.0)
    limit = (f[-1] ** -2.0 - steps[-1] / 3.0) ** -0.5
    return Case(
        "elements per strut",
        "Order with which 1/f², f the robot's first frequency, converges from 2 to 4 to 8 elements per strut.",
        "1/f² goes with the inertia, and a strut of n lumped elements has (mL²/12)(1 + 2/n²), three times the rod's for n = 1",
        Comparison(float(np.log2(steps[1] / steps[2])), 2.0, "1", 0.15, relative=False),
        note="First frequency by elements per strut, on smooth ground: "
        + ", ".join(f"{n}: {value:.4f} Hz" for n, value in zip(COUNTS, f, strict=True))
        + f"; extrapolated {limit:.4f} Hz. Lumped inertia / (mL²/12): "
        + ", ".join(f"{n}: {ratio:.4f}" for n, (_, ratio) in zip(COUNTS, found, strict=True))
        + ". One element, as in the paper, makes the struts sluggish; calibration to 4.53 Hz puts that into the ropes.",
        picture=Picture(
            "elements per strut",
            "first frequency (Hz)",
            (
                Curve("limit, extrapolated", COUNTS, np.full(len(COUNTS), limit)),
                Curve("1/f² = a + b/n² through n = 4 and 8", LINE, (limit**-2.0 + 64.0 * steps[-1] / 3.0 * LINE**-2.0) ** -0.5),
                Curve("solver", COUNTS, f, marks=True),
            ),
        ),
    )


def equivariance(setting: Setting) -> Case:
    """All 24 gaits of one primitive, rolled side by side until the first one tips."""
    model = build_model(setting.prototype)
    policy = load_library("robust").gaits(REFERENCE_TC, REFERENCE_TO)[0].policy
    robots, carry = [], []
    home = Robot.placed_on(model, REFERENCE_TC).body_pose()[1]
    for g in GROUP:
        source = g.face(REFERENCE_TC)
        robot = Robot.resting_on(model, source)
        robot.set_targets(lengths_of(model.prototype, g.relabel(policy)))
        robots.append(robot)
        carry.append(Robot.placed_on(model, source).body_pose()[1] @ g.matrix @ home.T)
    reference, chunk = robots[0], round(LOOK_S / model.dt_s)
    times, worst, apart = [], [], 0.0
    while reference.footing().face == REFERENCE_TC and reference.step * model.dt_s < 10.0:
        home_m = np.vstack([reference.joints_m(), reference.box_m()])
        now = 0.0
        for g, q, robot in zip(GROUP, carry, robots, strict=True):
            carried = home_m @ q.T
            here = np.vstack([robot.joints_m()[list(g.nodes)], robot.box_m()])
            now = max(now, float(np.abs(here - carried).max()) / model.prototype.strut_length_m)
        apart = max(apart, now)
        times.append(reference.step * model.dt_s)
        worst.append(max(now, 1e-18))
        for robot in robots:
            robot.advance(chunk)
    landed = ""
    if setting.full:  # let every copy finish its actuation and see where it stands
        for robot in robots:
            robot.advance(round(REST_S / model.dt_s))
        end = reference.footing().face
        same = all(robot.footing().face == (g.face(end) if end else None) for g, robot in zip(GROUP, robots, strict=True))
        landed = (
            f"{REST_S:g} s later {'all 24 stand' if same else 'not all stand'} on the face that carries over from the reference's."
        )
    return Case(
        "the 24 gaits of a primitive are one motion",
        "Largest difference, per L, between a gait's motion and the reference's carried over, until the "
        f"first tip at {times[-1]:.2f} s.",
        "x′ = Q x + t, Q the isometry that keeps the vertical; the group T_h has 24 elements, 12 of them reflections",
        Comparison(apart, 0.0, "L", 1e-9, relative=False),
        note=landed,
        picture=Picture("time (s)", "largest difference / L", (Curve("24 gaits", times, worst),), log_y=True),
    )


def lanes(setting: Setting) -> Case:
    """Eight different robots in the lanes of the vector unit, and each alone."""
    nominal = build_model(setting.prototype)
    models = [nominal] + [perturb(nominal, 0.1, seed) for seed in range(1, WIDTH)]
    faces = list(FACES)
    robots = [Robot.placed_on(model, faces[2 * lane]) for lane, model in enumerate(models)]
    rng = np.random.default_rng(7)
    for robot in robots:
        robot.set_targets(robot.rest_lengths_m() + rng.uniform(-0.03, 0.03, 6))
    lay, particles = nominal.layout, nominal.assembly.particles
    state, par, work = (aligned_rows(rows) for rows in (lay.state_rows, lay.par_rows, particles * k.WORK_ROWS))
    for lane, robot in enumerate(robots):
        state[:, lane], work[:, lane] = robot.rows()
        par[:, lane] = robot.model.par
    steps = round(LANES_S / nominal.dt_s)
    reach = max(model.reach_m for model in models)
    k.advance(state, par, work, nominal.assembly, nominal.dt_s, nominal.elements.zeta_1_s, reach, steps)
    different = 0
    for lane, robot in enumerate(robots):
        robot.advance(steps)
        alone = robot.rows()[0].view(np.uint64)
        different += int((alone != np.ascontiguousarray(state[:, lane]).view(np.uint64)).sum())
    return Case(
        "a robot alone and in a lane: the same bits",
        f"Numbers of eight robots' states, of {WIDTH * lay.state_rows}, that differ between a run in eight "
        f"lanes and runs alone, {steps} steps.",
        "equality",
        Comparison(float(different), 0.0, "1", 0.0, relative=False),
        note="Eight perturbed robots, put down on eight faces, settling while their struts move.",
    )
