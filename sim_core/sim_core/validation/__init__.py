# SPDX-License-Identifier: Apache-2.0
"""The validation suite: the solver against closed forms and independent computations, one small module a topic.

Every case is a function of a `Setting` that returns a `Case`: a number measured on the solver, a reference that the solver had no
part in, a tolerance. `sixstrut validate` runs them all and writes docs/results/validation.md with --page; the tests run the same
functions.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import NamedTuple

from sim_core.validation.cases import (
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
from sim_core.validation.harness.case import Case, Curve, Picture, Setting

__all__ = ["CASES", "TOPICS", "Case", "Curve", "Picture", "Setting", "Topic"]

CaseFunction = Callable[[Setting], Case]


class Topic(NamedTuple):
    """Cases that belong together. `about`: what they are about, from their module's docstring."""

    title: str
    module: ModuleType
    cases: tuple[CaseFunction, ...]

    @property
    def about(self) -> str:
        """What the cases are about, in one line."""
        return " ".join((self.module.__doc__ or "").split())


TOPICS: tuple[Topic, ...] = (
    Topic(
        "Struts: small vibrations",
        beams,
        (
            beams.axial_frequency,
            beams.axial_limit,
            beams.torsional_frequency,
            beams.bending_frequency,
            beams.bending_limit,
        ),
    ),
    Topic(
        "Struts: large bending",
        large_rotation,
        (
            large_rotation.end_moment_circle,
            large_rotation.end_moment_order,
            large_rotation.elastica_tip_load,
            large_rotation.elastica_order,
        ),
    ),
    Topic("Struts: total and incremental form", incremental, (incremental.total_against_incremental,)),
    Topic("Ropes and prestress", cables, (cables.cable_slackening, cables.self_stress_ratio)),
    Topic("Free bodies", free_body, (free_body.linear_momentum, free_body.angular_momentum, free_body.energy)),
    Topic(
        "Ground and friction",
        contact,
        (
            contact.block_sliding_to_rest,
            contact.slope_below_friction_angle,
            contact.slope_above_friction_angle,
            contact.robot_on_slope,
            contact.restitution_law,
            contact.restitution_at_own_step,
        ),
    ),
    Topic(
        "Motion, and the time step's order", convergence, (convergence.robot_motion, convergence.robot_order, convergence.top_order)
    ),
    Topic(
        "The time step's limit",
        time_limit,
        (time_limit.limit_at_mid_stroke, time_limit.limit_at_shortest, time_limit.limit_on_the_ground),
    ),
    Topic(
        "The whole robot",
        whole_robot,
        (
            whole_robot.frequency_by_eigenvalues,
            whole_robot.frequency_by_spectrum,
            whole_robot.elements_per_strut,
            whole_robot.equivariance,
            whole_robot.lanes,
        ),
    ),
    Topic(
        "Outcomes",
        step_size_outcomes,
        (step_size_outcomes.same_face_at_a_finer_step, step_size_outcomes.same_face_with_stiffer_struts),
    ),
)

CASES: dict[str, CaseFunction] = {function.__name__: function for topic in TOPICS for function in topic.cases}
"""Every case by the name that `sixstrut validate --only` and the pictures' files use."""
