# SPDX-License-Identifier: Apache-2.0
"""The page learning.md, every figure of it from a demonstration."""

from collections.abc import Sequence
from pathlib import Path

from sim_core.dynamics.model import Model
from sim_core.gaits.library import load_library
from sim_core.rolling.warm_up import Stage
from sim_core.studies.ensemble_fit import LEAST
from sim_core.studies.gait_learning import WEIGHT
from sim_core.studies.rehearsal import DEFAULT_MEMBERS
from tensegrity_lab.reports.markdown import table
from tensegrity_lab.terminal.compile_notice import compile_first
from tensegrity_lab.terminal.progress import bars
from tests.studies.learning import DEFAULT_LAW, LOW_FRICTION, TILT_DEG, Demonstration, RobotCase, Setting, demonstrate

INTRODUCTION = """\
# Learning from trials

`./sixstrut fit SESSION...` turns outcomes into an ensemble of robots that would have had them, for `rehearse --ensemble` and
`search robust --ensemble`, and into odds of every gait on *this* robot (`--odds FILE`), for the planner's parameter
`odds_file` and for `route --odds`. Robots are drawn from a prior, roll every tried gait, and are weighted by the outcomes
that they foretell; how, and what a robot's parameters are, is told in `sim_core/sim_core/uncertainty/importance_weights.py` and
`sim_core/sim_core/uncertainty/fit_prior.py`. If nobody knows which way the robot faced (sessions of the stack, and real
ones), every trial gets a direction of its own. Then only the steepness of the slope can be learnt, not its direction. A tried
gait's odds count its own trials once: the ensemble's part leaves them out.

This page is written by `./sixstrut fit --demonstrate --page`; do not edit it, run the command again. **All trials here are
virtual**: hidden robots and ensemble share the model's equations, so this tests the method, not how well it would do on a
real robot.
"""


FITS = ("robot", "trials won", "friction: hidden; fitted, 90 %", "tilt: fitted mean", "effective size, lapse rate of each round")


def page_of(shown: Demonstration, model_hash: str) -> str:
    """The page, as Markdown. `model_hash`: of the nominal model."""
    s, cases = shown.setting, shown.cases
    low, high = (100 * value for value in LOW_FRICTION)
    fits, scores, picks = list[Sequence[object]](), list[Sequence[object]](), list[Sequence[object]]()
    for number, case in enumerate(cases, start=1):
        f, found = case.estimates[0], case.found
        sizes = ", ".join(f"{size:.0f} at {rate:.2f}" for size, rate in zip(found.effective_sizes, found.lapses, strict=True))
        friction = f"{case.hidden.friction:.2f}; {f.mean:.2f} [{f.low:.2f}, {f.high:.2f}]"
        fits.append((number, f"{case.won} of {s.trials}", friction, f"{case.steepness:.1f}°", sizes))
        scores.append((number, *(f"{score:.3f}" for score in case.scores)))
        picks.append((number, *case.chosen))
    mean = [sum(case.scores[i] for case in cases) / len(cases) for i in range(3)]
    total = [sum(case.chosen[i] for case in cases) for i in range(3)]
    scores.append(("mean", *(f"{value:.3f}" for value in mean)))
    picks.append(("all", *total))
    lines = [
        INTRODUCTION,
        f"Model `{model_hash}`; library `{shown.library.name}` ({shown.library.hash}), the first {s.primitives} primitives of each",
        f"class; seed {s.seed}. Each hidden robot stands on a floor that is tilted by {TILT_DEG:g} degrees in a direction of its",
        f"own, with {low:g} to {high:g} % of the drawing's friction. Of its {shown.gaits} gaits {s.trials} are tried, drawn by the",
        f"seed, and {shown.held_out} are held out. The fit does not know the robot, but a prior ({s.prior.text}).",
        f"It draws {s.members} members in each of up to {s.rounds + 1} rounds; lapse rate {s.lapse:g}, raised until the effective",
        f"size is {LEAST:g}. The default ensemble is that of `rehearse`: {DEFAULT_MEMBERS} robots, {DEFAULT_LAW.text}.",
        "",
        "## What the fits say",
        "",
        table(FITS, fits, "rrlrl"),
        "",
        "## Held-out trials foretold",
        "",
        "Mean logarithm of the probability given to what happened, in nats; nearer to 0 is better, a coin's is −0.693.",
        "",
        table(("robot", "default ensemble", "prior ensemble", "fitted ensemble"), scores, "rrrr"),
        "",
        "## Gaits chosen",
        "",
        "For each of the 48 rolls the likeliest gait is chosen and tried: so many succeed. The fitted odds of a tried gait count",
        f"its own trial, against a prior worth {WEIGHT:g} trials.",
        "",
        table(("robot", "default odds", "fitted odds", "any gait works"), picks, "rrrr"),
        *_searched(cases),
    ]
    return "\n".join(lines) + "\n"


def _searched(cases: Sequence[RobotCase]) -> list[str]:
    rows = []
    for number, case in enumerate(cases, start=1):
        if case.libraries is not None:
            shown = [f"{rate.successes} of {rate.trials}, {100 * rate.value:.1f} %" for rate in case.libraries]
            rows.append((number, *shown))
    if not rows:
        return []
    return [
        "",
        "## A library for this robot",
        "",
        "The search that makes `robust`, on robots of the fitted ensemble instead (`./sixstrut search robust --ensemble FILE`).",
        "Done for those of the robots that the shipped library does worst on; all gaits of both libraries are then tried on them:",
        "",
        table(("robot", "shipped `robust`", "searched on the fitted ensemble"), rows, "rrr"),
    ]


def demonstrated(model: Model, setting: Setting, library: str, path: Path) -> str:
    """Demonstrate on hidden virtual robots; write the page, which is returned. Raises OSError."""
    compile_first(Stage.BATCH)
    with bars("rolls", "nothing was written; the demonstration begins anew") as bar:
        shown = demonstrate(model, load_library(library), setting, bar)
    text = page_of(shown, model.hash)
    path.write_text(text, encoding="utf-8")
    return text
