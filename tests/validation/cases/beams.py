# SPDX-License-Identifier: Apache-2.0
"""Small vibrations of a strut of n elements: against the lumped chain's closed forms, and their limit, the continuous beam."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.structure.arrays import Array
from sim_core.structure.parameters import Prototype
from tests.validation.harness.bodies import Section, chains, held, six_beams, strut_section
from tests.validation.harness.case import Case, Comparison, Curve, Picture, Setting
from tests.validation.harness.run import Run, angular_frequency, ready

COUNTS = (2, 3, 4, 6, 8, 16)
BAR_COUNTS = (1, 2, 3, 4, 6, 8)
AMPLITUDE = 1e-6
"""Of a vibration, as a share of the length (rad, for torsion)."""
SLOWER = 4.0
"""Steps are so much finer than stability needs: what is left of the time step's own error is far below the tolerances."""


def lumped_bar_1_s(section: Section, count: int, stiffness: float, inertia: float) -> float:
    """First angular frequency of a free chain of `count` springs with half a mass at either end: 2n √(k/m) sin(π/2n).

    `stiffness` and `inertia`: EA and the whole mass, or GJ and the whole inertia about the axis.
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


class _Vibration(NamedTuple):
    """First angular frequencies: measured and of the lumped chain, by number of elements, and the continuous beam's."""

    measured: dict[int, float]
    lumped: dict[int, float]
    limit: float


def _measured(run: Run, counts: tuple[int, ...], shapes: list[Array], omega: float, row: int) -> dict[int, float]:
    """Frequencies of six chains, let go in their first modes, from a row of their particles in two periods of `omega`."""
    run.begin()
    every = max(1, round(2.0 * np.pi / omega / 40 / run.dt_s))
    tracks = run.record(80, every)[:, :, row] - (run.model.elements.position_m[:, row] if row < k.V else 0.0)
    return {
        count: angular_frequency(tracks[:, string] @ shape, every * run.dt_s)
        for count, string, shape in zip(counts, chains(counts), shapes, strict=True)
    }


@lru_cache(maxsize=2)
def _bending(prototype: Prototype) -> _Vibration:
    """Chains with pinned ends."""
    section = strut_section(prototype)
    ends = [particle for string in chains(COUNTS) for particle in (string[0], string[-1])]
    run = Run(ready(prototype, held(six_beams(prototype, section, COUNTS), ends, turning=True), SLOWER))
    size = AMPLITUDE * section.length_m
    lumped = {count: lumped_bending(section, count) for count in COUNTS}
    phases = [np.pi * np.arange(count + 1) / count for count in COUNTS]
    for count, string, phase in zip(COUNTS, chains(COUNTS), phases, strict=True):
        run.x[string, 2] += size * np.sin(phase)
        # a deflection along z that grows with x is a turn about −y
        run.q[string, 2] = -0.5 * (size * lumped[count][1] * np.cos(phase))
    limit = np.pi**2 * np.sqrt(section.ei_n_m2 / (section.mass_kg * section.length_m**3))
    measured = _measured(run, COUNTS, [np.sin(phase) for phase in phases], limit, k.X + 2)
    return _Vibration(measured, {count: omega for count, (omega, _) in lumped.items()}, limit)


@lru_cache(maxsize=4)
def _bars(prototype: Prototype, torsion: bool = False) -> _Vibration:
    """Free chains that stretch, or twist."""
    section = strut_section(prototype)
    run = Run(ready(prototype, six_beams(prototype, section, BAR_COUNTS), SLOWER))
    shapes = [np.cos(np.pi * np.arange(count + 1) / count) for count in BAR_COUNTS]
    for shape, string in zip(shapes, chains(BAR_COUNTS), strict=True):
        if torsion:
            run.q[string, 1] = 0.5 * (AMPLITUDE * shape)
        else:
            run.x[string, 0] += section.length_m * (AMPLITUDE * shape)
    stiffness, whole = section.ea_n, section.mass_kg
    if torsion:
        stiffness, whole = section.gj_n_m2, 2.0 * section.mass_kg * section.radius_m**2
    limit = np.pi * np.sqrt(stiffness / (whole * section.length_m))
    measured = _measured(run, BAR_COUNTS, shapes, limit, k.Q + 1 if torsion else k.X)
    return _Vibration(measured, {count: lumped_bar_1_s(section, count, stiffness, whole) for count in BAR_COUNTS}, limit)


def _hertz(omega: float) -> float:
    return omega / (2.0 * np.pi)


def _against_chain(found: _Vibration, name: str, checked: str, source: str) -> Case:
    """Every number of elements against the lumped chain."""
    worst = max(found.measured, key=lambda count: abs(found.measured[count] / found.lumped[count] - 1.0))
    result = Comparison(_hertz(found.measured[worst]), _hertz(found.lumped[worst]), "Hz", 1e-4)
    return Case(name, f"{checked}; the worst (n = {worst}) is shown.", source, result)


def _against_beam(found: _Vibration, count: int, tolerance: float, name: str, checked: str, source: str) -> Case:
    """So many elements against the continuous beam."""
    counts = list(found.measured)
    off = Curve("solver", counts, [abs(found.measured[n] / found.limit - 1.0) for n in counts], marks=True)
    formula = Curve("lumped formula", counts, [abs(found.lumped[n] / found.limit - 1.0) for n in counts])
    picture = Picture("elements per strut", "|frequency / continuous beam's − 1|", (formula, off), log_x=True, log_y=True)
    result = Comparison(_hertz(found.measured[count]), _hertz(found.limit), "Hz", tolerance)
    return Case(name, checked, source, result, picture=picture)


def axial_frequency(setting: Setting) -> Case:
    """Every n against the lumped chain."""
    return _against_chain(
        _bars(setting.prototype),
        "axial frequency of a strut, lumped",
        f"First axial frequency of a free strut of 1 to {BAR_COUNTS[-1]} elements, from its motion",
        "ω = 2n √(EA/(mL)) sin(π/2n): a chain of n springs nEA/L and masses m/n, half at the ends",
    )


def axial_limit(setting: Setting) -> Case:
    """Many elements against the continuous bar."""
    last = BAR_COUNTS[-1]
    return _against_beam(
        _bars(setting.prototype),
        last,
        0.01,
        "axial frequency of a strut, continuous",
        f"First axial frequency of a free strut of {last} elements against the continuous bar; the lumped chain is of order n⁻².",
        "ω = π √(EA/(mL)), free–free bar (wave equation); lumping lowers it by the factor sin(π/2n)/(π/2n)",
    )


def torsional_frequency(setting: Setting) -> Case:
    """Every n against the lumped chain."""
    return _against_chain(
        _bars(setting.prototype, torsion=True),
        "torsional frequency of a strut, lumped",
        f"First torsional frequency of a free strut of 1 to {BAR_COUNTS[-1]} elements",
        "ω = 2n √(GJ/(JL)) sin(π/2n), J the strut's inertia about its axis",
    )


def bending_frequency(setting: Setting) -> Case:
    """Every n against the lumped chain."""
    return _against_chain(
        _bending(setting.prototype),
        "bending frequency of a strut, lumped",
        f"First bending frequency of a strut of {COUNTS[0]} to {COUNTS[-1]} elements with pinned ends",
        "ω² = (12 EI/(m′l³)) (1 − cos μ)²/(2 + cos μ), μ = π/n, m′ = m/n, l = L/n: massless Euler–Bernoulli elements, "
        "lumped masses (with the lumped inertias kept, a pair of equations)",
    )


def bending_limit(setting: Setting) -> Case:
    """Few elements are enough in bending."""
    return _against_beam(
        _bending(setting.prototype),
        4,
        2e-3,
        "bending frequency of a strut, continuous",
        "First bending frequency of a strut of 4 elements with pinned ends against the continuous beam; the chain is of order n⁻⁴.",
        "ω = π² √(EI/(mL³)), Euler–Bernoulli beam with pinned ends",
    )
