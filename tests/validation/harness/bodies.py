# SPDX-License-Identifier: Apache-2.0
"""Test structures in the kernel's own terms: six straight beams of any number of elements, twelve separate bodies."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.structure.arrays import Array
from sim_core.structure.elements import Elements, elements_of
from sim_core.structure.parameters import Prototype
from sim_core.structure.topology import JOINTS

CLAMP = 1e12
"""Factor on mass or inertia that holds a particle in place."""
ABSENT = 1e-9
"""Stiffness (N, N m²) of a beam that is to carry nothing."""


NO_CABLES: dict[str, Any] = {
    "cable_ends": np.zeros((0, 2), dtype=np.int32),
    "cable_stiffness_n_m": np.zeros(0),
    "cable_rest_m": np.zeros(0),
    "cable_point_1_m": np.zeros((0, 3)),
    "cable_point_2_m": np.zeros((0, 3)),
}


class Section(NamedTuple):
    """A uniform straight beam: length (m), EA (N), EI, GJ (N m²), mass (kg), radius of gyration of its cross-section (m)."""

    length_m: float
    ea_n: float
    ei_n_m2: float
    gj_n_m2: float
    mass_kg: float
    radius_m: float


def strut_section(prototype: Prototype) -> Section:
    """The robot's strut as a uniform slender beam (its cross-section's own inertia next to nothing)."""
    length = prototype.strut_length_m
    return Section(
        length,
        prototype.strut_axial_stiffness_n_m * length,
        prototype.strut_bending_stiffness_n_m2,
        prototype.strut_torsion_stiffness_n_m2,
        prototype.actuator_mass_kg,
        1e-3 * length,
    )


def chains(counts: Sequence[int]) -> list[list[int]]:
    """Particles of each of six beams of `six_beams`, from end 1 to end 2."""
    out, following = [], JOINTS
    for beam, count in enumerate(counts):
        out.append([2 * beam, *range(following, following + count - 1), 2 * beam + 1])
        following += count - 1
    return out


def six_beams(prototype: Prototype, section: Section, counts: Sequence[int]) -> Elements:
    """Six separate beams along x, cut into `counts` elements; masses and inertias lumped at the particles, half at the ends.

    Nothing else acts: no ropes, no gravity, no mass damping. The last particle (the box) stands apart.
    """
    s, strings = section, chains(counts)
    particles = max(max(string) for string in strings) + 2
    position, mass = np.zeros((particles, 3)), np.full(particles, s.mass_kg)
    ends, strut, share = [], [], []
    for beam, (count, string) in enumerate(zip(counts, strings, strict=True)):
        position[string] = [(s.length_m * i / count, 3.0 * s.length_m * beam, 0.0) for i in range(count + 1)]
        mass[string] = s.mass_kg / count
        mass[[string[0], string[-1]]] *= 0.5
        ends += [(string[i], string[i + 1]) for i in range(count)]
        strut += [beam] * count
        share += [1.0 / count] * count
    across = mass * s.radius_m**2
    position[-1, 2] = 10.0 * s.length_m
    inertia = np.column_stack([2.0 * across, across, across])
    return replace(
        elements_of(prototype),
        position_m=position,
        frame=np.repeat(np.eye(3)[None], particles, axis=0),
        mass_kg=mass,
        inertia_kg_m2=inertia,
        beam_ends=np.array(ends, dtype=np.int32),
        beam_strut=np.array(strut, dtype=np.int32),
        beam_ea_n=np.full(len(ends), s.ea_n),
        beam_ei_n_m2=np.full(len(ends), s.ei_n_m2),
        beam_gj_n_m2=np.full(len(ends), s.gj_n_m2),
        beam_share=np.array(share),
        **NO_CABLES,
        contact_point_m=np.zeros((k.CONTACTS, 3)),
        ground_stiffness_n_m=np.full(2, ABSENT),
        ground_damping_n_s_m=np.zeros(2),
        strut_mid_m=np.full(6, s.length_m),
        gravity_m_s2=np.zeros(3),
        zeta_1_s=0.0,
    )


def held(elements: Elements, particles: Sequence[int], *, turning: bool = False) -> Elements:
    """The elements with some particles made immovable, and unturnable unless `turning`."""
    mass, inertia = elements.mass_kg.copy(), elements.inertia_kg_m2.copy()
    mass[list(particles)] *= CLAMP
    if not turning:
        inertia[list(particles)] *= CLAMP
    return replace(elements, mass_kg=mass, inertia_kg_m2=inertia)


def bodies(prototype: Prototype, mass_kg: Array, inertia_kg_m2: Array, contact_point_m: Array) -> Elements:
    """Twelve separate rigid bodies in a row along y, 1 m apart, on the prototype's ground; no struts or ropes to speak of.

    Masses (12,), inertias (12, 3), and contact points (5, 3), alike for all.
    """
    base = elements_of(replace(prototype, strut_elements=1))
    position = np.zeros((13, 3))
    position[:12, 1] = np.arange(12)
    position[12, 2] = 10.0
    none = np.full(6, ABSENT)
    return replace(
        base,
        position_m=position,
        frame=np.repeat(np.eye(3)[None], 13, axis=0),
        mass_kg=np.append(mass_kg, prototype.box_mass_kg),
        inertia_kg_m2=np.vstack([inertia_kg_m2, prototype.box_inertia_kg_m2]),
        beam_ea_n=none,
        beam_ei_n_m2=none,
        beam_gj_n_m2=none,
        **NO_CABLES,
        contact_point_m=np.tile(contact_point_m, (12, 1)),
        strut_mid_m=np.ones(6),
        zeta_1_s=0.0,
    )
