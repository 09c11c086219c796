# SPDX-License-Identifier: Apache-2.0
"""The prototype: every number that the solver uses, each with unit and source, from one YAML file."""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from sim_core.errors import ParameterError
from sim_core.structure.parameter_file import SOURCES, ParameterFile, Spec, spec, specs_of


@dataclass(frozen=True)
class Prototype:
    """One robot's numbers; units are in the names, meanings in data/prototype.yaml."""

    strut_length_m: float = spec("m", 0.05, 5.0)
    strut_diameter_m: float = spec("m", 0.001, 0.5)
    strut_axial_stiffness_n_m: float = spec("N/m", 1e3, 1e9)
    strut_bending_stiffness_n_m2: float = spec("N m^2", 1e-3, 1e6)
    strut_torsion_stiffness_n_m2: float = spec("N m^2", 1e-3, 1e6)
    strut_elements: int = spec("1", 1, 16, whole=True)
    strut_particle_inertia_kg_m2: tuple[float, ...] = spec("kg m^2", 1e-9, 10.0, size=3)
    actuator_mass_kg: float = spec("kg", 1e-4, 100.0)
    actuator_stroke_m: float = spec("m", 1e-3, 2.0)
    actuator_speed_m_s: float = spec("m/s", 1e-4, 10.0)
    actuator_stall_n: float = spec("N", 0.1, 1e5)
    actuator_back_drive_n: float = spec("N", 0.0, 1e5)
    joint_mass_kg: float = spec("kg", 1e-4, 100.0)
    joint_inertia_kg_m2: tuple[float, ...] = spec("kg m^2", 1e-9, 10.0, size=3)
    tendon_stiffness_n_m: float = spec("N/m", 1.0, 1e6)
    tendon_stretch: float = spec("1", 1.001, 5.0)
    tendon_point_radius_m: float = spec("m", 0.0, 0.1)
    box_mass_kg: float = spec("kg", 1e-3, 100.0)
    box_inertia_kg_m2: tuple[float, ...] = spec("kg m^2", 1e-8, 10.0, size=3)
    box_radius_m: float = spec("m", 0.0, 1.0)
    box_rope_stiffness_n_m: float = spec("N/m", 1.0, 1e6)
    box_rope_stretch: float = spec("1", 1.001, 5.0)
    box_rope_point_radius_m: float = spec("m", 0.0, 0.1)
    box_rope_point_angle_deg: float = spec("deg", 0.0, 90.0)
    box_rope_reach_m: float = spec("m", 0.0, 1.0)
    box_rope_spread: float = spec("1", 0.0, 2.0)
    contact_tip_m: float = spec("m", 0.0, 0.1)
    contact_rim_m: float = spec("m", 0.0, 0.1)
    contact_stiffness_n_m: float = spec("N/m", 100.0, 1e8)
    contact_tangential_stiffness_n_m: float = spec("N/m", 100.0, 1e8)
    contact_damping_ratio: float = spec("1", 0.0, 1.0)
    contact_tangential_damping_ratio: float = spec("1", 0.0, 1.0)
    friction_static: float = spec("1", 0.0, 5.0)
    friction_kinetic: float = spec("1", 0.0, 5.0)
    ground_slope_rad: tuple[float, ...] = spec("rad", -1.0, 1.0, size=2)
    gravity_m_s2: float = spec("m/s^2", 0.0, 100.0)
    first_frequency_hz: float = spec("Hz", 0.01, 1e3)
    mass_damping_ratio: float = spec("1", 0.0, 2.0)
    steps_per_second: int = spec("1/s", 100, 10_000_000, whole=True)
    policy_limit_mm: int = spec("mm", 1, 2000, whole=True)
    rest_speed_m_s: float = spec("m/s", 1e-6, 1.0)
    rest_hold_s: float = spec("s", 0.01, 10.0)
    rest_timeout_s: float = spec("s", 0.1, 1000.0)
    force_fraction: float = spec("1", 0.01, 1.0)
    clearance_margin_m: float = spec("m", 0.0, 0.2)
    carry_fraction: float = spec("1", 0.0, 0.3)

    def __post_init__(self) -> None:
        for field in fields(self):
            value = field.metadata["spec"].checked(field.name, getattr(self, field.name))
            object.__setattr__(self, field.name, value)
        if self.friction_kinetic > self.friction_static:
            raise ParameterError(
                f"friction_kinetic = {self.friction_kinetic} is above friction_static = {self.friction_static}: "
                "sliding friction cannot exceed sticking friction"
            )
        if self.policy_limit_mm > 1e3 * self.actuator_stroke_m:
            raise ParameterError(
                f"policy_limit_mm = {self.policy_limit_mm} is beyond the stops, actuator_stroke_m = {self.actuator_stroke_m}"
            )
        if self.actuator_stroke_m >= 0.5 * self.strut_length_m:
            raise ParameterError(
                f"actuator_stroke_m = {self.actuator_stroke_m} must be below half of strut_length_m = {self.strut_length_m}"
            )

    @property
    def zeta_1_s(self) -> float:
        """Mass damping ζ = 2 ξ ω₁ (1/s)."""
        return 2.0 * self.mass_damping_ratio * 2.0 * math.pi * self.first_frequency_hz

    @property
    def hash(self) -> str:
        """Identifies the numbers (not their names or sources): sha256 of their canonical JSON, 16 hex digits."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()[:16]


SPECS = specs_of(Prototype)
FILE = ParameterFile("prototype", SPECS)


def _spec(name: str) -> Spec:
    if name not in SPECS:
        raise ParameterError(f"unknown parameter {name!r}: `sixstrut parameters` lists the valid ones")
    return SPECS[name]


def with_value(prototype: Prototype, name: str, value: Any) -> Prototype:
    """The prototype with one parameter changed, by name. Raises ParameterError."""
    _spec(name)
    return replace(prototype, **{name: value})


def rewritten(text: str, changes: Mapping[str, tuple[Any, str, str]]) -> str:
    """The text of a prototype YAML with some rows replaced, parameter -> (value, source, note); all else, comments too, stays.

    Raises:
        ParameterError: a parameter or source that does not exist, or a value that is not valid.
    """
    lines = text.splitlines()
    for name, (value, source, note) in changes.items():
        spec = _spec(name)
        if source not in SOURCES:
            raise ParameterError(f"unknown source {source!r}: valid are {', '.join(SOURCES)}")
        checked = spec.checked(name, value)
        shown = list(checked) if isinstance(checked, tuple) else checked
        row = f"{name}: {{value: {json.dumps(shown)}, unit: {spec.unit}, source: {source}, note: {json.dumps(note)}}}"
        places = [i for i, line in enumerate(lines) if line.startswith(f"{name}:")]
        if len(places) != 1:
            raise ParameterError(f"the file has {len(places)} rows for {name}; valid is one, on one line")
        lines[places[0]] = row
    return "\n".join(lines) + "\n"


def load_prototype(path: Path | str | None = None) -> Prototype:
    """The prototype of a YAML file (default: the nominal one). Raises ParameterError."""
    return Prototype(**{entry.name: entry.value for entry in FILE.load(path)})


def parse_prototype(document: Any, file: str) -> Prototype:
    """The prototype of a parsed YAML; `file` names it in errors. Raises ParameterError."""
    return Prototype(**{entry.name: entry.value for entry in FILE.parse(document, file)})
