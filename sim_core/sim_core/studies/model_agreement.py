# SPDX-License-Identifier: Apache-2.0
"""The paper's Table 4 for any list of gaits: which model says that a gait works, and does it?"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sim_core.dynamics.model import Model
from sim_core.errors import LibraryError, SimError, brief
from sim_core.files.yaml_reader import read_yaml_or
from sim_core.gaits.library import Library, gait_of, parse_library
from sim_core.rolling.batch import Job, roll_many
from sim_core.structure.policy import MOST_STAGES, Policy, checked_policy
from sim_core.structure.roll_classes import rolls_of
from sim_core.structure.topology import require_adjacent


class NamedGait(NamedTuple):
    """A gait to be rechecked: a policy for one pair of faces."""

    name: str
    source: str
    target: str
    policy: Policy


class Agreement(NamedTuple):
    """How well predictions match outcomes; a rate is None where nothing was predicted, or nothing succeeded.

    Attributes:
        true_positives, false_positives, false_negatives, true_negatives: counts.
    """

    true_positives: int
    false_positives: int
    false_negatives: int
    true_negatives: int

    @property
    def precision(self) -> float | None:
        """Share of the predicted successes that succeed."""
        predicted = self.true_positives + self.false_positives
        return self.true_positives / predicted if predicted else None

    @property
    def recall(self) -> float | None:
        """Share of the successes that were predicted."""
        succeeded = self.true_positives + self.false_negatives
        return self.true_positives / succeeded if succeeded else None

    @property
    def agreement(self) -> float:
        """Share of all gaits on which prediction and outcome are the same."""
        return (self.true_positives + self.true_negatives) / sum(self)


def compare(predicted: Sequence[bool], succeeded: Sequence[bool]) -> Agreement:
    """Count predictions against outcomes, pair by pair. Raises SimError if there are none."""
    if not predicted:
        raise SimError("there is nothing to compare: no gait has an outcome")
    pairs = list(zip(predicted, succeeded, strict=True))
    return Agreement(*(pairs.count(pair) for pair in ((True, True), (True, False), (False, True), (False, False))))


def load_gaits(path: Path | str, limit_mm: int, every_gait: bool = False) -> tuple[NamedGait, ...]:
    """Read gaits: a file of `gaits: [{name, from, to, policy_mm}]`, or a primitive library.

    Of a library the reference pair's gaits, or all 24 of each primitive with `every_gait`.

    Raises:
        LibraryError: cannot be read; names the row, what was got and what is valid.
    """
    document = read_yaml_or(LibraryError, path, "gaits")
    if isinstance(document, Mapping) and "primitives" in document:
        return gaits_of(parse_library(document, str(path)), every_gait)
    if not isinstance(document, Mapping) or not isinstance(document.get("gaits"), list):
        raise LibraryError(f"{path}: valid is a mapping with gaits: [{{name, from, to, policy_mm}}], or a primitive library")
    return tuple(_gait(str(path), number, row, limit_mm) for number, row in enumerate(document["gaits"], start=1))


def _gait(file: str, number: int, row: Any, limit_mm: int) -> NamedGait:
    try:
        source, target, policy = row["from"], row["to"], row["policy_mm"]
        require_adjacent(source, target)
        return NamedGait(str(row.get("name", number)), source, target, checked_policy(policy, limit_mm, MOST_STAGES))
    except (KeyError, TypeError, AttributeError) as error:
        valid = "{name, from, to, policy_mm: [six whole mm, or six for each of two stages]}"
        raise LibraryError(f"{file}: gait {number} is {brief(row)}; valid is {valid}") from error
    except SimError as error:
        raise LibraryError(f"{file}: gait {number}: {error}") from error


def gaits_of(library: Library, every_gait: bool) -> tuple[NamedGait, ...]:
    """The gaits of a library's primitives: of the reference pair, or all 24."""
    gaits = []
    for primitive in library.primitives:
        for source, target in rolls_of(primitive.roll_class) if every_gait else [tuple(primitive.roll_class)]:
            gait = gait_of(primitive, source, target)
            gaits.append(NamedGait(gait.name, source, target, gait.policy))
    return tuple(gaits)


def verdicts(model: Model, gaits: Sequence[NamedGait]) -> list[bool]:
    """Whether a model (either kind) says that each gait is feasible."""
    jobs = [Job(0, gait.source, gait.policy, gait.target) for gait in gaits]
    return [result.feasible for result in roll_many([model], jobs)]
