# SPDX-License-Identifier: Apache-2.0
"""The two classes of rolls, TC onto TO and TO onto TC: all rolls of a class are one roll under the symmetry group."""

from typing import NamedTuple

from sim_core.structure.symmetry import REFERENCE_TC, REFERENCE_TO
from sim_core.structure.topology import PAIRS


class RollClass(NamedTuple):
    """One of the two classes of rolls, named by its reference pair."""

    source: str
    target: str

    @property
    def name(self) -> str:
        """Its reference pair, such as TC6-TO5."""
        return f"{self.source}-{self.target}"


TC_TO = RollClass(REFERENCE_TC, REFERENCE_TO)
TO_TC = RollClass(REFERENCE_TO, REFERENCE_TC)
CLASSES = {roll_class.name: roll_class for roll_class in (TC_TO, TO_TC)}


def class_of(source: str) -> RollClass:
    """The class of the rolls that start on `source`."""
    return TC_TO if source.startswith("TC") else TO_TC


def rolls_of(roll_class: RollClass) -> tuple[tuple[str, str], ...]:
    """The 24 (source, target) rolls of a class."""
    return PAIRS if roll_class is TC_TO else tuple((to, tc) for tc, to in PAIRS)
