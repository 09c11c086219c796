# SPDX-License-Identifier: Apache-2.0
"""The validation suite: the solver against closed forms and independent computations, one small module a topic.

Every case is a function of a `Setting` that returns a `Case`: a number measured on the solver, a reference that the solver had no
part in, a tolerance. `sixstrut validate` runs them all and writes docs/results/validation.md with --page; the tests run the same
functions.
"""

from collections.abc import Callable
from inspect import isfunction
from types import ModuleType
from typing import NamedTuple

from tests.validation.cases import (
    beams,
    cables,
    contact,
    convergence,
    free_body,
    incremental,
    large_rotation,
    step_size_outcomes,
    time_limit,
    whole_robot,
)
from tests.validation.harness.case import Case, Comparison, Curve, Picture, Setting

__all__ = ["CASES", "TOPICS", "Case", "Comparison", "Curve", "Picture", "Setting", "Topic"]

CaseFunction = Callable[[Setting], Case]


class Topic(NamedTuple):
    """Cases that belong together: those of a module."""

    title: str
    module: ModuleType

    @property
    def about(self) -> str:
        """What the cases are about, in one line: their module's docstring."""
        return " ".join((self.module.__doc__ or "").split())

    @property
    def cases(self) -> dict[str, CaseFunction]:
        """The module's public functions that make a case, by name, in its order."""
        functions = [function for function in vars(self.module).values() if isfunction(function)]
        own = [function for function in functions if function.__module__ == self.module.__name__ and function.__name__[0] != "_"]
        return {function.__name__: function for function in own if function.__annotations__["return"] is Case}


TOPICS: tuple[Topic, ...] = (
    Topic("Struts: small vibrations", beams),
    Topic("Struts: large bending", large_rotation),
    Topic("Struts: total and incremental form", incremental),
    Topic("Ropes and prestress", cables),
    Topic("Free bodies", free_body),
    Topic("Ground and friction", contact),
    Topic("Motion, and the time step's order", convergence),
    Topic("The time step's limit", time_limit),
    Topic("The whole robot", whole_robot),
    Topic("Outcomes", step_size_outcomes),
)

CASES: dict[str, CaseFunction] = {name: function for topic in TOPICS for name, function in topic.cases.items()}
"""Every case by the name that `sixstrut validate --only` and the pictures' files use."""
