# SPDX-License-Identifier: Apache-2.0
"""How likely each of a library's 24 × n gaits is to work: counts from a robustness study, kept in a file of their own."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim_core.errors import LibraryError, YamlError
from sim_core.files.bounded_reader import DATA
from sim_core.files.yaml_reader import read_yaml, sealed, yaml_text
from sim_core.gaits.library import Gait, Library
from sim_core.printable import printable
from sim_core.structure.roll_classes import rolls_of

SCHEMA = 1
MEANS = 9_998
"""Files hold counts over a uniform prior; a probability that was learnt is written as a count out of so many, to 1 in 10,000."""


@dataclass(frozen=True)
class SuccessCounts:
    """Successes of trials, gait by gait.

    Attributes:
        library_hash: whose gaits these are (`Library.primitives_hash`).
        how: law, seed and number of the prototypes, in words.
        trials: of each gait.
        wins: primitive name -> 24 successes, in the order of `rolls_of` its class.
    """

    library_hash: str
    how: str
    trials: int
    wins: Mapping[str, tuple[int, ...]]

    def probability(self, gait: Gait) -> float:
        """That the gait works: mean of the Beta posterior of its counts over a uniform prior (Laplace's rule)."""
        return (self._wins(gait) + 1.0) / (self.trials + 2.0)

    def tries(self, gait: Gait) -> tuple[int, int] | None:
        """Successes and trials of the gait; None where the file holds probabilities that were learnt, and no counts."""
        return None if self.trials == MEANS else (self._wins(gait), self.trials)

    def _wins(self, gait: Gait) -> int:
        return self.wins[gait.primitive.name][rolls_of(gait.primitive.roll_class).index((gait.source, gait.target))]


def success_counts_text(counts: SuccessCounts) -> str:
    """The YAML of how likely a library's gaits are."""
    head = {"schema": SCHEMA, "library_hash": counts.library_hash, "how": counts.how, "trials": counts.trials}
    lines = [yaml_text(head) + "wins:"]
    lines += [f"  {name}: [{', '.join(map(str, wins))}]" for name, wins in counts.wins.items()]
    return sealed("\n".join(lines) + "\n")


def load_success_counts(library: Library, path: Path | None = None) -> SuccessCounts | None:
    """How likely gaits are, from a file, or from the shipped one of these primitives; None if none is shipped.

    Raises:
        LibraryError: a given file that cannot be read, or belongs to another library.
    """
    if path is None:
        for file in sorted((DATA / "odds").glob("*.yaml")):
            with suppress(LibraryError):
                return _counts_of(library, file)
        return None
    return _counts_of(library, path)


def _counts_of(library: Library, file: Path) -> SuccessCounts:
    try:
        document: Any = read_yaml(file)
        counts = SuccessCounts(
            str(document["library_hash"]),
            str(document["how"]),
            int(document["trials"]),
            {str(name): tuple(int(won) for won in row) for name, row in document["wins"].items()},
        )
    except (OSError, YamlError, AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise LibraryError(
            f"cannot read success counts {file}: {printable(error, 200)}; make them with: sixstrut robustness LIBRARY --odds FILE"
        ) from error
    if counts.library_hash != library.primitives_hash:
        raise LibraryError(
            f"success counts {file} are of library {counts.library_hash}, not of {library.name!r} ({library.primitives_hash})"
        )
    return counts
