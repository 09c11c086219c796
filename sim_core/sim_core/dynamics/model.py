# SPDX-License-Identifier: Apache-2.0
"""A model ready to run: elements checked, cut into the kernel's rows, and known to be stable at its time step.

Masses, stiffnesses and points come from `structure.elements`.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim_core.dynamics import vfife as k
from sim_core.dynamics.stability import largest_stable_step_s
from sim_core.errors import ModelError, UnstableStepError
from sim_core.structure.arrays import Array
from sim_core.structure.elements import IMPROVED, KINDS, Elements, elements_of, previous_elements_of
from sim_core.structure.parameters import Prototype
from sim_core.structure.rotations import norm, rotated
from sim_core.structure.topology import JOINTS, TENDONS

STEP_MARGIN = 0.97
"""A time step above this share of the stability limit is refused."""


@dataclass(frozen=True)
class Model:
    """One robot's model. Build with `build_model`.

    Attributes:
        prototype: the nominal numbers; its judging rules (§ Judging a roll) apply to every perturbed copy.
        elements: the numbers member by member.
        assembly, par: the kernel's tables.
        cable_order: (48,) which of the elements' cables each of the assembly's is.
        reach_m: no contact point is farther than this from its joint.
    """

    prototype: Prototype
    elements: Elements
    assembly: k.Assembly
    par: Array
    cable_order: NDArray[np.intp]
    reach_m: float

    @property
    def steps_per_second(self) -> int:
        """Steps per second of simulated time."""
        return self.elements.steps_per_second

    @property
    def dt_s(self) -> float:
        """The time step, s."""
        return 1.0 / self.elements.steps_per_second

    @property
    def weight_n(self) -> float:
        """Whole weight's component onto the ground."""
        return -math.fsum(self.elements.mass_kg) * float(self.elements.gravity_m_s2[2])

    @property
    def kind(self) -> str:
        """IMPROVED or PREVIOUS."""
        return self.elements.kind

    @cached_property
    def hash(self) -> str:
        """Identifies the elements, and so the model."""
        return self.elements.hash

    @cached_property
    def layout(self) -> k.Layout:
        """First row of each table of the kernel's columns."""
        return k.Layout(*k.layout.py_func(self.assembly.particles, len(self.assembly.beams), len(self.assembly.cables)))

    def rest_lengths(self, commanded_m: Array) -> Array:
        """What the actuators make of commanded rest lengths, shape (6,): each strut's gain applies to its stroke."""
        commanded = np.asarray(commanded_m, dtype=float)
        nominal = self.prototype.strut_length_m
        return self.elements.strut_mid_m + self.elements.strut_gain * (commanded - nominal)


def build_model(
    prototype: Prototype, elements: Elements | None = None, kind: str = IMPROVED, *, allow_slack: bool = False
) -> Model:
    """Check the elements (default: those of the prototype, for the paper's improved or previous model) and make the model.

    Raises:
        ModelError: a mass, stiffness or point that is not finite or not positive, a cable to a missing particle, a slack
            self-stress (which `allow_slack` permits, for bodies that are no tensegrity).
        UnstableStepError: the time step is beyond the model's limit; names both.
    """
    if kind not in KINDS:
        raise ModelError(f"unknown model {kind!r}: valid are {', '.join(KINDS)}")
    if elements is None:
        elements = elements_of(prototype) if kind == IMPROVED else previous_elements_of(prototype)
    _check(elements)
    if not allow_slack:
        _require_taut(elements)
    assembly, order = _assembly(elements)
    reach = float(norm(elements.contact_point_m).max()) + 1e-3
    model = Model(prototype, elements, assembly, _par(elements, order), order, reach)
    limit = largest_stable_step_s(elements, assembly, model.par, prototype.actuator_stroke_m)
    if model.dt_s > STEP_MARGIN * limit:
        raise UnstableStepError(model.dt_s, limit, int(np.ceil(1.0 / (STEP_MARGIN * limit))))
    return model


def _check(elements: Elements) -> None:
    for name, value in vars(elements).items():
        if name != "kind" and not np.all(np.isfinite(value)):
            raise ModelError(f"{name} holds a value that is not finite: {np.asarray(value).ravel()[:6]}...")
    for name in (
        "mass_kg",
        "inertia_kg_m2",
        "beam_ea_n",
        "beam_share",
        "cable_stiffness_n_m",
        "cable_rest_m",
        "strut_mid_m",
        "strut_gain",
        "strut_speed_m_s",
        "ground_stiffness_n_m",
    ):
        values = np.asarray(getattr(elements, name))
        if (values <= 0).any():
            index = tuple(int(i) for i in np.argwhere(values <= 0)[0])
            raise ModelError(f"{name}{list(index)} = {values[index]:g}: valid is a positive number")
    for name in ("ground_damping_n_s_m", "friction", "beam_ei_n_m2", "beam_gj_n_m2"):
        if (np.asarray(getattr(elements, name)) < 0).any():
            raise ModelError(f"{name} = {np.asarray(getattr(elements, name)).min():g} somewhere: valid is zero or more")
    particles = len(elements.mass_kg)
    for name in ("cable_ends", "beam_ends"):
        table = np.asarray(getattr(elements, name))
        wrong = np.argwhere((table < 0) | (table >= particles))
        if len(wrong):
            row = int(wrong[0][0])
            raise ModelError(f"{name}[{row}] = {table[row].tolist()}: valid particles are 0..{particles - 1}")


def _require_taut(e: Elements) -> None:
    """A tensegrity stands by its prestress: every rope is stretched in the ideal shape."""
    at = [
        e.position_m[p] + rotated(e.frame[p], point)
        for p, point in zip(e.cable_ends.T, (e.cable_point_1_m, e.cable_point_2_m), strict=True)
    ]
    length = norm(at[1] - at[0])
    slack = np.flatnonzero(e.cable_rest_m >= length)
    if len(slack):
        c = int(slack[0])
        name = f"tendon T{c + 1}" if c < len(TENDONS) else f"box rope {c + 1 - len(TENDONS)}"
        raise ModelError(
            f"the self-stress is slack: {name} has rest length {e.cable_rest_m[c]:.4g} m over {length[c]:.4g} m; "
            "valid is a rest length below the distance in the ideal shape"
        )


def _assembly(e: Elements) -> tuple[k.Assembly, NDArray[np.intp]]:
    """The kernel's assembly, and the order of its cables.

    The kernel goes through the cables particle by particle, and sums what they do to that one: each cable belongs to the end
    with more cables, so that all the box's ropes are summed at the box.
    """
    particles = len(e.mass_kg)
    count = np.bincount(e.cable_ends.ravel(), minlength=particles)
    swapped = count[e.cable_ends[:, 1]] > count[e.cable_ends[:, 0]]
    ends = np.where(swapped[:, None], e.cable_ends[:, ::-1], e.cable_ends)
    points = np.stack([e.cable_point_1_m, e.cable_point_2_m], axis=1)
    points = np.where(swapped[:, None, None], points[:, ::-1], points)
    order = np.argsort(ends[:, 0], kind="stable")
    starts = np.searchsorted(ends[order, 0], np.arange(particles + 1))
    beams = np.column_stack([e.beam_ea_n, e.beam_ei_n_m2, e.beam_gj_n_m2, e.beam_share])
    parts = [1.0 / e.inertia_kg_m2, beams, points[order], e.contact_point_m]
    body = np.concatenate([np.ravel(part) for part in parts])
    body.setflags(write=False)
    assembly = k.Assembly(
        np.ascontiguousarray(np.column_stack([e.beam_ends, e.beam_strut]).astype(np.int32)),
        np.ascontiguousarray(ends[order].astype(np.int32)),
        starts.astype(np.int32),
        particles,
        bool((e.inertia_kg_m2 == e.inertia_kg_m2[:, :1]).all()),
        bool((points[ends < JOINTS][:, 0] == 0.0).all() and (ends[:, 1] < JOINTS).all()),
        body,
    )
    return assembly, order


def _par(e: Elements, order: NDArray[np.intp]) -> Array:
    """The kernel's `par`."""
    particles = np.empty((len(e.mass_kg), k.PARTICLE_PAR))
    particles[:, k.DT_M] = 1.0 / (e.steps_per_second * e.mass_factor * e.mass_kg)
    particles[:, k.MASS] = e.mass_kg
    speed = e.strut_gain * e.strut_speed_m_s / e.steps_per_second
    cables = np.column_stack([e.cable_stiffness_n_m, e.cable_rest_m])[order]
    springs = np.column_stack([e.ground_stiffness_n_m, e.ground_damping_n_s_m])
    compliance = 1.0 / e.ground_stiffness_n_m[1:]
    parts = [particles, e.gravity_m_s2, speed, cables, springs, e.friction, compliance]
    par = np.concatenate([np.ravel(part) for part in parts])
    par.setflags(write=False)
    return par
