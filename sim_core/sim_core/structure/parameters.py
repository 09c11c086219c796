# SPDX-License-Identifier: Apache-2.0
"""The prototype: every number that the solver uses, each with unit and source, from one YAML file."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from sim_core.errors import ParameterError, YamlError, brief
from sim_core.files.yaml_reader import read_yaml
from sim_core.printable import printable

SCHEMA = 1
SHIPPED = "sim_core/sim_core/data/prototype.yaml"
"""Where the nominal prototype lies in the repository, for people: `default_path` may lead into a build folder."""
SOURCES = ("paper", "math", "method", "stand-in", "design", "standard", "calibrated", "measured")
Vector = tuple[float, ...]


class Spec(NamedTuple):
    """What a parameter must be: unit, closed range, number of components (0: a plain number), whole number or not."""

    unit: str
    low: float
    high: float
    size: int = 0
    whole: bool = False


SPECS: dict[str, Spec] = {
    "strut_length_m": Spec("m", 0.05, 5.0),
    "strut_diameter_m": Spec("m", 0.001, 0.5),
    "strut_axial_stiffness_n_m": Spec("N/m", 1e3, 1e9),
    "strut_bending_stiffness_n_m2": Spec("N m^2", 1e-3, 1e6),
    "strut_torsion_stiffness_n_m2": Spec("N m^2", 1e-3, 1e6),
    "strut_elements": Spec("1", 1, 16, whole=True),
    "strut_particle_inertia_kg_m2": Spec("kg m^2", 1e-9, 10.0, size=3),
    "actuator_mass_kg": Spec("kg", 1e-4, 100.0),
    "actuator_stroke_m": Spec("m", 1e-3, 2.0),
    "actuator_speed_m_s": Spec("m/s", 1e-4, 10.0),
    "actuator_stall_n": Spec("N", 0.1, 1e5),
    "actuator_back_drive_n": Spec("N", 0.0, 1e5),
    "joint_mass_kg": Spec("kg", 1e-4, 100.0),
    "joint_inertia_kg_m2": Spec("kg m^2", 1e-9, 10.0, size=3),
    "tendon_stiffness_n_m": Spec("N/m", 1.0, 1e6),
    "tendon_stretch": Spec("1", 1.001, 5.0),
    "tendon_point_radius_m": Spec("m", 0.0, 0.1),
    "box_mass_kg": Spec("kg", 1e-3, 100.0),
    "box_inertia_kg_m2": Spec("kg m^2", 1e-8, 10.0, size=3),
    "box_radius_m": Spec("m", 0.0, 1.0),
    "box_rope_stiffness_n_m": Spec("N/m", 1.0, 1e6),
    "box_rope_stretch": Spec("1", 1.001, 5.0),
    "box_rope_point_radius_m": Spec("m", 0.0, 0.1),
    "box_rope_point_angle_deg": Spec("deg", 0.0, 90.0),
    "box_rope_reach_m": Spec("m", 0.0, 1.0),
    "box_rope_spread": Spec("1", 0.0, 2.0),
    "contact_tip_m": Spec("m", 0.0, 0.1),
    "contact_rim_m": Spec("m", 0.0, 0.1),
    "contact_stiffness_n_m": Spec("N/m", 100.0, 1e8),
    "contact_tangential_stiffness_n_m": Spec("N/m", 100.0, 1e8),
    "contact_damping_ratio": Spec("1", 0.0, 1.0),
    "contact_tangential_damping_ratio": Spec("1", 0.0, 1.0),
    "friction_static": Spec("1", 0.0, 5.0),
    "friction_kinetic": Spec("1", 0.0, 5.0),
    "ground_slope_rad": Spec("rad", -1.0, 1.0, size=2),
    "gravity_m_s2": Spec("m/s^2", 0.0, 100.0),
    "first_frequency_hz": Spec("Hz", 0.01, 1e3),
    "mass_damping_ratio": Spec("1", 0.0, 2.0),
    "steps_per_second": Spec("1/s", 100, 10_000_000, whole=True),
    "policy_limit_mm": Spec("mm", 1, 2000, whole=True),
    "rest_speed_m_s": Spec("m/s", 1e-6, 1.0),
    "rest_hold_s": Spec("s", 0.01, 10.0),
    "rest_timeout_s": Spec("s", 0.1, 1000.0),
    "force_fraction": Spec("1", 0.01, 1.0),
    "clearance_margin_m": Spec("m", 0.0, 0.2),
    "carry_fraction": Spec("1", 0.0, 0.3),
}


@dataclass(frozen=True)
class Prototype:
    """One robot's numbers; units are in the names, meanings in data/prototype.yaml, valid ranges in SPECS."""

    strut_length_m: float
    strut_diameter_m: float
    strut_axial_stiffness_n_m: float
    strut_bending_stiffness_n_m2: float
    strut_torsion_stiffness_n_m2: float
    strut_elements: int
    strut_particle_inertia_kg_m2: Vector
    actuator_mass_kg: float
    actuator_stroke_m: float
    actuator_speed_m_s: float
    actuator_stall_n: float
    actuator_back_drive_n: float
    joint_mass_kg: float
    joint_inertia_kg_m2: Vector
    tendon_stiffness_n_m: float
    tendon_stretch: float
    tendon_point_radius_m: float
    box_mass_kg: float
    box_inertia_kg_m2: Vector
    box_radius_m: float
    box_rope_stiffness_n_m: float
    box_rope_stretch: float
    box_rope_point_radius_m: float
    box_rope_point_angle_deg: float
    box_rope_reach_m: float
    box_rope_spread: float
    contact_tip_m: float
    contact_rim_m: float
    contact_stiffness_n_m: float
    contact_tangential_stiffness_n_m: float
    contact_damping_ratio: float
    contact_tangential_damping_ratio: float
    friction_static: float
    friction_kinetic: float
    ground_slope_rad: Vector
    gravity_m_s2: float
    first_frequency_hz: float
    mass_damping_ratio: float
    steps_per_second: int
    policy_limit_mm: int
    rest_speed_m_s: float
    rest_hold_s: float
    rest_timeout_s: float
    force_fraction: float
    clearance_margin_m: float
    carry_fraction: float

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, _checked(field.name, getattr(self, field.name)))
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


def _checked(name: str, value: Any) -> Any:
    spec = SPECS[name]
    valid = f"{'a whole number' if spec.whole else 'numbers' if spec.size else 'a number'} in [{spec.low:g}, {spec.high:g}]"
    if spec.size:
        if not isinstance(value, (list, tuple)) or len(value) != spec.size:
            raise ParameterError(f"{name} = {brief(value)}: valid is a list of {spec.size} {valid} {spec.unit}")
        return tuple(_number(name, item, spec, valid) for item in value)
    return _number(name, value, spec, valid)


def _number(name: str, value: Any, spec: Spec, valid: str) -> float | int:
    good = isinstance(value, (int, float)) and not isinstance(value, bool) and spec.low <= value <= spec.high
    if not good or (spec.whole and value != int(value)):
        raise ParameterError(f"{name} = {brief(value)}: valid is {valid} {spec.unit}")
    return int(value) if spec.whole else float(value)


@dataclass(frozen=True)
class Entry:
    """One row of the parameter table."""

    name: str
    value: Any
    unit: str
    source: str
    note: str


def default_path() -> Path:
    """The nominal prototype's YAML."""
    return Path(str(files("sim_core") / "data" / "prototype.yaml"))


def load_entries(path: Path | str | None = None) -> tuple[Entry, ...]:
    """Read and check a prototype YAML; the rows in the file's order.

    Raises:
        ParameterError: naming file, parameter, what was got and what is valid.
    """
    file = Path(path) if path is not None else default_path()
    try:
        document = read_yaml(file)
    except OSError as error:
        raise ParameterError(f"cannot read prototype file {file}: {error.strerror}") from error
    except YamlError as error:
        raise ParameterError(str(error)) from error
    return parse_entries(document, str(file))


def parse_entries(document: Any, file: str) -> tuple[Entry, ...]:
    """The checked rows of a parsed prototype YAML; `file` names it in errors. Raises ParameterError."""
    if not isinstance(document, Mapping):
        raise ParameterError(f"{file} is not a prototype file: valid is a mapping of parameters, as in {SHIPPED}")
    if document.get("schema") != SCHEMA:
        raise ParameterError(f"{file}: schema {brief(document.get('schema'))} is not known; valid is {SCHEMA}")
    given = {name: row for name, row in document.items() if name not in ("schema", "name")}
    missing, unknown = sorted(SPECS.keys() - given.keys()), sorted(given.keys() - SPECS.keys())
    if missing or unknown:
        names = printable(", ".join(map(str, unknown)), 80)
        parts = [f"missing: {', '.join(missing)}"] * bool(missing) + [f"unknown: {names}"] * bool(unknown)
        raise ParameterError(f"{file}: {'; '.join(parts)}; valid parameters are those of {SHIPPED}")
    return tuple(_entry(file, name, row) for name, row in given.items())


def _entry(file: str, name: str, row: Any) -> Entry:
    if not isinstance(row, Mapping) or not {"value", "unit", "source"} <= row.keys():
        raise ParameterError(f"{file}: {name} must be {{value: ..., unit: ..., source: ...}}, got {brief(row)}")
    if str(row["unit"]) != SPECS[name].unit:
        raise ParameterError(f"{file}: {name} has unit {brief(row['unit'])}; valid is {SPECS[name].unit!r}")
    if row["source"] not in SOURCES:
        raise ParameterError(f"{file}: {name} has source {brief(row['source'])}; valid are {', '.join(SOURCES)}")
    try:
        value = _checked(name, row["value"])
    except ParameterError as error:
        raise ParameterError(f"{file}: {error}") from None
    return Entry(name, value, SPECS[name].unit, row["source"], str(row.get("note", "")))


def with_value(prototype: Prototype, name: str, value: Any) -> Prototype:
    """The prototype with one parameter changed, by name. Raises ParameterError."""
    if name not in SPECS:
        raise ParameterError(f"unknown parameter {name!r}: `sixstrut parameters` lists the valid ones")
    return replace(prototype, **{name: value})


def rewritten(text: str, changes: Mapping[str, tuple[Any, str, str]]) -> str:
    """The text of a prototype YAML with some rows replaced; everything else, comments included, stays.

    Args:
        text: of the YAML.
        changes: parameter -> (value, source, note).

    Raises:
        ParameterError: a parameter or source that does not exist, or a value that is not valid.
    """
    lines = text.splitlines()
    for name, (value, source, note) in changes.items():
        if name not in SPECS:
            raise ParameterError(f"unknown parameter {name!r}: `sixstrut parameters` lists the valid ones")
        if source not in SOURCES:
            raise ParameterError(f"unknown source {source!r}: valid are {', '.join(SOURCES)}")
        checked = _checked(name, value)
        shown = list(checked) if isinstance(checked, tuple) else checked
        row = f"{name}: {{value: {json.dumps(shown)}, unit: {SPECS[name].unit}, source: {source}, note: {json.dumps(note)}}}"
        places = [i for i, line in enumerate(lines) if line.startswith(f"{name}:")]
        if len(places) != 1:
            raise ParameterError(f"the file has {len(places)} rows for {name}; valid is one, on one line")
        lines[places[0]] = row
    return "\n".join(lines) + "\n"


def load_prototype(path: Path | str | None = None) -> Prototype:
    """The prototype of a YAML file (default: the nominal one). Raises ParameterError."""
    return Prototype(**{entry.name: entry.value for entry in load_entries(path)})


def parse_prototype(document: Any, file: str) -> Prototype:
    """The prototype of a parsed YAML; `file` names it in errors. Raises ParameterError."""
    return Prototype(**{entry.name: entry.value for entry in parse_entries(document, file)})
