# SPDX-License-Identifier: Apache-2.0
"""`sixstrut route`: the likeliest sequence of rolls from one face to another."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, say

if TYPE_CHECKING:
    from sim_core.gaits.success_counts import SuccessCounts


def command(
    source: Annotated[str, typer.Argument(metavar="FROM", help="Face the robot stands on.")],
    target: Annotated[list[str], typer.Argument(metavar="TO", help="Face to reach, or a place on the floor in m: 1.0,-0.3")],
    library: options.Library = "robust",
    odds: Annotated[
        Path | None,
        typer.Option(help="How often each gait worked, from `sixstrut robustness --odds`.", show_default="the shipped ones"),
    ] = None,
    reach: Annotated[float, typer.Option(min=0.01, help="How near to a place is near enough, in m.")] = 0.08,
    as_json: options.Json = False,
) -> None:
    """Print the sequence of rolls that is the most likely to work, with the most reliable gait of each.

    To a place, the way begins at the origin of the floor, in the attitude in which `sixstrut roll` begins.

    sixstrut route TC6 TC1
    sixstrut route TC6 -1.0,0.3
    sixstrut route TO5 TO12 --library my_library.yaml --odds my_odds.yaml --json
    """
    announce(f"from {source} to {' '.join(target)}, a second or two")
    from sim_core.gaits.library import load_library
    from sim_core.gaits.success_counts import load_success_counts
    from sim_core.planning.face_graph import FaceGraph
    from sim_core.studies.binomial_intervals import counted

    shelf = load_library(library)
    known = load_success_counts(shelf, odds)
    graph = FaceGraph(shelf, known)
    if len(target) > 1 or "," in target[0]:
        from sim_core.dynamics.model import build_model
        from sim_core.planning.floor_planner import Floor, Stance
        from sim_core.rolling.warm_up import Stage
        from sim_core.structure.parameters import load_prototype
        from sim_core.structure.topology import require_face
        from tensegrity_lab.terminal.compile_notice import compile_first

        goal_m, start = options.place_of(target), Stance(require_face(source), 0.0, 0.0, 0.0)
        compile_first(Stage.ROBOT)
        way = Floor(build_model(load_prototype())).way(start, goal_m, graph, reach)
        faces, probability, choices = tuple(stance.face for stance in way.stances), way.probability, way.choices
        places = [(stance.x_m, stance.y_m) for stance in way.stances[1:]]
        end = f"; ends {100 * way.left_m:.0f} cm from the place" + ("" if way.reaches else ": no nearer way was found")
    else:
        route = graph.route(source, target[0])
        faces, probability, choices, places, end = route.faces, route.probability, route.choices, [], ""
    if as_json:
        rolls = [
            {
                "from": gait.source,
                "to": gait.target,
                "primitive": gait.primitive.name,
                "policy_mm": gait.policy,
                "odds": choice.probability,
            }
            for choice in choices
            for gait in [choice.gait]
        ]
        document = {"faces": faces, "odds": probability, "rolls": rolls} | ({"places_m": places} if places else {})
        typer.echo(json.dumps(document))
        return
    for number, choice in enumerate(choices):
        gait = choice.gait
        where = f", to {places[number][0]:+.2f} {places[number][1]:+.2f} m" if places else ""
        mirror = "" if gait.proper else " (mirror)"
        tries = known.tries(gait) if known else None
        likely = counted(*tries) if tries else f"probability {100 * choice.probability:.0f} %"
        say(f"{gait.name}{mirror}: {' '.join(f'{v:+d}' for v in gait.policy)} mm; {likely}{where}")
    say(f"{' → '.join(faces)}: {len(choices)} rolls, all of them work with a probability of {100 * probability:.0f} %{end}")
    say(f"known from: {_basis(known)}")


def _basis(known: SuccessCounts | None) -> str:
    """Where the probabilities come from, in a few words."""
    if known is None:
        return "success in training, one rate for a primitive's 24 gaits"
    scale = re.match(r"uniform at scale s = ([\d.]+)", known.how)
    if scale is None:
        return known.how
    return f"{known.trials} virtual prototypes off by ±{100 * float(scale[1]):g} % (docs: Perturbed prototypes)"
