# SPDX-License-Identifier: Apache-2.0
"""Files of parameters: one YAML mapping of `name: {value, unit, source, note}`, checked against the fields of a dataclass."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple

from sim_core.errors import ParameterError, brief
from sim_core.files.bounded_reader import DATA
from sim_core.files.yaml_reader import read_yaml_or
from sim_core.printable import printable

SCHEMA = 1
SOURCES = ("paper", "math", "method", "stand-in", "design", "standard", "calibrated", "measured")


class Spec(NamedTuple):
    """What a parameter must be: unit, closed range, number of components (0: a plain number), whole number or not."""

    unit: str
    low: float
    high: float
    size: int = 0
    whole: bool = False

    def checked(self, name: str, value: Any) -> Any:
        """The value, a tuple if it has components. Raises ParameterError."""
        kind = "a whole number" if self.whole else "numbers" if self.size else "a number"
        valid = f"{kind} in [{self.low:g}, {self.high:g}] {self.unit}"
        if not self.size:
            return self._number(name, value, valid)
        if not isinstance(value, (list, tuple)) or len(value) != self.size:
            raise ParameterError(f"{name} = {brief(value)}: valid is a list of {self.size} {valid}")
        return tuple(self._number(name, item, valid) for item in value)

    def _number(self, name: str, value: Any, valid: str) -> float:
        good = isinstance(value, (int, float)) and not isinstance(value, bool) and self.low <= value <= self.high
        if not good or (self.whole and value != int(value)):
            raise ParameterError(f"{name} = {brief(value)}: valid is {valid}")
        return int(value) if self.whole else float(value)


def spec(unit: str, low: float, high: float, size: int = 0, whole: bool = False) -> Any:
    """A field of a dataclass that holds such a parameter."""
    return field(metadata={"spec": Spec(unit, low, high, size, whole)})


def specs_of(kind: type) -> dict[str, Spec]:
    """What each parameter of such a dataclass must be."""
    return {field.name: field.metadata["spec"] for field in fields(kind)}


@dataclass(frozen=True)
class Entry:
    """One row of the parameter table."""

    name: str
    value: Any
    unit: str
    source: str
    note: str


@dataclass(frozen=True)
class ParameterFile:
    """A kind of file.

    Attributes:
        what: it is, as its errors say; the shipped one is called so.
        specs: name -> what it must be.
        hint: added where it cannot be read.
    """

    what: str
    specs: Mapping[str, Spec]
    hint: str = ""

    @property
    def path(self) -> Path:
        """The shipped one; may be in a build folder."""
        return DATA / f"{self.what}.yaml"

    @property
    def shipped(self) -> str:
        """Where the shipped one lies in the repository, for people."""
        return f"sim_core/sim_core/data/{self.what}.yaml"

    def load(self, path: Path | str | None = None) -> tuple[Entry, ...]:
        """The checked rows of a file (default: the shipped one), in its order.

        Raises:
            ParameterError: naming file, parameter, what was got and what is valid.
        """
        file = self.path if path is None else path
        return self.parse(read_yaml_or(ParameterError, file, f"{self.what} file", self.hint), str(file))

    def parse(self, document: Any, file: str) -> tuple[Entry, ...]:
        """The checked rows of a parsed YAML; `file` names it in errors. Raises ParameterError."""
        if not isinstance(document, Mapping):
            raise ParameterError(f"{file} is no {self.what} file: valid is a mapping of parameters, as in {self.shipped}")
        if document.get("schema") != SCHEMA:
            raise ParameterError(f"{file}: schema {brief(document.get('schema'))} is not known; valid is {SCHEMA}")
        given = {name: row for name, row in document.items() if name not in ("schema", "name")}
        missing, unknown = sorted(self.specs.keys() - given.keys()), sorted(given.keys() - self.specs.keys())
        if missing or unknown:
            names = printable(", ".join(map(str, unknown)), 80)
            parts = [f"missing: {', '.join(missing)}"] * bool(missing) + [f"unknown: {names}"] * bool(unknown)
            raise ParameterError(f"{file}: {'; '.join(parts)}; valid parameters are those of {self.shipped}")
        return tuple(self._entry(file, name, row) for name, row in given.items())

    def _entry(self, file: str, name: str, row: Any) -> Entry:
        spec = self.specs[name]
        if not isinstance(row, Mapping) or not {"value", "unit", "source"} <= row.keys():
            raise ParameterError(f"{file}: {name} must be {{value: ..., unit: ..., source: ...}}, got {brief(row)}")
        if str(row["unit"]) != spec.unit:
            raise ParameterError(f"{file}: {name} has unit {brief(row['unit'])}; valid is {spec.unit!r}")
        if row["source"] not in SOURCES:
            raise ParameterError(f"{file}: {name} has source {brief(row['source'])}; valid are {', '.join(SOURCES)}")
        try:
            value = spec.checked(name, row["value"])
        except ParameterError as error:
            raise ParameterError(f"{file}: {error}") from None
        return Entry(name, value, spec.unit, row["source"], str(row.get("note", "")))
