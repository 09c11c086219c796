# SPDX-License-Identifier: Apache-2.0
"""Outcomes of rolls at the robot's time step and at an eighth of it, for policies that roll at either.

They are random ones, and the shipped library's shifted by up to 2 mm a strut. Also: does a ten times stiffer strut, rigid for all
purposes, change outcomes?
"""

from dataclasses import replace

import numpy as np

from sim_core.dynamics.model import build_model
from sim_core.gaits.library import load_library
from sim_core.rolling.batch import Batch, Job
from sim_core.rolling.roll import RollResult
from sim_core.structure.parameters import Prototype
from sim_core.structure.policy import checked_policy
from sim_core.structure.roll_classes import TC_TO, TO_TC
from tests.validation.harness.case import Case, Comparison, Setting

FINER = 8
STIFFER = 10.0
SHIFT_MM = 2


def _policies(prototype: Prototype, full: bool) -> list[Job]:
    """Random policies from both reference faces, then the library's, shifted."""
    rng, limit = np.random.default_rng(17), prototype.policy_limit_mm
    jobs = [
        Job(0, roll_class.source, checked_policy(rng.integers(-limit, limit + 1, 6).tolist(), limit))
        for roll_class, count in ((TO_TC, 192 if full else 16), (TC_TO, 320 if full else 0))
        for _ in range(count)
    ]
    for primitive in load_library("robust").primitives:
        for _ in range(4 if full else 1):
            shifted = np.clip(np.array(primitive.policy) + rng.integers(-SHIFT_MM, SHIFT_MM + 1, 6), -limit, limit)
            jobs.append(Job(0, primitive.roll_class.source, checked_policy(shifted.tolist(), limit), primitive.roll_class.target))
    return jobs


def _end(result: RollResult) -> str | None:
    return (result.returned or result.actuated).face


def _compared(setting: Setting, other: Prototype, name: str, checked: str, source: str) -> Case:
    jobs = _policies(setting.prototype, setting.full)
    ours, theirs = (Batch([build_model(prototype)]).run(jobs) for prototype in (setting.prototype, other))
    pairs = [(a, b) for a, b in zip(ours, theirs, strict=True) if a.feasible or b.feasible]
    differing = [(a, b) for a, b in pairs if _end(a) != _end(b)]
    listed = "; ".join(
        f"{a.source}, {' '.join(f'{v:+d}' for v in a.policy)} mm: {_end(a) or a.reason} against {_end(b) or b.reason}, "
        f"margin {1e3 * a.margin_m:.1f} mm against {1e3 * b.margin_m:.1f} mm"
        for a, b in differing
    )
    return Case(
        name,
        checked,
        source,
        Comparison((len(pairs) - len(differing)) / len(pairs), 1.0, "1", 0.1),
        note=f"{len(pairs)} of {len(jobs)} policies roll in either run; {f'differing: {listed}' if listed else 'none differs'}.",
    )


def same_face_at_a_finer_step(setting: Setting) -> Case:
    """Δt against Δt/8."""
    finer = replace(setting.prototype, steps_per_second=FINER * setting.prototype.steps_per_second)
    return _compared(
        setting,
        finer,
        "final face at the robot's time step and at an eighth of it",
        f"Share of the policies that roll at Δt or at Δt/{FINER} and end on the same face.",
        "at least nine of ten; contact and friction make single outcomes at the edge depend on anything",
    )


def same_face_with_stiffer_struts(setting: Setting) -> Case:
    """Struts ten times stiffer in every way: are they rigid in effect?"""
    p = setting.prototype
    stiffer = replace(
        p,
        strut_axial_stiffness_n_m=STIFFER * p.strut_axial_stiffness_n_m,
        strut_bending_stiffness_n_m2=STIFFER * p.strut_bending_stiffness_n_m2,
        strut_torsion_stiffness_n_m2=STIFFER * p.strut_torsion_stiffness_n_m2,
        steps_per_second=int(np.ceil(np.sqrt(STIFFER))) * p.steps_per_second,
    )
    return _compared(
        setting,
        stiffer,
        "final face with stiffer struts",
        f"Share of the policies that roll with the struts' EA, EI and GJ or with {STIFFER:g} times those and end on the same face.",
        "at least nine of ten; the struts were chosen soft for the sake of the time step",
    )
