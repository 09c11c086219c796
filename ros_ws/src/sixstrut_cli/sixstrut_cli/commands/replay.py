"""`sixstrut replay`: step the twin through a recorded session."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli.commands.options import JsonOption


def command(
    bag: Annotated[Path, typer.Argument(help="An .mcap file that the bridge recorded.")],
    picture: Annotated[Path | None, typer.Option(help="Write a PNG of the session here.", show_default=False)] = None,
    compare: Annotated[bool, typer.Option("--compare", help="Also a bag of another model: compare its faces only.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Step the twin through the commands that were sent; compare faces with those observed, bits with the live twin's.

    Exit code 0: same bits as live and on the recorded face at the end; 4: not. A bag that was recorded with another model is
    refused with both hashes.

    sixstrut replay bags/example.mcap
    sixstrut replay bags/example.mcap --picture session.png
    """
    from rich.progress import Progress

    from hardware_bridge.bag_reader import read_session
    from sim_core.warm_up import Stage
    from sixstrut_cli.compiling import compile_first
    from sixstrut_cli.replaying import model_of, replay, require_same_model

    session = read_session(bag)
    model = model_of(session)
    if not compare:
        require_same_model(session, model)
    compile_first(Stage.ROBOT)
    with Progress(transient=True, disable=as_json) as bar:
        task = bar.add_task("replaying", total=None)
        result = replay(session, model, report=lambda done, total: bar.update(task, completed=done, total=total))
    same_bits = result.same_states == result.live_states
    same_face = result.recorded is None or result.final == result.recorded
    if picture is not None:
        from sixstrut_cli.pictures import session_picture

        session_picture(session, result, picture)
    if as_json:
        typer.echo(
            json.dumps(
                {
                    "bag": str(bag),
                    "digest": result.digest,
                    "step": result.step,
                    "model_hash": result.model_hash,
                    "live_states": result.live_states,
                    "same_states": result.same_states,
                    "faces": [{**vars(check), "agrees": check.agrees} for check in result.faces],
                    "final_face": result.final,
                    "recorded_face": result.recorded,
                    "resets": result.resets,
                }
            )
        )
    else:
        for check in result.faces:
            mark = "as" if check.agrees else "but"
            seen = f"{mark} {check.source} saw {check.observed or 'no face'}"
            typer.echo(f"  {check.time_s:6.1f} s  twin on {check.predicted or 'no face'}, {seen}")
        if result.live_states:
            verdict = "the same bits" if same_bits else f"different bits from event {result.first_difference} on"
            typer.echo(f"  {result.same_states} of {result.live_states} recorded states of the live twin: {verdict}")
        else:
            typer.echo("  the bag holds no states of a live twin with this model to compare with")
        end = f"ended on {result.final or 'no face'}"
        typer.echo(f"  {end}, recorded: {result.recorded or 'nobody looked'}{'' if same_face else ' — they differ'}")
        typer.echo(f"  final state {result.digest} at step {result.step}, model {result.model_hash}")
        if picture is not None:
            typer.echo(f"  picture: {picture}")
    if not (same_bits and same_face):
        raise typer.Exit(4)
