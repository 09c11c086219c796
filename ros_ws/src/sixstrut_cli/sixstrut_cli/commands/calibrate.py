"""`sixstrut calibrate`: measure the robot's struts, with a person at the keyboard."""

from __future__ import annotations

import contextlib
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer


def command(
    file: Annotated[Path, typer.Argument(help="The YAML to write.")] = Path("calibration.yaml"),
    port: Annotated[
        str, typer.Option(help="Device or pyserial URL of the board; default: the virtual prototype's link.", show_default=False)
    ] = "",
    board: Annotated[str, typer.Option(help="lsc, ssc32 or maestro, the last with :device=N and :crc if so set.")] = "lsc",
    baud: Annotated[int, typer.Option(min=0, max=1_000_000, help="Rate of the port; 0: the board's usual.")] = 0,
    virtual: Annotated[bool, typer.Option("--virtual", help="Practise on a virtual prototype of its own.")] = False,
    time_scale: Annotated[float, typer.Option(min=0.01, max=100.0, help="Of the virtual prototype.")] = 4.0,
) -> None:
    """Walk through six struts: channel, direction, end points with measured lengths, trim. Writes a calibration.

    Needs a ruler and a terminal. Interrupted with Ctrl-C, it goes on from there when it is started again with the same file.
    The bridge must not run meanwhile: it holds the port.

    sixstrut calibrate mine.yaml --port /dev/rfcomm0
    sixstrut calibrate mine.yaml --port /dev/ttyUSB0 --board ssc32
    sixstrut calibrate practice.yaml --virtual --board maestro
    """
    from rich.console import Console

    from hardware_bridge.codecs.registry import parse_board
    from hardware_bridge.jogger import Jogger
    from hardware_bridge.last_pulses import LastPulses, state_directory
    from hardware_bridge.transport import SerialTransport
    from hardware_bridge.virtual_port import agree_on_board, default_link, examine, require_prototype, require_same_pty
    from sixstrut_cli.calibrating import Walk
    from sixstrut_cli.keys import require_keyboard
    from sixstrut_cli.practice import Eyes, practice_prototype

    require_keyboard()
    for number in (signal.SIGTERM, signal.SIGHUP):  # leave as at Ctrl-C, with nothing running behind
        signal.signal(number, lambda number, frame: sys.exit(128 + number))
    console = Console(soft_wrap=True)
    with contextlib.ExitStack() as stack:
        behind = parse_board(board)
        practice = stack.enter_context(practice_prototype(time_scale, behind.spec)) if virtual else None
        chosen = str(practice or port or default_link())
        handshake, doubt = examine(chosen) if port else (require_prototype(Path(chosen)), "")
        if doubt:
            console.print(f"{chosen} is taken for a real port, not for a virtual prototype's: {doubt}", highlight=False)
        agree_on_board(chosen, behind.spec, handshake)
        record = LastPulses(state_directory(), chosen, "" if handshake is None else handshake.instance)
        scale = 1.0 if handshake is None else handshake.time_scale
        transport = SerialTransport(chosen, baud or behind.quirks.usual_baud)
        jogger = Jogger(transport, behind, record, scale)
        stack.callback(jogger.close)
        if handshake is not None:
            require_same_pty(chosen, handshake, transport.descriptor)
        eyes = stack.enter_context(Eyes(None if handshake is None else handshake.observer, scale))
        walk = Walk(file, jogger, eyes.length_mm, console)
        try:
            walk.run()
        except (KeyboardInterrupt, EOFError):
            console.print(f"\nLeft. What is done is kept; go on with the same command for {file}.", highlight=False)
            raise typer.Exit(130) from None
    console.print(f"Written: {file}. Start the bridge with calibration:={file}", highlight=False)
