# SPDX-License-Identifier: Apache-2.0
"""The robot's symmetry group T_h (24 elements, 12 of them reflections) and the 24 gaits it makes of one primitive.

The elements are the signed cyclic permutation matrices acting on the body coordinates of `topology.NODES`. Exactly one
element carries the reference pair (TC6, TO5) to each of the 24 adjacent (TC, TO) pairs, so a policy found for the reference
pair, relabelled by that element, is a gait between that pair, in either direction.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from sim_core.structure.topology import FACE_OF_NODES, FACES, NODES, STRUTS, require_adjacent

REFERENCE_TC, REFERENCE_TO = "TC6", "TO5"


@dataclass(frozen=True, eq=False)
class Element:
    """One element g of the group; there is one object for each, so elements are compared by identity.

    Attributes:
        matrix: G, shape (3, 3), orthogonal; carries body coordinates of node i to those of node `nodes[i]`.
        nodes: node index -> node index, length 12.
        struts: strut index -> strut index, length 6.
        proper: True for a rotation, False for a reflection, rotoreflection or the inversion.
    """

    matrix: NDArray[np.float64]
    nodes: tuple[int, ...]
    struts: tuple[int, ...]
    proper: bool

    def face(self, face: str) -> str:
        """The face onto which this element carries `face`."""
        return FACE_OF_NODES[frozenset(self.nodes[i] for i in FACES[face])]

    def relabel(self, policy: Sequence[int]) -> tuple[int, ...]:
        """The policy of the carried gait, stage by stage: the new command of strut g(s) is the old command of s."""
        carried = [0] * len(policy)
        for place, stroke in enumerate(policy):
            carried[place - place % 6 + self.struts[place % 6]] = stroke
        return tuple(carried)


def _element(matrix: NDArray[np.float64]) -> Element:
    nodes = tuple(int(np.argmin(np.linalg.norm(NODES - matrix @ node, axis=1))) for node in NODES)
    ends = [frozenset(strut) for strut in STRUTS]
    struts = tuple(ends.index(frozenset(nodes[i] for i in strut)) for strut in STRUTS)
    matrix.setflags(write=False)
    return Element(matrix, nodes, struts, bool(np.linalg.det(matrix) > 0))


_SHIFTS = [np.roll(np.eye(3), shift, axis=0) for shift in range(3)]
GROUP = tuple(_element(np.diag(signs) @ shift) for shift in _SHIFTS for signs in product((1.0, -1.0), repeat=3))
"""The 24 elements; the first is the identity."""
CARRIERS = {(element.face(REFERENCE_TC), element.face(REFERENCE_TO)): element for element in GROUP}
"""(TC, TO) -> the one element that carries the reference pair there."""


def carrier(source: str, target: str) -> Element:
    """The element that carries the reference roll of the right class to the roll `source` -> `target`.

    Raises:
        UnknownFaceError, NotAdjacentError: no single roll joins the two faces.
    """
    require_adjacent(source, target)
    return CARRIERS[(source, target) if source.startswith("TC") else (target, source)]
