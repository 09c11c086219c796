# SPDX-License-Identifier: Apache-2.0
"""Primitive libraries: policies for the reference pair, in one YAML file, and the gaits made of them by symmetry.

Schema 2 adds cycles (see `cycle`); a library without any is written as schema 1, with the hash that it has always had.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from sim_core.errors import LibraryError, PolicyError, RollRefused, brief
from sim_core.files.bounded_reader import DATA
from sim_core.files.yaml_reader import read_yaml_or, sealed, yaml_text
from sim_core.gaits.cycle import Chain, Cycle, cycles_text, parse_cycles, stage_numbers
from sim_core.structure.policy import MOST_STAGES, Policy, checked_policy, ways_mm
from sim_core.structure.roll_classes import CLASSES, RollClass, class_of
from sim_core.structure.symmetry import carrier
from sim_core.structure.topology import require_adjacent

SCHEMAS = 1, 2
LIBRARIES = DATA / "libraries"
"""Where the shipped ones are."""


@dataclass(frozen=True)
class Primitive:
    """A policy that rolls the reference pair of its class.

    Attributes:
        name: unique in its library, e.g. "P1".
        roll_class: TC6-TO5 or TO5-TC6.
        policy: six strokes, whole mm, S1..S6, + lengthens.
        margins: figures of its trials, by name (see `search`).
    """

    name: str
    roll_class: RollClass
    policy: Policy
    margins: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Gait:
    """A primitive relabelled to one pair of faces."""

    primitive: Primitive
    source: str
    target: str
    policy: Policy
    proper: bool

    @property
    def name(self) -> str:
        """Primitive and faces, for people."""
        return f"{self.primitive.name} {self.source}→{self.target}"

    def runs_s(self, speed_m_s: float) -> float:
        """For how long the strut that runs most does, there and back, at this speed (s)."""
        return 1e-3 * max(ways_mm(self.policy)) / speed_m_s


@dataclass(frozen=True)
class Library:
    """Primitives that belong together, with how they were found.

    Attributes:
        name: e.g. "robust".
        model_hash: of the model they were found with.
        provenance: how they were found.
        cycles: best first.
    """

    name: str
    model_hash: str
    provenance: Mapping[str, Any]
    primitives: tuple[Primitive, ...]
    cycles: tuple[Cycle, ...] = ()

    @cached_property
    def hash(self) -> str:
        """Identifies the policies: sha256, 16 hex digits."""
        return self._hash_with(f"{c.name} cycle {tuple(map(tuple, map(stage_numbers, c.stages)))}" for c in self.cycles)

    @cached_property
    def primitives_hash(self) -> str:
        """Identifies the primitives alone, whose odds and climbs are the same beside any cycles: the hash without these."""
        return self._hash_with(())

    def _hash_with(self, cycles: Iterable[str]) -> str:
        text = "\n".join([*(f"{p.name} {p.roll_class.name} {p.policy}" for p in self.primitives), *cycles])
        return hashlib.sha256(f"{self.model_hash}\n{text}".encode()).hexdigest()[:16]

    def primitive(self, name: str) -> Primitive:
        """The primitive of that name, or LibraryError naming what there is."""
        for primitive in self.primitives:
            if primitive.name == name:
                return primitive
        raise LibraryError(
            f"library {self.name!r} has no primitive {name!r}: valid are {', '.join(p.name for p in self.primitives)}"
        )

    def gaits(self, source: str, target: str) -> tuple[Gait, ...]:
        """Every gait from `source` to `target`, in the library's order (best first).

        Raises:
            UnknownFaceError, NotAdjacentError.
        """
        require_adjacent(source, target)
        roll_class = class_of(source)
        return tuple(gait_of(p, source, target) for p in self.primitives if p.roll_class is roll_class)


def gait_of(primitive: Primitive, source: str, target: str) -> Gait:
    """One primitive relabelled to one roll of its class; LibraryError if the roll is of the other class."""
    element = carrier(source, target)
    if primitive.roll_class is not class_of(source):
        raise LibraryError(f"primitive {primitive.name} is of class {primitive.roll_class.name}: it cannot roll {source}→{target}")
    return Gait(primitive, source, target, checked_policy(element.relabel(primitive.policy), 10_000, MOST_STAGES), element.proper)


def wanted_chain(library: Library, source: str, faces: Sequence[str], cycle: str = "") -> Chain:
    """The chain over these faces. `cycle`: its name; empty: the library's first. Raises SimError, naming what is valid."""
    if not library.cycles:
        raise RollRefused(f"library {library.name} has no cycles to roll on by: take one that has, such as continuous")
    named = [one for one in library.cycles if one.name == (cycle or library.cycles[0].name)]
    if not named:
        raise RollRefused(f"library {library.name} has no cycle {cycle!r}: valid are {', '.join(c.name for c in library.cycles)}")
    chain = Chain(named[0], (source, *faces))
    assert chain.rolls  # it goes there
    return chain


def load_library(name_or_path: str | Path = "robust") -> Library:
    """Read a shipped library by name, or any by path.

    Raises:
        LibraryError: cannot be read; names file, primitive, what was got and what is valid.
    """
    path = Path(name_or_path)
    shipped = sorted(p.stem for p in LIBRARIES.glob("*.yaml"))
    valid = f"; shipped are: {', '.join(shipped)}; your own is a path that ends in .yaml"
    if path.suffix != ".yaml":
        if str(name_or_path) not in shipped:
            raise LibraryError(f"no library is called {str(name_or_path)!r}{valid}")
        path = LIBRARIES / f"{name_or_path}.yaml"
    return parse_library(read_yaml_or(LibraryError, path, "library", valid), str(path))


def parse_library(document: Any, where: str) -> Library:
    """A library from its parsed YAML. Raises LibraryError."""
    if not isinstance(document, Mapping) or document.get("schema") not in SCHEMAS or "primitives" not in document:
        raise LibraryError(f"{where} is not a primitive library: valid is a mapping with schema: 1 or 2 and primitives: [...]")
    rows, name, provenance = document["primitives"], document.get("name", where), document.get("provenance") or {}
    if not isinstance(rows, list) or not rows:
        raise LibraryError(f"{where}: primitives is {brief(rows)}; valid is a list of one or more")
    if not isinstance(name, str):
        raise LibraryError(f"{where}: name is {brief(name)}; valid is text: write it in quotes")
    if not isinstance(provenance, Mapping):
        raise LibraryError(f"{where}: provenance is {brief(provenance)}; valid is a mapping")
    cycles = parse_cycles(document.get("cycles", []), where) if document["schema"] > 1 else ()
    return Library(name, _text(where, document, "model_hash", ""), dict(provenance), _primitives(rows, where), cycles)


def _text(where: str, row: Mapping[str, Any], key: str, default: str) -> str:
    """Text; a whole number is taken for text that looks like one. Raises LibraryError."""
    value = row.get(key, default)
    if isinstance(value, bool) or not isinstance(value, (str, int)):
        raise LibraryError(f"{where}: {key} is {brief(value)}; valid is text")
    return str(value)


def _primitives(rows: list[Any], where: str) -> tuple[Primitive, ...]:
    primitives, names = [], set()
    for number, row in enumerate(rows, start=1):
        try:
            name = _text(f"{where}: primitive {number}", row, "name", f"P{number}")
            policy = checked_policy(row["policy_mm"], 10_000, MOST_STAGES)
            roll_class = CLASSES[row["class"]]
            margins = {key: float(value) for key, value in dict(row.get("margins") or {}).items()}
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            raise LibraryError(
                f"{where}: primitive {number} is {brief(row)}; "
                f"valid is {{name, class: {' or '.join(CLASSES)}, policy_mm: [six whole mm, or six for each of two stages]}}"
            ) from error
        except PolicyError as error:
            raise LibraryError(f"{where}: primitive {number}: {error}") from error
        if name in names:
            raise LibraryError(f"{where}: two primitives are called {name!r}; names must differ")
        names.add(name)
        primitives.append(Primitive(name, roll_class, policy, margins))
    return tuple(primitives)


def library_text(library: Library) -> str:
    """The YAML of a library."""
    head = {
        "schema": SCHEMAS[bool(library.cycles)],
        "name": library.name,
        "model_hash": library.model_hash,
        "provenance": dict(library.provenance),
    }
    lines = [yaml_text(head) + "primitives:"]
    for p in library.primitives:
        margins = ", ".join(f"{key}: {value:g}" for key, value in p.margins.items())
        policy = ", ".join(map(str, p.policy))
        lines.append(f"- {{name: {p.name}, class: {p.roll_class.name}, policy_mm: [{policy}], margins: {{{margins}}}}}")
    if library.cycles:
        lines.append(cycles_text(library.cycles))
    return sealed("\n".join(lines) + "\n")
