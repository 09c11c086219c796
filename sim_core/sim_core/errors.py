# SPDX-License-Identifier: Apache-2.0
"""Errors of the robot model. Each says what was got, what is valid and what to do."""

import reprlib

from sim_core.printable import printable


class SimError(Exception):
    """Base of every error raised by sim_core."""


_SHORT = reprlib.Repr()  # Python 3.11 takes no limits here
_SHORT.maxlevel, _SHORT.maxdict, _SHORT.maxlist, _SHORT.maxtuple = 2, 4, 6, 6
_SHORT.maxstring, _SHORT.maxlong, _SHORT.maxother = 60, 40, 60


def brief(value: object) -> str:
    """A value for an error text, however large it is and whatever is in it."""
    return printable(_SHORT.repr(value), 80)


class FileError(SimError):
    """A file that is not what it should be: `problem`, `remedy`, and its line (from 1) if that is known."""

    kind = "cannot be used"

    def __init__(self, where: str, problem: str, remedy: str, line: int | None = None):
        self.where, self.problem, self.remedy, self.line = where, printable(problem, 160), remedy, line
        at = "" if line is None else f" at line {line}"
        super().__init__(f"{where} {self.kind}{at}: {self.problem}; {remedy}")


class YamlError(FileError):
    """Text that is not YAML, or not as strict as is asked here."""

    kind = "is not valid YAML"


class UnknownFaceError(SimError):
    """A face name that the robot does not have."""

    def __init__(self, face: object):
        self.face = face
        super().__init__(f"unknown face {brief(face)}: valid are TC1..TC8 (closed triangles) and TO1..TO12 (open triangles)")


class NotAdjacentError(SimError):
    """Two faces that share no tendon edge, so that no single roll joins them."""

    def __init__(self, source: str, target: str, neighbours: tuple[str, ...]):
        self.source, self.target, self.neighbours = source, target, neighbours
        super().__init__(f"{target} is not adjacent to {source}: one roll from {source} reaches {', '.join(neighbours)}")


class PolicyError(SimError):
    """A policy that is not six whole-millimetre strokes inside the bound."""


class ParameterError(SimError):
    """A prototype file that cannot be read or holds an impossible value."""


class ModelError(SimError):
    """A model that cannot be built or would not be stable."""


class UnstableStepError(ModelError):
    """The time step is beyond the stability limit of the model."""

    def __init__(self, step_s: float, limit_s: float, valid_steps_per_second: int):
        self.step_s, self.limit_s = step_s, limit_s
        super().__init__(
            f"time step {step_s:.3e} s is not stable: the model's limit is {limit_s:.3e} s "
            f"(shortest struts, all contacts closed); use steps_per_second >= {valid_steps_per_second}"
        )


class DivergedError(SimError):
    """A run produced a value that is not finite."""


class LibraryError(SimError):
    """A primitive library that cannot be read, or belongs to another model."""


class RollRefused(SimError):
    """A roll that is not begun, or given up: one line that says why and what to do."""


class ClusterError(SimError):
    """A cluster that does not answer, has no workers, or whose workers cannot do the work."""
