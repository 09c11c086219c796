# SPDX-License-Identifier: Apache-2.0
"""A walk over the face graph that shows different gaits, mirrored ones among them."""

import random
from itertools import pairwise

from sim_core.structure.symmetry import GROUP, REFERENCE_TC, REFERENCE_TO, carrier
from sim_core.structure.topology import NEIGHBOURS

DRAWS = 50
REFERENCE = {REFERENCE_TC: REFERENCE_TO, REFERENCE_TO: REFERENCE_TC}


def next_face(here: str, before: str | None, used: set[int], want_mirror: bool, rng: random.Random) -> str:
    """A neighbour of `here`: by preference not where we came from, by a gait of the 24 not used yet, mirrored if wanted."""
    choices = list(NEIGHBOURS[here])
    rng.shuffle(choices)

    def badness(face: str) -> tuple[bool, bool, bool]:
        element = carrier(here, face)
        return face == before, GROUP.index(element) in used, want_mirror and element.proper

    return min(choices, key=badness)


def walk(start: str, rolls: int, seed: int) -> list[str]:
    """Faces of a walk of `rolls` rolls: every gait another while there are others, at least one mirrored within three rolls.

    From a face of the reference pair it begins with the reference roll.

    Walks are drawn until one of the first three rolls is mirrored; some draws have none, and some walks of two rolls cannot.
    """
    rng = random.Random(seed)
    for _ in range(DRAWS):
        faces, used = [start], set[int]()
        for _ in range(rolls):
            here, before = faces[-1], faces[-2] if len(faces) > 1 else None
            reference = REFERENCE.get(here) if before is None else None
            faces.append(reference or next_face(here, before, used, False, rng))
            used.add(GROUP.index(carrier(here, faces[-1])))
        first = [carrier(a, b) for a, b in pairwise(faces[:4])]
        if any(not element.proper for element in first):
            break
    return faces
