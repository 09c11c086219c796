# SPDX-License-Identifier: Apache-2.0
"""What the command `fit` does, step by step."""

from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from sim_core.dynamics.model import Model
from sim_core.errors import ParameterError
from sim_core.gaits.success_counts import success_counts_text
from sim_core.rolling.warm_up import Stage
from sim_core.studies.ensemble_fit import LEAST, Fit, estimates, fit
from sim_core.studies.gait_learning import WEIGHT, fitted_prior, gaits_of, learned_counts, roll_of, shipped_prior
from sim_core.studies.rehearsal import DEFAULT_MEMBERS
from sim_core.uncertainty.ensemble import Posterior, posterior_text
from sim_core.uncertainty.fit_prior import LABELS, Prior
from sim_core.uncertainty.importance_weights import LAPSE
from tensegrity_lab.studies.fit_trials import Tries
from tensegrity_lab.terminal.compile_notice import compile_first
from tensegrity_lab.terminal.forecast import say_forecast
from tensegrity_lab.terminal.progress import bars

VIRTUAL = "These are virtual trials: the robot shares the model's equations, so this says nothing of a real one."


@dataclass(frozen=True)
class FitOptions:
    """How to fit; see `sim_core.studies.ensemble_fit.fit` and `sim_core.studies.gait_learning.learned_counts`."""

    members: int = 128
    rounds: int = 2
    seed: int = 1
    lapse: float = LAPSE
    prior: Prior = field(default_factory=Prior)
    weight: float = WEIGHT


def prior_of(words: str) -> Prior:
    """A prior from "name=number,name=number". Raises ParameterError: an unknown name, or an impossible number."""
    names = [each.name for each in fields(Prior)]
    given: dict[str, float] = {}
    for word in filter(None, (part.strip() for part in words.split(","))):
        name, _, value = word.partition("=")
        try:
            given[name] = float(value)
        except ValueError:
            name = ""
        if name not in names:
            raise ParameterError(f"--prior {word!r}: valid is NAME=NUMBER with one of {', '.join(names)}")
    return Prior(**given)


def fitted(model: Model, tries: Tries, options: FitOptions, with_probabilities: bool = False) -> Fit:
    """Fit an ensemble, with forecast and progress on standard error. Raises what `fit` raises.

    Args:
        model: the nominal one.
        tries: what was tried, and how it ended.
        options: how many members and rounds.
        with_probabilities: how likely every gait is will be computed after it: part of the forecast.
    """
    compile_first(Stage.BATCH)
    rounds = 1 + options.rounds
    each = options.members * (len({one.roll for one in tries.seen if one.placed}) + sum(not one.placed for one in tries.seen))
    what = f"fitting {options.members} robots to {len(tries.seen)} trials, in {rounds} round(s) at most"
    later = len(gaits_of(tries.library.primitives)) * DEFAULT_MEMBERS if with_probabilities else 0
    say_forecast(what + (", then how likely each gait is" if later else ""), rounds * each + later, model)
    with bars("rolls", "nothing was written; the same command gives the same result later") as bar:
        how = (options.prior, options.members, options.seed, options.lapse, options.rounds)
        return fit(model, tries.seen, *how, lambda number: bar(f"round {number} of at most {rounds}"))


def write_ensemble(path: Path, model: Model, tries: Tries, found: Fit) -> None:
    """Write the ensemble's file. Raises OSError."""
    provenance = {
        "how": "members drawn from a prior, weighted by the likelihood of trials' outcomes",
        **tries.facts,
        "library": tries.library.name,
        "library_hash": tries.library.hash,
        "prior": asdict(found.prior),
        "fit_seed": found.seed,
        "lapse": found.lapse,
        "lapses": [round(lapse, 4) for lapse in found.lapses],
        "effective_sizes": [round(size, 2) for size in found.effective_sizes],
    }
    posterior = Posterior(model.hash, provenance, found.prior.noise, found.members, found.weights)
    path.write_text(posterior_text(posterior), encoding="utf-8")


def write_probabilities(path: Path, model: Model, tries: Tries, found: Fit | None, options: FitOptions) -> None:
    """Write the odds' file: of the fitted ensemble, or without one of the shipped odds; and of each gait's own trials. OSError."""
    source = f"{'virtual ' if tries.virtual else ''}trials of {tries.robot}: {', '.join(tries.sources)}"
    if found is None:
        prior = shipped_prior(tries.library)
        how = f"odds of library {tries.library.name} as shipped, and {source}"
    else:
        gaits = gaits_of(tries.library.primitives)
        with bars("rolls", f"{path} was not written; what is said to be written above is") as bar:
            known = fitted_prior(model, found, tries.seen, gaits, DEFAULT_MEMBERS, bar("how likely each gait is"))
        how = f"an ensemble fitted to, and gait by gait, {source}"

        def prior(gait: Any) -> float:
            return known[roll_of(gait)]

    path.write_text(success_counts_text(learned_counts(tries.library, prior, tries.counts, options.weight, how)), encoding="utf-8")


def document_of(tries: Tries, found: Fit | None) -> dict[str, Any]:
    """For scripts."""
    if found is None:
        return tries.facts
    sizes = {"effective_sizes": list(found.effective_sizes), "lapses": list(found.lapses)}
    return tries.facts | sizes | {"estimates": [one._asdict() for one in _estimates(found)]}


def _estimates(found: Fit) -> list[Any]:
    return estimates(found.parameters, found.weights, LABELS, half_ranges(found.prior))


def half_ranges(prior: Prior) -> list[float]:
    """Of the parameters, in the order of LABELS."""
    return [prior.friction, prior.stiffness, prior.rest_length, *[prior.stroke] * 6, prior.slope_deg, prior.slope_deg]


def text_of(tries: Tries, found: Fit | None) -> str:
    """For people."""
    kind = "virtual trials" if tries.virtual else "trials"
    won = sum(one.won for one in tries.seen)
    lines = [f"{len(tries.seen)} {kind} of {tries.robot} ({', '.join(tries.sources)}): {won} succeeded"]
    if tries.chains:
        lines.append(f"{tries.chains} chain(s) are left out: a fit takes single rolls")
    if found is not None:
        lines += ["", f"{'':<22} {'mean':>7}  {'90 % interval':<18} width over the prior's"]
        lines += [
            f"{one.label:<22} {one.mean:7.3f}  [{one.low:7.3f}, {one.high:7.3f}] {one.told:6.2f}" for one in _estimates(found)
        ]
        sizes = ", ".join(f"{size:.1f}" for size in found.effective_sizes)
        lines += ["", f"prior: {found.prior.text}", f"{len(found.members)} members; effective size after each round: {sizes}"]
        if found.lapses[-1] > found.lapse:
            lines.append(
                f"Too few members foretell all trials: weighed with a lapse rate of {found.lapses[-1]:.2f}, not {found.lapse:g}, "
                "so less is learnt than the trials could tell; more --members or --rounds sharpen it"
            )
        if found.effective_size < LEAST:
            lines.append(f"The effective size is below {LEAST:g}: intervals are too narrow; give more --members")
        if not all(one.placed for one in tries.seen):
            lines.append("In which direction the robot stood is not known: of the slope only the steepness can be told.")
    if tries.virtual:
        lines.append(VIRTUAL)
    return "\n".join(lines)
