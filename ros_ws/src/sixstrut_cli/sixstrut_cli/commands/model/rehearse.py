# SPDX-License-Identifier: Apache-2.0
"""`sixstrut rehearse`: try a roll on an ensemble before the robot does it."""

import json
from time import perf_counter
from typing import Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, say


def command(
    source: Annotated[str, typer.Option("--from", help="Face the robot rests on: TC1..TC8, TO1..TO12.")] = "TC6",
    target: Annotated[
        str | None,
        typer.Option("--to", help="Adjacent face, or TO5,TC3,…: roll on over these; default: the best gait to each neighbour."),
    ] = None,
    primitive: Annotated[
        str | None, typer.Option(help="A primitive of the library, or a cycle; default: the most reliable, or the first.")
    ] = None,
    members: Annotated[int, typer.Option(min=1, help="Perturbed robots in the ensemble.")] = 24,
    scale: Annotated[float, typer.Option(help="Their perturbation, 0.1 for ±10 %.")] = 0.1,
    incline: Annotated[float, typer.Option(help="Incline of the ground in degrees, downhill all round.")] = 0.0,
    ensemble: options.Ensemble = None,
    library: options.Library = "robust",
    prototype: options.Prototype = None,
    as_json: options.Json = False,
) -> None:
    """Roll an ensemble of perturbed robots and tell how often it worked and where it may end.

    sixstrut rehearse --from TC6
    sixstrut rehearse --from TO5 --to TC6 --primitive P21 --scale 0.2 --incline 3
    sixstrut rehearse --from TC6 --ensemble my_ensemble.yaml
    sixstrut rehearse --from TC6 --to TO5,TC3,TO4,TC4 --library continuous
    """
    announce(f"rolling {members} robots, some seconds")
    from sim_core.dynamics.model import build_model
    from sim_core.gaits.cycle import Chain
    from sim_core.gaits.library import Gait, gait_of, load_library, wanted_chain
    from sim_core.gaits.success_counts import load_success_counts
    from sim_core.planning.face_graph import FaceGraph
    from sim_core.rolling.warm_up import Stage
    from sim_core.structure.parameters import load_prototype
    from sim_core.structure.topology import NEIGHBOURS, require_adjacent, require_face
    from sim_core.studies.binomial_intervals import counted
    from sim_core.studies.rehearsal import Ensemble
    from sim_core.uncertainty.ensemble import load_posterior
    from sim_core.uncertainty.perturbation_law import Law
    from tensegrity_lab.terminal.compile_notice import compile_first

    require_face(source)
    faces = target.split(",") if target else []
    if len(faces) == 1:
        require_adjacent(source, faces[0])
    shelf = load_library(library)
    graph = FaceGraph(shelf, load_success_counts(shelf))
    gaits: list[Gait | Chain] = [
        gait_of(shelf.primitive(primitive), source, t) if primitive else graph.best(source, t).gait
        for t in ([] if len(faces) > 1 else faces or NEIGHBOURS[source])
    ]
    if len(faces) > 1:
        gaits = [wanted_chain(shelf, source, faces, primitive or "")]
    compile_first(Stage.BATCH)
    law = Law(scale, incline_deg=incline) if ensemble is None else load_posterior(ensemble)
    robots = Ensemble(build_model(load_prototype(prototype)), law, members)
    robots.prepare(source)
    began = perf_counter()
    rehearsed = robots.rehearse(gaits)
    seconds = perf_counter() - began
    if as_json:
        rows = [
            {"gait": r.gait.name, "successes": r.rate.successes, "members": r.rate.trials, "low": r.rate.low, "high": r.rate.high,
             "outcomes": r.outcomes, "reasons": r.reasons}
            for r in rehearsed
        ]  # fmt: skip
        typer.echo(json.dumps({"seconds": seconds, "rehearsed": rows}))
        return
    for r in rehearsed:
        ends = ", ".join(f"{face} {count}" for face, count in r.outcomes.items())
        mirror = "" if isinstance(r.gait, Chain) or r.gait.proper else " (mirror)"
        say(f"{r.gait.name}{mirror}: {counted(r.rate.successes, r.rate.trials)}; ends on {ends}")
        for reason, count in list(r.reasons.items())[:3]:
            say(f"    {count}: {reason}")
    say(f"{len(gaits)} gaits on {members} robots ({robots.law.brief}) in {seconds:.2f} s.")
    typer.echo("Virtual: these robots share the twin's equations.")
