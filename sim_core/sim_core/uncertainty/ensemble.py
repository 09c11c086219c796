# SPDX-License-Identifier: Apache-2.0
"""A fitted ensemble as one YAML file: members with their weights, and where they come from."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim_core.dynamics.model import Model
from sim_core.errors import SimError, brief
from sim_core.files.yaml_reader import read_yaml_or, sealed, yaml_text
from sim_core.printable import printable
from sim_core.structure.arrays import Array
from sim_core.uncertainty.fit_prior import Member, member_model
from sim_core.uncertainty.importance_weights import effective_size, systematic

SCHEMA = 1
COLUMNS = (
    "weight", "friction", "stiffness", "rest_length", *(f"stroke_{s}" for s in range(1, 7)), "slope_x_deg", "slope_y_deg",
    "seed", "number",
)  # fmt: skip
DIGITS = 8
RESAMPLE_STREAM = 29
HINT = "make it with: sixstrut fit SESSION... --ensemble FILE"


class EnsembleError(SimError):
    """An ensemble that cannot be read, or belongs to another model."""


@dataclass(frozen=True)
class Posterior:
    """Members of an ensemble with weights.

    Attributes:
        model_hash: of the nominal model that the members are relative to.
        provenance: sessions, robot, trials, prior, seed, … for people and for scripts.
        noise: scale of the errors of single members.
        members: robots.
        weights: (members,), sum 1.
    """

    model_hash: str
    provenance: Mapping[str, Any]
    noise: float
    members: tuple[Member, ...]
    weights: Array

    @property
    def text(self) -> str:
        """What the members are, in one line."""
        virtual = "virtual trials" if self.provenance.get("virtual") else "trials"
        size = f"effective size {effective_size(self.weights):.1f}"
        return f"fitted to {self.provenance.get('trials', '?')} {virtual} of {self.provenance.get('robot', '?')}: {size}"

    @property
    def brief(self) -> str:
        """As `text`."""
        return self.text

    def drawn(self, count: int, seed: int) -> tuple[Member, ...]:
        """Members drawn by weight, equally heavy; heavy ones come several times. Raises EnsembleError: none asked for."""
        if count < 1 or seed < 0:
            raise EnsembleError(f"{count} members of seed {seed}: valid are one or more, and a seed of 0 or more")
        chosen = systematic(self.weights, count, np.random.default_rng([seed, RESAMPLE_STREAM]))
        return tuple(self.members[number] for number in chosen)

    def models(self, nominal: Model, count: int, seed: int) -> list[Model]:
        """Robots of `drawn` members. Raises EnsembleError: they are relative to another model. ModelError."""
        self.require(nominal)
        drawn = self.drawn(count, seed)
        built = {member: member_model(nominal, member) for member in dict.fromkeys(drawn)}
        return [built[member] for member in drawn]

    def require(self, nominal: Model) -> None:
        """Raise EnsembleError if the members are relative to another model."""
        if self.model_hash != nominal.hash:
            raise EnsembleError(
                f"the ensemble is of model {self.model_hash}, not {nominal.hash}: fit again with this model, or give the "
                "ensemble's with --prototype"
            )


def posterior_text(posterior: Posterior) -> str:
    """The YAML of an ensemble."""
    head = {
        "schema": SCHEMA,
        "model_hash": posterior.model_hash,
        "provenance": dict(posterior.provenance),
        "noise": posterior.noise,
        "columns": list(COLUMNS),
    }
    lines = [yaml_text(head) + "members:"]
    for weight, member in zip(posterior.weights, posterior.members, strict=True):
        cells = [f"{value:.{DIGITS}g}" for value in (weight, *member.parameters)]
        lines.append(f"- [{', '.join([*cells, str(member.seed), str(member.number)])}]")
    return sealed("\n".join(lines) + "\n")


def load_posterior(path: Path | str) -> Posterior:
    """Read an ensemble.

    Raises:
        EnsembleError: cannot be read, or is none; says what was got and what is valid.
    """
    document = read_yaml_or(EnsembleError, path, "ensemble", f"; {HINT}")
    if not isinstance(document, Mapping) or document.get("schema") != SCHEMA or document.get("columns") != list(COLUMNS):
        raise EnsembleError(f"{path} is not an ensemble of this version: valid is a mapping with schema: {SCHEMA}; {HINT}")
    try:
        noise, rows = float(document["noise"]), [_row(row) for row in document["members"]]
        members = tuple(
            Member(r[1], r[2], r[3], (r[4], r[5], r[6], r[7], r[8], r[9]), (r[10], r[11]), noise, int(r[12]), int(r[13]))
            for r in rows
        )
        weights = np.array([row[0] for row in rows])
        model_hash, provenance = str(document["model_hash"]), dict(document["provenance"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise EnsembleError(
            f"{path}: {printable(error, 160)}; valid members are lists of {len(COLUMNS)} numbers: {', '.join(COLUMNS)}"
        ) from error
    if not len(weights) or (weights < 0.0).any() or not np.isfinite(weights).all() or not weights.sum() > 0.0:
        raise EnsembleError(f"{path}: valid weights are numbers of 0 or more, at least one of them positive")
    return Posterior(model_hash, provenance, noise, members, weights / weights.sum())


def _row(row: Any) -> list[float]:
    if not isinstance(row, list) or len(row) != len(COLUMNS):
        raise ValueError(f"member {brief(row)}")
    values = [float(value) for value in row]
    if not all(map(math.isfinite, values)):
        raise ValueError(f"member {brief(row)}")
    return values
