# SPDX-License-Identifier: Apache-2.0
"""A cantilever bent far: rolled up to a circle by an end moment, and under a tip load against the elastica.

The kernel's bending strain is θ = e × a, the sine of the angle between an element's chord and its end. An element of a uniform arc
of angle α so answers with M = (EI/l) sin α instead of (EI/l) α: exact for the small angles of the robot's struts, and for large
ones once the beam is cut finely. Both cases show that.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.special import ellipeinc, ellipkinc

from sim_core.structure.arrays import Array
from sim_core.structure.parameters import Prototype
from tests.validation.harness.bodies import Section, chains, held, six_beams
from tests.validation.harness.case import Case, Comparison, Curve, Picture, Setting
from tests.validation.harness.run import Run, ready

BEAM = Section(length_m=1.0, ea_n=1e5, ei_n_m2=1.0, gj_n_m2=1.0, mass_kg=1.0, radius_m=5e-3)
"""A slender beam in round numbers: EA L²/EI is so large that it hardly stretches."""
COUNTS = (8, 10, 12, 16, 24, 32)
TIP_COUNTS = (1, 2, 4, 8, 16, 32)
LOADS = (0.5, 1.0, 2.0, 4.0, 7.0, 10.0)
"""Tip loads P L²/EI."""
DAMPING_1_S = 2.0 * 3.516
"""Near-critical in the first mode, ω₁ = 3.516 √(EI/(mL³))."""
RAMP_S, HOLD_S = 3.0, 3.5


def _bent(prototype: Prototype, counts: tuple[int, ...], loads: Array) -> list[Array]:
    """Shapes (n + 1, 2) at rest of six clamped beams under loads (6, 6) at their tips: force and moment."""
    strings = chains(counts)
    elements = held(six_beams(prototype, BEAM, counts), [string[0] for string in strings])
    run = Run(ready(prototype, elements), zeta_1_s=DAMPING_1_S)
    load = np.zeros((len(elements.mass_kg), 6))
    load[[string[-1] for string in strings]] = loads
    ramp = round(RAMP_S / run.dt_s)
    run.advance_loaded(ramp + round(HOLD_S / run.dt_s), load, ramp)
    return [run.x[string][:, :2] - run.x[string[0], :2] for string in strings]


@lru_cache(maxsize=2)
def _rolled(prototype: Prototype) -> list[Array]:
    load = np.zeros((6, 6))
    load[:, 5] = 2.0 * np.pi * BEAM.ei_n_m2 / BEAM.length_m
    return _bent(prototype, COUNTS, load)


def _order(counts: tuple[int, ...], errors: list[float]) -> float:
    """Order of convergence between the last two."""
    return float(np.log(errors[-2] / errors[-1]) / np.log(counts[-1] / counts[-2]))


def _listed(at: Sequence[float], errors: Sequence[float]) -> str:
    return ", ".join(f"{value:g}: {error:.2g}" for value, error in zip(at, errors, strict=True)) + "."


def end_moment_circle(setting: Setting) -> Case:
    """Tip of the finest beam."""
    shapes = _rolled(setting.prototype)
    errors = [float(np.linalg.norm(shape[-1])) / BEAM.length_m for shape in shapes]
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    circle = Curve("closed circle", np.sin(angle) / (2.0 * np.pi), (1.0 - np.cos(angle)) / (2.0 * np.pi))
    lines = [
        Curve(f"{n} elements", shape[:, 0], shape[:, 1], marks=True)
        for n, shape in zip(COUNTS, shapes, strict=True)
        if n in (8, 12, 32)
    ]
    return Case(
        "cantilever rolled up to a circle",
        f"Distance of the tip from the clamped end under M L/EI = 2π, {COUNTS[-1]} elements, per length.",
        "M = EI κ: the beam closes to a circle of radius L/2π",
        Comparison(errors[-1], 0.0, "1", 0.01, relative=False),
        note="By number of elements: " + _listed(COUNTS, errors),
        picture=Picture("x / L", "y / L", (circle, *lines), equal=True),
    )


def end_moment_order(setting: Setting) -> Case:
    """How fast the tip's error falls."""
    errors = [float(np.linalg.norm(shape[-1])) / BEAM.length_m for shape in _rolled(setting.prototype)]
    predicted = []
    for n in COUNTS:  # chords of α each, M l/EI = sin α, closing error of the polygon
        alpha = np.arcsin(2.0 * np.pi / n)
        predicted.append(abs(np.sin(0.5 * n * alpha) / np.sin(0.5 * alpha)) / n)
    return Case(
        "cantilever rolled up: order in the number of elements",
        f"Order with which the closing error falls from {COUNTS[-2]} to {COUNTS[-1]} elements.",
        "sin α = α (1 − α²/6): an element's angle is wrong by n⁻³, the beam's by n⁻²",
        Comparison(_order(COUNTS, errors), 2.0, "1", 0.15, relative=False),
        picture=Picture(
            "elements",
            "distance of tip from clamp / L",
            (Curve("sin α = M l/EI", COUNTS, predicted), Curve("solver", COUNTS, errors, marks=True)),
            log_x=True,
            log_y=True,
        ),
    )


def elastica(load: float) -> tuple[float, float]:
    """Tip (x, y) / L of an inextensible cantilever under a dead load P L²/EI at its tip, across the unbent beam.

    Bisshopp and Drucker, Quarterly of Applied Mathematics 3 (1945) 272: with 2k² = 1 + sin φ₀, sin φ₁ = 1/(k√2) and α² = P L²/EI,
    α = K(k) − F(k, φ₁), y/L = 1 − 2 (E(k) − E(k, φ₁))/α, x/L = √(2 sin φ₀)/α.
    """

    def integrals(k: float) -> tuple[float, float]:
        first = np.arcsin(1.0 / (k * np.sqrt(2.0)))
        m = k * k
        return ellipkinc(0.5 * np.pi, m) - ellipkinc(first, m), ellipeinc(0.5 * np.pi, m) - ellipeinc(first, m)

    low, high, alpha = np.sqrt(0.5), 1.0 - 1e-15, np.sqrt(load)
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if integrals(middle)[0] < alpha else (low, middle)
    return float(np.sqrt(2.0 * (2.0 * low**2 - 1.0)) / alpha), float(1.0 - 2.0 * integrals(low)[1] / alpha)


def elastica_tip_load(setting: Setting) -> Case:
    """Six loads, sixteen elements."""
    count = 16
    load = np.zeros((6, 6))
    load[:, 1] = LOADS
    shapes = _bent(setting.prototype, (count,) * 6, load)
    tips = [elastica(value) for value in LOADS]
    errors = [float(np.linalg.norm(shape[-1] - tip)) for shape, tip in zip(shapes, tips, strict=True)]
    lines = [
        Curve(f"P L²/EI = {value:g}", shape[:, 0], shape[:, 1]) for value, shape in zip(LOADS, shapes, strict=True) if value >= 1.0
    ]
    exact = Curve("elastica, tip", [tip[0] for tip in tips[1:]], [tip[1] for tip in tips[1:]], marks=True)
    return Case(
        "cantilever under a large tip load",
        f"Deflection of the tip, {count} elements, P L²/EI = {LOADS[-1]:g}; the note has the tip's error for every load.",
        "elastica by elliptic integrals (Bisshopp and Drucker 1945)",
        Comparison(float(shapes[-1][-1, 1]), tips[-1][1], "L", 5e-3),
        note="Error of the tip's place / L: " + _listed(LOADS, errors),
        picture=Picture("x / L", "y / L", (*lines, exact), equal=True),
    )


def elastica_order(setting: Setting) -> Case:
    """The largest load on one to 32 elements."""
    load = np.zeros((6, 6))
    load[:, 1] = LOADS[-2]
    shapes = _bent(setting.prototype, TIP_COUNTS, load)
    tip = elastica(LOADS[-2])
    errors = [float(np.linalg.norm(shape[-1] - tip)) for shape in shapes]
    second = [errors[-1] * (TIP_COUNTS[-1] / n) ** 2 for n in TIP_COUNTS]
    return Case(
        "cantilever under a large tip load: order in the number of elements",
        f"Order with which the tip's error falls from {TIP_COUNTS[-2]} to {TIP_COUNTS[-1]} elements at P L²/EI = {LOADS[-2]:g}.",
        "as for the end moment",
        Comparison(_order(TIP_COUNTS, errors), 2.0, "1", 0.15, relative=False),
        note="Error / L by number of elements: " + _listed(TIP_COUNTS, errors),
        picture=Picture(
            "elements",
            "error of the tip / L",
            (Curve("order 2", TIP_COUNTS[2:], second[2:]), Curve("solver", TIP_COUNTS, errors, marks=True)),
            log_x=True,
            log_y=True,
        ),
    )
