# SPDX-License-Identifier: Apache-2.0
"""Reads a lock of requirements/: which packages, with which hashes, hold for which Python."""

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

# What a marker in the lock may say. Only these forms occur; anything else is an error, not a guess.
_COMPARISONS: dict[str, Callable[[tuple[int, ...], tuple[int, ...]], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
}
_PYTHON = re.compile(r"python(?:_full)?_version (<=|>=|<|>|==) '([\d.]+?)(?:\.\*)?'")
_FIXED = {"sys_platform == 'win32'": False, "platform_python_implementation != 'PyPy'": True}


@dataclass(frozen=True)
class Requirement:
    """One package of the lock."""

    name: str
    version: str
    marker: str  # empty: holds everywhere
    hashes: tuple[str, ...]  # "sha256:…"
    text: str  # the lines of the lock, verbatim

    def holds_for(self, python: tuple[int, int]) -> bool:
        """Whether the package is wanted by this version of Python."""
        return all(_clause_holds(clause.strip(), python) for clause in self.marker.split(" and ") if clause.strip())


def _clause_holds(clause: str, python: tuple[int, int]) -> bool:
    if clause in _FIXED:
        return _FIXED[clause]
    match = _PYTHON.fullmatch(clause)
    if match is None:
        raise ValueError(f"lock: unknown marker {clause!r}")
    compare, version = match.groups()
    return _COMPARISONS[compare](python, tuple(int(part) for part in version.split(".")))


def read_lock(path: Path) -> list[Requirement]:
    r"""The lock's requirements in order. Each is a line `name==version ; marker \` followed by its hashes."""
    joined = re.sub(r"\\\n\s*", " ", path.read_text(encoding="utf-8"))
    requirements = []
    for line in joined.splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        spec, *hashes = line.split(" --hash=")
        head, _, marker = spec.partition(";")
        name, equals, version = head.strip().partition("==")
        if not equals or not hashes:
            raise ValueError(f"{path.name}: no exact version or no hash: {line[:80]!r}")
        sums = tuple(h.strip() for h in hashes)
        text = f"{spec.strip()} " + " ".join(f"--hash={h}" for h in sums)
        requirements.append(Requirement(name, version.strip(), marker.strip(), sums, text))
    return requirements
