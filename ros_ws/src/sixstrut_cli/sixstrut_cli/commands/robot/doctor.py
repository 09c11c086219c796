# SPDX-License-Identifier: Apache-2.0
"""`sixstrut doctor`: what is well, what is not, and how to mend it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli.options import JsonOption

EXIT_MEND = 4


def command(
    port: Annotated[
        str,
        typer.Option(help="Device or socket://HOST:PORT; default: the virtual prototype's link.", show_default=False),
    ] = "",
    board: Annotated[str, typer.Option(help="lsc, ssc32 or maestro, the last with :device=N and :crc if so set.")] = "lsc",
    baud: Annotated[int, typer.Option(min=0, max=1_000_000, help="Rate of the port; 0: the board's usual.")] = 0,
    calibration: Annotated[Path | None, typer.Option(help="The robot's calibration YAML.", show_default=False)] = None,
    as_json: JsonOption = False,
) -> None:
    """Check versions, pairing, port, permissions, calibration, disk and network. Moves and changes nothing.

    Exit code 0: all fine; 4: something to mend.

    sixstrut doctor
    sixstrut doctor --port /dev/rfcomm0 --calibration my_calibration.yaml
    """
    from hardware_bridge.boards.registry import parse_board
    from tensegrity_lab.commissioning.checks import Health, examine

    findings = list(examine(port, parse_board(board), baud, calibration))
    if as_json:
        typer.echo(json.dumps([{"what": f.what, "health": str(f.health), "told": f.told, "mend": f.mend} for f in findings]))
    else:
        width = max(len(finding.what) for finding in findings)
        for finding in findings:
            mark = {Health.FINE: "ok", Health.MEND: "MEND", Health.SKIPPED: "-"}[finding.health]
            typer.echo(f"{mark:4}  {finding.what:{width}}  {finding.told}")
            if finding.mend:
                typer.echo(f"{'':4}  {'':{width}}  → {finding.mend}")
    raise typer.Exit(EXIT_MEND if any(finding.health is Health.MEND for finding in findings) else 0)
