# SPDX-License-Identifier: Apache-2.0
"""The six-strut tensegrity: nodes, struts, tendons, faces and which faces touch.

Numbers in names start at 1 (node 1..12, S1..S6, T1..T24); array indices start at 0. Coordinates are in units of the strut
length, centre at the origin. The numbering satisfies every adjacency that the paper's prose names; it is a consistent
numbering, not provably the paper's own.
"""

from itertools import combinations

import numpy as np

from sim_core.errors import NotAdjacentError, UnknownFaceError

JOINTS, POINTS_PER_JOINT = 12, 5
"""Joints, and the corners of each that may touch the ground."""

NODES = np.array(
    [
        [0, 0.25, 0.5],
        [0, 0.25, -0.5],
        [0.25, -0.5, 0],
        [0.25, 0.5, 0],
        [-0.25, -0.5, 0],
        [-0.25, 0.5, 0],
        [0.5, 0, 0.25],
        [-0.5, 0, 0.25],
        [0, -0.25, -0.5],
        [0, -0.25, 0.5],
        [0.5, 0, -0.25],
        [-0.5, 0, -0.25],
    ]
)
"""Node positions / strut length, shape (12, 3)."""
NODES.setflags(write=False)

STRUTS: tuple[tuple[int, int], ...] = ((0, 1), (2, 3), (4, 5), (6, 7), (8, 9), (10, 11))
"""The two node indices of struts S1..S6."""

TENDON_LENGTH = float(np.sqrt(6) / 4)
"""Length of every tendon / strut length."""


def _tendons() -> tuple[tuple[int, int], ...]:
    return tuple(
        (i, j) for i, j in combinations(range(12), 2) if abs(float(np.linalg.norm(NODES[i] - NODES[j])) - TENDON_LENGTH) < 1e-9
    )


TENDONS = _tendons()
"""The 24 node-index pairs joined by a tendon, in lexicographic order."""

FACES: dict[str, tuple[int, int, int]] = {
    name: (a - 1, b - 1, c - 1)
    for name, (a, b, c) in {
        "TC1": (1, 4, 7),
        "TC2": (1, 6, 8),
        "TC3": (2, 4, 11),
        "TC4": (2, 6, 12),
        "TC5": (3, 7, 10),
        "TC6": (3, 9, 11),
        "TC7": (5, 8, 10),
        "TC8": (5, 9, 12),
        "TO1": (1, 4, 6),
        "TO2": (1, 7, 10),
        "TO3": (1, 8, 10),
        "TO4": (2, 4, 6),
        "TO5": (2, 9, 11),
        "TO6": (2, 9, 12),
        "TO7": (3, 5, 9),
        "TO8": (3, 5, 10),
        "TO9": (3, 7, 11),
        "TO10": (4, 7, 11),
        "TO11": (5, 8, 12),
        "TO12": (6, 8, 12),
    }.items()
}
"""Face name -> its three node indices. TC: closed triangle (three tendon edges); TO: open triangle (two tendon edges)."""

FACE_OF_NODES: dict[frozenset[int], str] = {frozenset(nodes): name for name, nodes in FACES.items()}


def _touch(a: str, b: str) -> bool:
    """Two faces touch when they share an edge that is a tendon."""
    shared = sorted(set(FACES[a]) & set(FACES[b]))
    return len(shared) == 2 and (shared[0], shared[1]) in TENDONS


NEIGHBOURS: dict[str, tuple[str, ...]] = {a: tuple(b for b in FACES if b != a and _touch(a, b)) for a in FACES}
"""Face name -> the faces that one roll over a tendon edge reaches: three TO from a TC, two TC from a TO."""

PAIRS: tuple[tuple[str, str], ...] = tuple((tc, to) for tc in FACES if tc.startswith("TC") for to in NEIGHBOURS[tc])
"""The 24 adjacent (TC, TO) pairs."""


def require_face(face: str) -> str:
    """Return `face`; raise UnknownFaceError if the robot has no such face."""
    if face not in FACES:
        raise UnknownFaceError(face)
    return face


def require_adjacent(source: str, target: str) -> None:
    """Raise UnknownFaceError or NotAdjacentError unless one roll joins the two faces."""
    require_face(source)
    require_face(target)
    if target not in NEIGHBOURS[source]:
        raise NotAdjacentError(source, target, NEIGHBOURS[source])
