# SPDX-License-Identifier: Apache-2.0
"""`sixstrut calibrate`: measure the robot's struts, with a person at the keyboard."""

import contextlib
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import console, output_of

IMU = Path("imu")


def command(
    file: Annotated[Path, typer.Argument(help="The YAML to write; or the word imu.", callback=output_of("calibration"))] = Path(
        "calibration.yaml"
    ),
    mounting: Annotated[
        Path | None,
        typer.Argument(
            help="After imu: the YAML to write; default: mounting.yaml.", callback=output_of("mounting"), show_default=False
        ),
    ] = None,
    robot: Annotated[str, typer.Option(help="The robot's name, by which it is known at any port; default: asked.")] = "",
    port: options.Port = "",
    board: options.Board = "lsc",
    baud: options.Baud = 0,
    silent_board: options.SilentBoard = False,
    virtual: Annotated[bool, typer.Option("--virtual", help="Practise on a virtual prototype of its own.")] = False,
    time_scale: Annotated[float, typer.Option(min=0.01, max=100.0, help="Of the virtual prototype.")] = 4.0,
) -> None:
    """Walk through six struts: channel, direction, end points with measured lengths, trim. Writes a calibration of a named robot.

    Needs a ruler and a terminal. Interrupted with Ctrl-C, it goes on from there when it is started again with the same file.
    The bridge must not run meanwhile: it holds the port.

    sixstrut calibrate my_calibration.yaml --port /dev/rfcomm0 --robot "blue one"
    sixstrut calibrate my_calibration.yaml --port /dev/ttyUSB0 --board ssc32
    sixstrut calibrate practice.yaml --virtual --board maestro

    With imu it finds how an inertial sensor sits in the robot's box: put the robot on six faces, struts at mid stroke, on a level
    floor. Without --virtual it needs the sensor's --port, which no driver may hold meanwhile.

    sixstrut calibrate imu mounting.yaml --port /dev/ttyUSB1
    sixstrut calibrate imu practice.yaml --virtual
    """
    if file == IMU:
        _mounting(mounting or Path("mounting.yaml"), port, baud, virtual)
        return
    if mounting is not None:
        raise typer.BadParameter(f"one file is written, {file}; a second one only after imu", param_hint="MOUNTING")
    from hardware_bridge.boards.registry import parse_board
    from hardware_bridge.driver.jogger import Jogger
    from hardware_bridge.link.transport import SerialTransport
    from hardware_bridge.prototype_client.handshake import (
        agree_on_board,
        default_link,
        examine,
        require_prototype,
        require_same_pty,
    )
    from hardware_bridge.safety.limits import Limits
    from hardware_bridge.saved_state.robot_identity import Identity, canonical_link
    from hardware_bridge.saved_state.robot_records import Records
    from hardware_bridge.saved_state.state_file import state_directory
    from hardware_bridge.virtual_prototype.practice import practice_prototype
    from tensegrity_lab.commissioning.calibration_wizard import Walk, ask_robot, measured_before
    from tensegrity_lab.commissioning.observed_lengths import Eyes
    from tensegrity_lab.terminal.keys import require_keyboard

    require_keyboard()
    for number in (signal.SIGTERM, signal.SIGHUP):  # leave as at Ctrl-C, with nothing running behind
        signal.signal(number, lambda number, frame: sys.exit(128 + number))
    screen = console(err=False)
    with contextlib.ExitStack() as stack:
        behind = parse_board(board)
        practice = stack.enter_context(practice_prototype(time_scale, behind.spec)) if virtual else None
        chosen = str(practice or port or default_link())
        handshake, doubt = examine(chosen) if port else (require_prototype(Path(chosen)), "")
        if doubt:
            screen.print(f"{chosen} is taken for a real port, not for a virtual prototype's: {doubt}")
        agree_on_board(chosen, behind.spec, handshake)
        name = ask_robot(file, robot, screen)
        before = measured_before(file)
        measured = before.hash if before is not None and before.robot == name else ""
        identity = Identity(name, measured, behind.spec)
        if handshake is not None:
            identity = Identity(handshake.instance, measured, behind.spec, canonical_link(chosen))
        limits = Limits()
        records = Records(state_directory() if practice is None else practice.parent, identity, limits, chosen)
        stack.callback(records.close)
        scale = 1.0 if handshake is None else handshake.time_scale
        transport = SerialTransport(chosen, baud or behind.quirks.usual_baud)
        jogger = Jogger(transport, behind, records, limits, scale, silent_board)
        stack.callback(jogger.close)
        if handshake is not None:
            require_same_pty(chosen, handshake, transport.descriptor)
        eyes = None if handshake is None else stack.enter_context(contextlib.closing(Eyes(handshake.observer, scale)))
        walk = Walk(file, name, jogger, (lambda strut: None) if eyes is None else eyes.length_mm, screen)
        try:
            walk.run()
        except (KeyboardInterrupt, EOFError):
            screen.print(f"\nLeft. What is done is kept; go on with the same command for {file}.")
            raise typer.Exit(130) from None
    screen.print(f"Written: {file}. Start the bridge with calibration:={file}")


def _mounting(file: Path, port: str, baud: int, virtual: bool) -> None:
    """Of an inertial sensor, from faces that a person names, or that a virtual prototype is put on."""
    from math import degrees

    from tensegrity_lab.commissioning.imu_mounting import felt_by_hand, fitted, virtual_mounting, write_mounting

    screen = console(err=False)
    if virtual == bool(port):
        raise typer.BadParameter("give the sensor's port, or --virtual to practise", param_hint="--port")
    if virtual:
        with screen.status("feeling") as status:
            found = virtual_mounting(file, 1, 0.05, status.update)
    else:
        found = fitted(felt_by_hand(port, baud, screen))
        write_mounting(file, found)
    off = ", ".join(f"{face} {degrees(off_rad):.1f}" for face, off_rad in found.off_rad.items())
    screen.print(f"The faces fit to degrees: {off}")
    screen.print(f"Written: {file}. Launch with imu:=wt901 mounting:={file}, or give it to trial --judge imu --mounting {file}")
