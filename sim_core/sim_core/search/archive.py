# SPDX-License-Identifier: Apache-2.0
"""The best policies found so far, no two alike: what a generator breeds from, and what its library is chosen from."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from sim_core.structure.policy import Policy


class Candidate(NamedTuple):
    """A policy for the reference pair, with what its trials gave.

    Attributes:
        merit: the more the better; below 1 it did not roll, from 2 on it is feasible (see `fitness`).
        margins: figures of its roll on the nominal robot, and of its trials, by name.
    """

    policy: Policy
    merit: float
    margins: Mapping[str, float]


def distance_mm(a: Policy, b: Policy) -> int:
    """How different two policies are: the largest difference of a strut's stroke."""
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


class Elites:
    """Candidates, best first, of which each differs from all better ones by `apart_mm` or more.

    Attributes:
        apart_mm: see `distance_mm`.
        most: how many are kept.
    """

    def __init__(self, apart_mm: int, most: int, candidates: Iterable[Candidate] = ()):
        self.apart_mm, self.most = apart_mm, most
        self._ranked: list[Candidate] = []
        self.add(candidates)

    def __len__(self) -> int:
        return len(self._ranked)

    @property
    def ranked(self) -> tuple[Candidate, ...]:
        """Best first."""
        return tuple(self._ranked)

    def add(self, candidates: Iterable[Candidate]) -> None:
        """Take in those that are better than every elite near them; elites near a better one leave.

        The order given does not matter: equal merits are ranked by policy.
        """
        found = {candidate.policy: candidate for candidate in [*candidates, *self._ranked]}
        chosen: list[Candidate] = []
        for candidate in sorted(found.values(), key=lambda c: (-c.merit, c.policy)):
            if len(chosen) == self.most:
                break
            if all(distance_mm(candidate.policy, other.policy) >= self.apart_mm for other in chosen):
                chosen.append(candidate)
        self._ranked = chosen

    def count(self, merit: float) -> int:
        """How many have at least this merit."""
        return sum(candidate.merit >= merit for candidate in self._ranked)
