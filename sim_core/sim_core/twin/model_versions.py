# SPDX-License-Identifier: Apache-2.0
"""Models that are frozen: named, so that libraries, bags and figures say which robot they belong to, and never change unnoticed.

The nominal robot of a release is one of them. A change of its numbers, or of the solver's arithmetic, is a new version: a
deliberate line in `data/frozen.yaml`, and every library and recorded session made again.
"""

from typing import NamedTuple

from sim_core.files.bounded_reader import DATA
from sim_core.files.yaml_reader import read_yaml


class Frozen(NamedTuple):
    """One frozen model.

    Attributes:
        version: "v1".
        model_hash: of its elements: every number.
        motion: digest of its state after a certain motion, which holds the solver's arithmetic as well; its test makes it.
    """

    version: str
    model_hash: str
    motion: str


def frozen_models() -> tuple[Frozen, ...]:
    """All versions, oldest first."""
    document = read_yaml(DATA / "frozen.yaml")
    return tuple(Frozen(row["version"], row["model_hash"], row["motion"]) for row in document["models"])


def label_of(model_hash: str) -> str:
    """A model's hash, with its version if it is a frozen one: "v1 (0123456789abcdef)"."""
    version = next((frozen.version for frozen in frozen_models() if frozen.model_hash == model_hash), None)
    return f"{version} ({model_hash})" if version else model_hash
