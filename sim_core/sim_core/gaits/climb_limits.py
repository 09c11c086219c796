# SPDX-License-Identifier: Apache-2.0
"""How steep a library's gaits still roll straight uphill, with actuators that feel their load: a number for each primitive.

Symmetry makes it the same for all 24 gaits of a primitive. Gaits that are equally sure on level ground are not so on a slope.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sim_core.errors import YamlError
from sim_core.files.bounded_reader import DATA
from sim_core.files.yaml_reader import read_yaml, sealed, yaml_text
from sim_core.gaits.library import Gait, Library

SCHEMA = 1
USUAL_DEG: Mapping[str, float] = {"TC": 1.8, "TO": 5.5}
"""For a library of which nothing was measured, by the source's kind: about the median of the shipped library `robust`."""
LEAST_DEG = 1.0
"""A gait that climbs less, or does not even roll on level ground, is taken for one that climbs this much."""


@dataclass(frozen=True)
class Climbs:
    """What was measured of a library's primitives on the nominal robot.

    Attributes:
        library_hash: whose primitives these are.
        how: robot and actuators, in words.
        steepest_deg: primitive name -> the steepest ground that it climbed straight uphill, to rest there; 0: not even level.
    """

    library_hash: str
    how: str
    steepest_deg: Mapping[str, float]

    def of(self, gait: Gait) -> float:
        """The steepest ground in degrees that the gait climbs, at least LEAST_DEG."""
        return max(LEAST_DEG, self.steepest_deg[gait.primitive.name])

    def on_level(self, gait: Gait) -> float:
        """What is left, on level ground, of a probability found with ideal actuators: a gait with little to spare will hardly do.

        A logistic curve, hand-chosen: 0.27 for one that did not roll, 0.5 at a quarter of a degree, 0.95 at one.
        """
        return 1.0 / (1.0 + math.exp(1.0 - 4.0 * self.steepest_deg[gait.primitive.name]))


def usual_deg(gait: Gait) -> float:
    """What a gait climbs, in degrees, if nobody measured it."""
    return USUAL_DEG[gait.source[:2]]


def climbs_text(climbs: Climbs) -> str:
    """The YAML of what was measured."""
    head = {"schema": SCHEMA, "library_hash": climbs.library_hash, "how": climbs.how}
    document = {**head, "steepest_deg": dict(climbs.steepest_deg)}
    return sealed(yaml_text(document))


def load_climbs(library: Library) -> Climbs | None:
    """What was measured of a shipped library's primitives; None if nothing was."""
    for file in sorted((DATA / "climbs").glob("*.yaml")):
        try:
            document: Any = read_yaml(file)
            steepest = {str(name): float(deg) for name, deg in document["steepest_deg"].items()}
            climbs = Climbs(str(document["library_hash"]), str(document["how"]), steepest)
        except (OSError, YamlError, AttributeError, KeyError, TypeError, ValueError, OverflowError):
            continue
        if climbs.library_hash == library.primitives_hash:
            return climbs
    return None
