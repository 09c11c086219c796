# SPDX-License-Identifier: Apache-2.0
"""`sixstrut recheck`: which model predicts gaits better?"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, say

if TYPE_CHECKING:
    from tensegrity_lab.bags.roll_attempts import Attempt


def command(
    gaits: Annotated[Path, typer.Argument(help="YAML of gaits: [{name, from, to, policy_mm}], or a primitive library.")],
    bag: Annotated[list[Path] | None, typer.Option("--bag", help="Experiments: bags of the robot; may be given often.")] = None,
    perturbation: Annotated[float, typer.Option(help="Without bags: scale of the virtual prototypes, 0.05 for ±5 %.")] = 0.05,
    prototypes: Annotated[int, typer.Option(min=1, help="Without bags: how many virtual prototypes try each gait.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Of the first virtual prototype.")] = 1,
    every_gait: Annotated[bool, typer.Option("--every-gait", help="Of a library: all 24 gaits of each primitive.")] = False,
    prototype: options.Prototype = None,
    as_json: options.Json = False,
) -> None:
    """The paper's Table 4 for any list of gaits: feasible by the previous model, by the improved model, and by experiment.

    With the precision, recall and agreement of each model.

    sixstrut recheck gaits.yaml
    sixstrut recheck gaits.yaml --bag bags/monday --bag bags/tuesday
    sixstrut recheck library.yaml --every-gait --perturbation 0.1
    """
    announce(f"rolling the gaits of {gaits} by both models, some seconds for a few hundred; Ctrl-C leaves at any time")
    from sim_core.dynamics.model import build_model
    from sim_core.rolling.warm_up import Stage
    from sim_core.structure.elements import PREVIOUS
    from sim_core.structure.parameters import load_prototype
    from sim_core.structure.policy import in_stages
    from sim_core.studies.model_agreement import compare, load_gaits, verdicts
    from sim_core.uncertainty.perturbation_law import perturb
    from tensegrity_lab.terminal.compile_notice import compile_first
    from tensegrity_lab.terminal.leaving import leaves_at_once

    robot = load_prototype(prototype)
    listed = load_gaits(gaits, robot.policy_limit_mm, every_gait)
    improved = build_model(robot)
    compile_first(Stage.BATCH)
    with leaves_at_once("this command writes nothing"):
        predictions = {"previous": verdicts(build_model(robot, kind=PREVIOUS), listed), "improved": verdicts(improved, listed)}
        columns = [] if bag else [verdicts(perturb(improved, perturbation, seed + k), listed) for k in range(prototypes)]
    if bag:
        tries = _tries_in_bags(bag, robot.strut_length_m)
        trials = [
            [o.succeeded(g.target) for o in tries if (o.source, o.policy) == (g.source, in_stages(g.policy)[-1])] for g in listed
        ]
        kind = "trials in the bags"
    else:
        trials = [list(row) for row in zip(*columns, strict=True)]
        kind = (
            f"virtual trials on {prototypes} prototype(s) at ±{100 * perturbation:g} % from seed {seed}; the prototypes share the "
            "improved model's equations, so its agreement tests the software, not the paper's claim"
        )
    scores = {
        name: compare(
            [says for says, tried in zip(said, trials, strict=True) for _ in tried],
            [outcome for tried in trials for outcome in tried],
        )
        for name, said in predictions.items()
        if any(trials)
    }
    judged = list(zip(listed, predictions["previous"], predictions["improved"], trials, strict=True))
    if as_json:
        rows = [{**gait._asdict(), "previous": p, "improved": i, "trials": tried} for gait, p, i, tried in judged]
        figures = {
            name: {**score._asdict(), "precision": score.precision, "recall": score.recall, "agreement": score.agreement}
            for name, score in scores.items()
        }
        typer.echo(json.dumps({"experiment": kind, "gaits": rows, "models": figures}))
        return
    say(f"{'gait':<18} {'roll':<12} {'policy (mm)':<28} {'previous':<9} {'improved':<9} experiment")
    for gait, p, i, tried in judged:
        policy = " ".join(f"{v:+d}" for v in gait.policy)
        say(f"{gait.name:<18} {gait.source + '→' + gait.target:<12} {policy:<28} {_word(p):<9} {_word(i):<9} {_outcome(tried)}")
    say(f"\nexperiment: {kind}")
    for name, score in scores.items():
        say(
            f"{name + ' model':<16} precision {_percent(score.precision)}, recall {_percent(score.recall)}, "
            f"agreement {_percent(score.agreement)} ({score.true_positives + score.true_negatives} of {sum(score)})"
        )
    if not scores:
        typer.echo("no gait of the list was tried in the bags")


def _tries_in_bags(bags: Sequence[Path], mid_stroke_m: float) -> list[Attempt]:
    from hardware_bridge.recording.bag_reader import read_session
    from hardware_bridge.recording.bag_types import TOPICS
    from tensegrity_lab.bags.roll_attempts import attempts_of

    return [outcome for path in bags for outcome in attempts_of(read_session(path, topics=TOPICS), mid_stroke_m)]


def _word(feasible: bool) -> str:
    return "rolls" if feasible else "no"


def _outcome(tried: Sequence[bool]) -> str:
    if not tried:
        return "not tried"
    return _word(tried[0]) if len(tried) == 1 else f"{sum(tried)} of {len(tried)}"


def _percent(rate: float | None) -> str:
    return "none predicted" if rate is None else f"{100 * rate:.2f} %"
