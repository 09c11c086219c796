# SPDX-License-Identifier: Apache-2.0
"""`sixstrut roll`: simulate one roll and judge it."""

import json
import math
from typing import Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, say, wrote

TOLD = ["source", "target", "feasible", "reason", "faces", "peak_force_n", "clearance_m", "margin_m", "duration_s", "travel_m"]
"""Of a roll, with --json."""


def command(
    source: Annotated[str, typer.Option("--from", help="Face the robot rests on: TC1..TC8, TO1..TO12.")] = "TC6",
    target: Annotated[str, typer.Option("--to", help="Adjacent face to roll onto.")] = "TO5",
    policy: Annotated[
        str | None, typer.Option("--policy", help='Six strokes in whole mm, S1..S6, + lengthens: "-31 36 17 37 -34 -43".')
    ] = None,
    primitive: Annotated[str | None, typer.Option("--primitive", help="A primitive of the library; default: its best.")] = None,
    library: options.Library = "robust",
    kind: Annotated[str, typer.Option("--model", help="improved, or previous: the paper's two models.")] = "improved",
    perturbation: Annotated[float, typer.Option(help="Scale of a perturbed prototype, 0.05 for ±5 %.")] = 0.0,
    seed: Annotated[int, typer.Option(help="Which perturbed prototype.")] = 1,
    picture: options.Picture = None,
    prototype: options.Prototype = None,
    as_json: options.Json = False,
) -> None:
    """Simulate a roll from one face to an adjacent one and judge it. Exit code 0: feasible, 4: not feasible.

    sixstrut roll --from TC6 --to TO5
    sixstrut roll --from TC4 --to TO12 --primitive P2 --perturbation 0.05 --seed 3
    sixstrut roll --from TO5 --to TC6 --primitive P9 --model previous
    sixstrut roll --policy "-31 36 17 37 -34 -43" --picture roll.png
    """
    announce(f"simulating a roll from {source} to {target}, a second or two")
    from sim_core.dynamics.model import build_model
    from sim_core.gaits.library import gait_of, load_library
    from sim_core.rolling.roll import Sample, roll
    from sim_core.rolling.warm_up import Stage
    from sim_core.structure.parameters import load_prototype
    from sim_core.structure.topology import require_adjacent
    from sim_core.uncertainty.perturbation_law import perturb
    from tensegrity_lab.terminal.compile_notice import compile_first

    require_adjacent(source, target)
    if policy is not None:
        strokes, name = _strokes(policy), "given policy"
    else:
        shelf = load_library(library)
        gait = gait_of(shelf.primitive(primitive), source, target) if primitive else shelf.gaits(source, target)[0]
        strokes, name = list(gait.policy), gait.name + ("" if gait.proper else " (mirror)")
    model = perturb(build_model(load_prototype(prototype), kind=kind), perturbation, seed)
    compile_first(Stage.ROBOT, Stage.ROLL)
    trace: list[Sample] = []
    result = roll(model, source, target, strokes, trace=trace)
    if as_json:
        told = {key: getattr(result, key) for key in TOLD}
        typer.echo(json.dumps({"gait": name, "policy_mm": result.policy, **told, "model_hash": model.hash}))
    else:
        verdict = "feasible" if result.feasible else f"not feasible: {result.reason}"
        say(f"{name}: policy {' '.join(f'{v:+d}' for v in result.policy)} mm")
        say(f"  {verdict}")
        moved_mm = 1e3 * math.hypot(*result.travel_m)
        say(f"  faces {' → '.join(result.faces)}, {result.duration_s:.1f} s, moved {moved_mm:.0f} mm")
        say(
            f"  strut force up to {result.peak_force_n:.1f} N, clearance down to {1e3 * result.clearance_m:.1f} mm, "
            f"centre of mass {1e3 * result.margin_m:.1f} mm inside the base"
        )
    if picture is not None:
        from tensegrity_lab.reports.figure import roll_picture

        wrote(roll_picture(result, trace, picture, name), err=as_json)
    if not result.feasible:
        raise typer.Exit(4)


def _strokes(text: str) -> list[float]:
    try:
        return [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        raise typer.BadParameter(f'{text!r}: valid are six whole numbers of mm, such as "-31 36 17 37 -34 -43"') from None
