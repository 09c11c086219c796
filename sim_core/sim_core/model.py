"""A model ready to run: elements checked, cut into the kernel's rows, and known to be stable at its time step."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim_core import kernel as k
from sim_core.elements import IMPROVED, KINDS, Array, Elements, elements_of, previous_elements_of
from sim_core.errors import ModelError, UnstableStepError
from sim_core.parameters import Prototype
from sim_core.rotation import norm, rotated
from sim_core.stability import largest_stable_step_s
from sim_core.structure import TENDONS

STEP_MARGIN = 0.97
"""A time step above this share of the stability limit is refused."""


@dataclass(frozen=True)
class Model:
    """One robot's model. Build with `build_model`.

    Attributes:
        prototype: the nominal numbers; its judging rules (§ Judging a roll) apply to every perturbed copy.
        elements: the numbers member by member.
        topology, par: the kernel's tables.
        reach_m: no contact point is farther than this from its joint.
    """

    prototype: Prototype
    elements: Elements
    topology: k.Topology
    par: Array
    reach_m: float

    @property
    def steps_per_second(self) -> int:
        return self.elements.steps_per_second

    @property
    def dt_s(self) -> float:
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
        return self.elements.hash

    @cached_property
    def layout(self) -> k.Layout:
        return k.Layout(*k.layout.py_func(self.topology.particles, len(self.topology.beams), len(self.topology.cables)))

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
        ModelError: a mass, stiffness or point that is not finite or not positive, a cable to a missing particle,
            a slack self-stress (which `allow_slack` permits, for bodies that are no tensegrity).
        UnstableStepError: the time step is beyond the model's limit; names both.
    """
    if kind not in KINDS:
        raise ModelError(f"unknown model {kind!r}: valid are {', '.join(KINDS)}")
    if elements is None:
        elements = elements_of(prototype) if kind == IMPROVED else previous_elements_of(prototype)
    _check(elements)
    if not allow_slack:
        _require_taut(elements)
    topology = k.Topology(
        np.ascontiguousarray(np.column_stack([elements.beam_ends, elements.beam_strut]).astype(np.int32)),
        np.ascontiguousarray(elements.cable_ends),
        len(elements.mass_kg),
    )
    reach = float(norm(elements.contact_point_m).max()) + 1e-3
    model = Model(prototype, elements, topology, _rows(elements), reach)
    limit = largest_stable_step_s(elements, topology, model.par, prototype.actuator_stroke_m)
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


def _rows(e: Elements) -> Array:
    """The kernel's `par`."""
    particles = np.empty((len(e.mass_kg), k.PARTICLE_PAR))
    particles[:, k.DT_M] = 1.0 / (e.steps_per_second * e.mass_factor * e.mass_kg)
    particles[:, k.INV_I : k.INV_I + 3] = 1.0 / e.inertia_kg_m2
    particles[:, k.WEIGHT : k.WEIGHT + 3] = e.mass_kg[:, None] * e.gravity_m_s2
    beams = np.column_stack([e.beam_ea_n, e.beam_ei_n_m2, e.beam_gj_n_m2, e.beam_share])
    cables = np.column_stack([e.cable_stiffness_n_m, e.cable_rest_m, e.cable_point_1_m, e.cable_point_2_m])
    ground = np.array(
        [
            e.ground_stiffness_n_m[0],
            e.ground_damping_n_s_m[0],
            e.ground_stiffness_n_m[1],
            e.ground_damping_n_s_m[1],
            e.friction[0],
            e.friction[1],
        ]
    )
    speed = e.strut_gain * e.strut_speed_m_s / e.steps_per_second
    parts = [particles, speed, beams, cables, e.contact_point_m, ground]
    par = np.concatenate([np.ravel(part) for part in parts])
    par.setflags(write=False)
    return par
