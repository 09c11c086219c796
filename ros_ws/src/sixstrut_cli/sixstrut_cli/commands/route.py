"""`sixstrut route`: the likeliest sequence of rolls from one face to another."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli.commands.options import JsonOption, LibraryOption


def command(
    source: Annotated[str, typer.Argument(metavar="FROM", help="Face the robot stands on.")],
    target: Annotated[str, typer.Argument(metavar="TO", help="Face to reach.")],
    library: LibraryOption = "robust",
    odds: Annotated[
        Path | None, typer.Option(help="Odds of the gaits, from `sixstrut robustness --odds`.", show_default="the shipped ones")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Print the sequence of rolls that is the most likely to work, with the most reliable gait of each.

    sixstrut route TC6 TC1
    sixstrut route TO5 TO12 --library mine.yaml --odds mine.odds.yaml --json
    """
    from sim_core.face_graph import FaceGraph
    from sim_core.library import load_library
    from sim_core.odds import load_odds

    shelf = load_library(library)
    known = load_odds(shelf, odds)
    route = FaceGraph(shelf, known).route(source, target)
    if as_json:
        rolls = [
            {
                "from": c.gait.source,
                "to": c.gait.target,
                "primitive": c.gait.primitive.name,
                "policy_mm": c.gait.policy,
                "odds": c.odds,
            }
            for c in route.choices
        ]
        typer.echo(json.dumps({"faces": route.faces, "odds": route.odds, "rolls": rolls}))
        return
    for choice in route.choices:
        gait = choice.gait
        mirror = "" if gait.proper else " (mirror)"
        typer.echo(f"{gait.name}{mirror}: {' '.join(f'{v:+d}' for v in gait.policy)} mm, odds {100 * choice.odds:.1f} %")
    basis = known.how if known else "success in training, one rate for a primitive's 24 gaits"
    typer.echo(f"{' → '.join(route.faces)}: {len(route.choices)} rolls, odds {100 * route.odds:.1f} % ({basis})")
