# SPDX-License-Identifier: Apache-2.0
"""Small vibrations of a strut of n elements: against the lumped chain's closed forms, and their limit, the continuous beam."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.structure.arrays import Array
from sim_core.structure.parameters import Prototype
from sim_core.validation.harness.case import Case, Curve, Picture, Setting, curve
from sim_core.validation.harness.run import Run, angular_frequency, ready
from sim_core.validation.harness.test_bodies import Section, chains, held, six_beams, strut_section

COUNTS = (2, 3, 4, 6, 8, 16)
BAR_COUNTS = (1, 2, 3, 4, 6, 8)
AMPLITUDE = 1e-6
"""Of a vibration, as a share of the length (rad, for torsion)."""
SLOWER = 4.0
"""Steps are so much finer than stability needs: what is left of the time step's own error is far below the tolerances."""


def lumped_bar_1_s(section: Section, count: int, stiffness: float, inertia: float) -> float:
    """First angular frequency of a free chain of `count` springs with half a mass at either end: 2n √(k/m) sin(π/2n).

    Args:
        section: of the beam.
        count: elements of the chain.
        stiffness: EA or GJ.
        inertia: whole mass, or whole inertia about the axis.
    """
    return float(2.0 * count * np.sqrt(stiffness / (inertia * section.length_m)) * np.sin(0.5 * np.pi / count))


def lumped_bending(section: Section, count: int) -> tuple[float, float]:
    """First angular frequency of a pinned chain of massless Euler–Bernoulli elements, and its ratio of rotation to deflection.

    Masses and inertias are lumped: wᵢ = W sin iμ, θᵢ = Θ cos iμ, μ = π/n make the two equations of every node one pair.
    """
    s, mu, piece = section, np.pi / count, section.length_m / count
    mass = s.mass_kg / count
    coupling = -12.0 * s.ei_n_m2 / piece**2 * np.sin(mu)
    stiffness = np.array(
        [[24.0 * s.ei_n_m2 / piece**3 * (1.0 - np.cos(mu)), coupling], [coupling, s.ei_n_m2 / piece * (8.0 + 4.0 * np.cos(mu))]]
    )
    scale = np.diag([mass**-0.5, (mass * s.radius_m**2) ** -0.5])
    values, vectors = np.linalg.eigh(scale @ stiffness @ scale)
    shape = scale @ vectors[:, 0]
    return float(np.sqrt(values[0])), float(shape[1] / shape[0])


@lru_cache(maxsize=2)
def _bending(prototype: Prototype) -> dict[int, float]:
    """Measured: the six chains swing in their first mode for two periods of the continuous beam."""
    section = strut_section(prototype)
    ends = [particle for string in chains(COUNTS) for particle in (string[0], string[-1])]
    run = Run(ready(prototype, held(six_beams(prototype, section, COUNTS), ends, turning=True), SLOWER))
    size = AMPLITUDE * section.length_m
    for count, string in zip(COUNTS, chains(COUNTS), strict=True):
        phase = np.pi * np.arange(count + 1) / count
        run.x[string, 2] += size * np.sin(phase)
        # a deflection along z that grows with x is a turn about −y
        angle = size * lumped_bending(section, count)[1] * np.cos(phase)
        run.q[string, 2] = -0.5 * angle
    run.begin()
    omega = np.pi**2 * np.sqrt(section.ei_n_m2 / (section.mass_kg * section.length_m**3))
    every = max(1, round(2.0 * np.pi / omega / 40 / run.dt_s))
    states = run.record(80, every)
    return {
        count: angular_frequency(states[:, string, 2] @ np.sin(np.pi * np.arange(count + 1) / count), every * run.dt_s)
        for count, string in zip(COUNTS, chains(COUNTS), strict=True)
    }


@lru_cache(maxsize=2)
def _bars(prototype: Prototype) -> tuple[dict[int, float], dict[int, float]]:
    """Measured axial and torsional frequencies of free chains, in one run each."""
    section = strut_section(prototype)
    model = ready(prototype, six_beams(prototype, section, BAR_COUNTS), SLOWER)
    inertia = 2.0 * section.mass_kg * section.radius_m**2

    def measured(stiffness: float, whole: float, put: Callable[[Run, list[int], Array], None], row: int) -> dict[int, float]:
        run = Run(model)
        shapes = [np.cos(np.pi * np.arange(count + 1) / count) for count in BAR_COUNTS]
        strings = chains(BAR_COUNTS)
        for shape, string in zip(shapes, strings, strict=True):
            put(run, string, AMPLITUDE * shape)
        run.begin()
        omega = np.pi * np.sqrt(stiffness / (whole * section.length_m))
        every = max(1, round(2.0 * np.pi / omega / 40 / run.dt_s))
        tracks = run.record(80, every)[:, :, row] - (model.elements.position_m[:, 0] if row == k.X else 0.0)
        return {
            count: angular_frequency(tracks[:, string] @ shape, every * run.dt_s)
            for count, string, shape in zip(BAR_COUNTS, strings, shapes, strict=True)
        }

    def stretch(run: Run, string: list[int], shape: Array) -> None:
        run.x[string, 0] += section.length_m * shape

    def twist(run: Run, string: list[int], shape: Array) -> None:
        run.q[string, 1] = 0.5 * shape

    return measured(section.ea_n, section.mass_kg, stretch, k.X), measured(section.gj_n_m2, inertia, twist, k.Q + 1)


def _worst(measured: dict[int, float], reference: dict[int, float]) -> int:
    return max(measured, key=lambda count: abs(measured[count] / reference[count] - 1.0))


def _hertz(omega: float) -> float:
    return omega / (2.0 * np.pi)


def _error_picture(measured: dict[int, float], limit: float, lumped: dict[int, float]) -> Picture:
    counts = list(measured)
    off = curve("solver", counts, [abs(measured[n] / limit - 1.0) for n in counts], marks=True)
    formula: Curve = curve("lumped formula", counts, [abs(lumped[n] / limit - 1.0) for n in counts])
    return Picture("elements per strut", "|frequency / continuous beam's − 1|", (formula, off), log_x=True, log_y=True)


def axial_frequency(setting: Setting) -> Case:
    """Every n against the lumped chain."""
    section = strut_section(setting.prototype)
    measured, _ = _bars(setting.prototype)
    lumped = {n: lumped_bar_1_s(section, n, section.ea_n, section.mass_kg) for n in BAR_COUNTS}
    worst = _worst(measured, lumped)
    return Case(
        "axial frequency of a strut, lumped",
        f"First axial frequency of a free strut of 1 to {BAR_COUNTS[-1]} elements, from its motion; the worst "
        f"(n = {worst}) is shown.",
        _hertz(measured[worst]),
        _hertz(lumped[worst]),
        "Hz",
        1e-4,
        "ω = 2n √(EA/(mL)) sin(π/2n): a chain of n springs nEA/L and masses m/n, half at the ends",
    )


def axial_limit(setting: Setting) -> Case:
    """Many elements against the continuous bar."""
    section = strut_section(setting.prototype)
    measured, _ = _bars(setting.prototype)
    lumped = {n: lumped_bar_1_s(section, n, section.ea_n, section.mass_kg) for n in BAR_COUNTS}
    limit = np.pi * np.sqrt(section.ea_n / (section.mass_kg * section.length_m))
    last = BAR_COUNTS[-1]
    return Case(
        "axial frequency of a strut, continuous",
        f"First axial frequency of a free strut of {last} elements against the continuous bar; the lumped chain is of order n⁻².",
        _hertz(measured[last]),
        _hertz(limit),
        "Hz",
        0.01,
        "ω = π √(EA/(mL)), free–free bar (wave equation); lumping lowers it by the factor sin(π/2n)/(π/2n)",
        picture=_error_picture(measured, limit, lumped),
    )


def torsional_frequency(setting: Setting) -> Case:
    """Every n against the lumped chain."""
    section = strut_section(setting.prototype)
    _, measured = _bars(setting.prototype)
    inertia = 2.0 * section.mass_kg * section.radius_m**2
    lumped = {n: lumped_bar_1_s(section, n, section.gj_n_m2, inertia) for n in BAR_COUNTS}
    worst = _worst(measured, lumped)
    return Case(
        "torsional frequency of a strut, lumped",
        f"First torsional frequency of a free strut of 1 to {BAR_COUNTS[-1]} elements; the worst (n = {worst}) is shown.",
        _hertz(measured[worst]),
        _hertz(lumped[worst]),
        "Hz",
        1e-4,
        "ω = 2n √(GJ/(JL)) sin(π/2n), J the strut's inertia about its axis",
    )


def bending_frequency(setting: Setting) -> Case:
    """Every n against the lumped chain."""
    section = strut_section(setting.prototype)
    measured = _bending(setting.prototype)
    lumped = {n: lumped_bending(section, n)[0] for n in COUNTS}
    worst = _worst(measured, lumped)
    return Case(
        "bending frequency of a strut, lumped",
        f"First bending frequency of a strut of {COUNTS[0]} to {COUNTS[-1]} elements with pinned ends; the "
        f"worst (n = {worst}) is shown.",
        _hertz(measured[worst]),
        _hertz(lumped[worst]),
        "Hz",
        1e-4,
        "ω² = (12 EI/(m′l³)) (1 − cos μ)²/(2 + cos μ), μ = π/n, m′ = m/n, l = L/n: massless Euler–Bernoulli elements, "
        "lumped masses (with the lumped inertias kept, a pair of equations)",
    )


def bending_limit(setting: Setting) -> Case:
    """Few elements are enough in bending."""
    section = strut_section(setting.prototype)
    measured = _bending(setting.prototype)
    lumped = {n: lumped_bending(section, n)[0] for n in COUNTS}
    limit = np.pi**2 * np.sqrt(section.ei_n_m2 / (section.mass_kg * section.length_m**3))
    return Case(
        "bending frequency of a strut, continuous",
        "First bending frequency of a strut of 4 elements with pinned ends against the continuous beam; the chain is of order n⁻⁴.",
        _hertz(measured[4]),
        _hertz(limit),
        "Hz",
        2e-3,
        "ω = π² √(EI/(mL³)), Euler–Bernoulli beam with pinned ends",
        picture=_error_picture(measured, limit, lumped),
    )
