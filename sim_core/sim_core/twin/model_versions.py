# SPDX-License-Identifier: Apache-2.0
"""Models that are frozen: named, so that libraries, bags and figures say which robot they belong to, and never change unnoticed.

The nominal robot of a release is one of them. A change of its numbers, or of the solver's arithmetic, is a new version: a
deliberate line in `data/frozen.yaml`, and every library and recorded session made again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_core.dynamics.model import Model
from sim_core.dynamics.robot import Robot
from sim_core.files.bounded_reader import DATA
from sim_core.files.yaml_reader import read_yaml

PROBE_M = np.array([0.012, -0.021, -0.008, 0.017, -0.026, 0.005])
"""Strokes of the probe's motion."""
PROBE_S = 2.0


class Frozen(NamedTuple):
    """One frozen model.

    Attributes:
        version: "v1".
        model_hash: of its elements: every number.
        motion: `motion_of` it, which holds the solver's arithmetic as well.
    """

    version: str
    model_hash: str
    motion: str


def frozen_models() -> tuple[Frozen, ...]:
    """All versions, oldest first."""
    document = read_yaml(DATA / "frozen.yaml")
    return tuple(Frozen(row["version"], row["model_hash"], row["motion"]) for row in document["models"])


def motion_of(model: Model) -> str:
    """Digest of the state after settling on TC6 and moving by PROBE_M for PROBE_S: the same on every x86-64 processor."""
    robot = Robot.resting_on(model, "TC6")
    robot.set_targets(model.prototype.strut_length_m + PROBE_M)
    robot.advance(round(PROBE_S * model.steps_per_second))
    return robot.digest()[:16]


def label_of(model_hash: str) -> str:
    """A model's hash, with its version if it is a frozen one: "v1 (0123456789abcdef)"."""
    version = next((frozen.version for frozen in frozen_models() if frozen.model_hash == model_hash), None)
    return f"{version} ({model_hash})" if version else model_hash
