# SPDX-License-Identifier: Apache-2.0
"""The graph of faces: from each face the rolls over its tendon edges, with all gaits that do them and their probabilities."""

import math
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from sim_core.errors import LibraryError
from sim_core.gaits.library import Gait, Library
from sim_core.structure.topology import FACES, NEIGHBOURS, require_adjacent, require_face

UNTRIED = 0.5
"""Probability of success of a gait of which nothing is known."""


class Believes(Protocol):
    """Anything that knows how probable a library's gaits are to work: `SuccessCounts`, or what was learnt since."""

    def probability(self, gait: Gait) -> float:
        """That the gait works."""
        ...


class Choice(NamedTuple):
    """A gait for a roll, with its probability of success."""

    gait: Gait
    probability: float


class Route(NamedTuple):
    """A sequence of rolls.

    Attributes:
        faces: from the first to the last.
        choices: the most reliable gait of each roll.
        probability: that all of them work at first try, taken as independent.
    """

    faces: tuple[str, ...]
    choices: tuple[Choice, ...]
    probability: float


class FaceGraph:
    """The 48 rolls between 20 faces with a library's gaits.

    Attributes:
        library, believed: what it was made of; believed None: a primitive's own success rate in training stands for its 24 gaits.
    """

    def __init__(self, library: Library, believed: Believes | None = None):
        self.library, self.believed = library, believed
        self._choices = {
            (source, target): self._ranked(library.gaits(source, target))
            for source, targets in NEIGHBOURS.items()
            for target in targets
        }

    def probability(self, gait: Gait) -> float:
        """That the gait works."""
        if self.believed is not None:
            return self.believed.probability(gait)
        return float(gait.primitive.margins.get("success", UNTRIED))

    def _ranked(self, gaits: tuple[Gait, ...]) -> tuple[Choice, ...]:
        choices = [Choice(gait, self.probability(gait)) for gait in gaits]
        return tuple(sorted(choices, key=lambda choice: -choice.probability))  # stable: of equals, the library's order

    def choices(self, source: str, target: str) -> tuple[Choice, ...]:
        """Every gait of a roll, the most reliable first. Raises UnknownFaceError, NotAdjacentError."""
        require_adjacent(source, target)
        return self._choices[source, target]

    def best(self, source: str, target: str) -> Choice:
        """The most reliable gait of a roll.

        Raises:
            UnknownFaceError, NotAdjacentError, LibraryError: the library has no gait of that class.
        """
        choices = self.choices(source, target)
        if not choices:
            raise LibraryError(f"library {self.library.name} has no primitive for {source}→{target}")
        return choices[0]

    def route(self, source: str, target: str) -> Route:
        """The sequence of rolls that is the most likely to work as a whole (shortest path by −log of its probability).

        Raises:
            UnknownFaceError, LibraryError: the library's gaits do not lead there.
        """
        names = list(FACES)
        start, end = names.index(require_face(source)), names.index(require_face(target))
        if start == end:
            return Route((source,), (), 1.0)
        cost = np.zeros((len(names), len(names)))
        for (a, b), choices in self._choices.items():
            if choices and choices[0].probability > 0.0:
                # a sure roll still costs something: of equally likely routes the shorter one
                cost[names.index(a), names.index(b)] = 1e-6 - math.log(choices[0].probability)
        distance, before = dijkstra(csr_array(cost), indices=start, return_predecessors=True)
        if not np.isfinite(distance[end]):
            raise LibraryError(f"the gaits of library {self.library.name} do not lead from {source} to {target}")
        faces = [target]
        while faces[-1] != source:
            faces.append(names[int(before[names.index(faces[-1])])])
        faces.reverse()
        chosen = tuple(self.best(a, b) for a, b in pairwise(faces))
        return Route(tuple(faces), chosen, math.prod(choice.probability for choice in chosen))
