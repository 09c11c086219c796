# SPDX-License-Identifier: Apache-2.0
"""`sixstrut doctor`: what is well, what is not, and how to mend it."""

import json
from typing import Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, say

EXIT_MEND = 4


def command(
    port: options.Port = "",
    board: options.Board = "lsc",
    baud: options.Baud = 0,
    calibration: options.Calibration = None,
    imu: Annotated[str, typer.Option("--imu", metavar="PORT", help="Also the inertial sensor at this port.")] = "",
    as_json: options.Json = False,
) -> None:
    """Check versions, pairing, port, permissions, calibration, disk and network. Moves and changes nothing.

    Exit code 0: all fine; 4: something to mend.

    sixstrut doctor
    sixstrut doctor --port /dev/rfcomm0 --calibration my_calibration.yaml --imu /dev/ttyUSB1
    """
    announce("looking at versions, port, calibration, computer, folders and network, some seconds")
    from hardware_bridge.boards.registry import parse_board
    from tensegrity_lab.commissioning.checks import Health, examine

    findings = list(examine(port, parse_board(board), baud, calibration, imu))
    if as_json:
        typer.echo(json.dumps([{"what": f.what, "health": str(f.health), "told": f.told, "mend": f.mend} for f in findings]))
    else:
        width = max(len(finding.what) for finding in findings)
        for finding in findings:
            mark = {Health.FINE: "ok", Health.MEND: "MEND", Health.SKIPPED: "-"}[finding.health]
            say(f"{mark:4}  {finding.what:{width}}  {finding.told}")
            if finding.mend:
                say(f"{'':4}  {'':{width}}  → {finding.mend}")
    raise typer.Exit(EXIT_MEND if any(finding.health is Health.MEND for finding in findings) else 0)
