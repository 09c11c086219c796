# SPDX-License-Identifier: Apache-2.0
"""`python -m hardware_bridge.virtual_prototype`: one robot behind one pty, until SIGINT or SIGTERM."""

import argparse
import contextlib
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import FrameType

from hardware_bridge.boards.maestro import TIMEOUT_S, WIDEST_US
from hardware_bridge.boards.registry import VALID, parse_board
from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.driver.events import FACES
from hardware_bridge.errors import BridgeError, ParameterError
from hardware_bridge.prototype_client.handshake import default_link, imu_path
from hardware_bridge.virtual_prototype.boards.maestro import ControlCenter
from hardware_bridge.virtual_prototype.boards.registry import emulate
from hardware_bridge.virtual_prototype.body import ActuatedBody, SimulatedBody
from hardware_bridge.virtual_prototype.imu_line import ImuLine
from hardware_bridge.virtual_prototype.main_loop import VirtualPrototype
from sim_core.dynamics.actuators import STAND_IN, require_actuators
from sim_core.errors import SimError
from sim_core.printable import replace_what_cannot_be_shown

MOST_INCLINE_DEG = 20.0
"""`sim_core.uncertainty.perturbation_law.MAX_INCLINE_DEG`, by value: to import it would load the solver for every `--help`."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the prototype; the exit status: 0 after a signal, 1 if it could not start or go on, 2 for bad arguments."""
    replace_what_cannot_be_shown()
    options = _parser().parse_args(arguments)
    ended = False

    def end(_number: int, _frame: FrameType | None) -> None:
        nonlocal ended
        ended = True

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    imu: ImuLine | None = None
    try:
        body = _body(options)
        calibration = replace(load_calibration(), mid_stroke_length_m=body.mid_stroke_length_m)
        if ended:
            return 0
        settings = ControlCenter(options.maestro_home, options.maestro_timeout)
        board = emulate(options.board, options.baud, settings)
        if options.imu is not None:
            imu = ImuLine(imu_path(options.link), body.sensor(options.seed), options.time_scale)
        prototype = VirtualPrototype(options.link, body, calibration, board, options.time_scale, imu)
    except (BridgeError, SimError) as error:
        if imu is not None:
            imu.close()
        print(error, file=sys.stderr)
        return 1
    try:
        with contextlib.suppress(BrokenPipeError):  # nobody needs to listen
            scale = f"{options.board}, perturbation {options.perturbation * 100:g} %, seed {options.seed}"
            ready = f"virtual prototype ready: {options.link} ({scale}, time scale {options.time_scale:g})"
            print(ready, flush=True)
        prototype.run(lambda: ended)
    except SimError as error:
        print(error, file=sys.stderr)
        return 1
    finally:
        prototype.close()
        # a second signal (a launch file's Ctrl-C reaches the whole group) must not spoil a clean end
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
    return 0


def _body(options: argparse.Namespace) -> SimulatedBody:
    parameters = require_actuators(options.actuators)
    if parameters is None:
        return SimulatedBody(options.face, options.perturbation, options.seed, incline_deg=options.incline)
    return ActuatedBody(options.face, options.perturbation, options.seed, parameters, options.incline)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="virtual_prototype",
        description="A simulated robot, its true parameters hidden, behind a serial port.",
    )
    defaults: list[tuple[str, Callable[[str], object], object, str]] = [
        ("--link", Path, default_link(), "where to link"),
        ("--seed", int, 0, "draws the robot's true parameters"),
        ("--perturbation", _number(0.0, 0.5), 0.05, "how far they are from the nominal ones, 0.05 = 5 %%"),
        ("--incline", _number(0.0, MOST_INCLINE_DEG), 0.0, "incline of the ground in degrees, its direction drawn by the seed"),
        ("--face", _face, "TC6", "the face it starts on"),
        ("--actuators", str, STAND_IN, "ideal (constant speed whatever the load), stand-in, or a YAML file like it"),
        ("--time-scale", _number(0.01, 100.0), 1.0, "robot seconds per second"),
        ("--board", _board, "lsc", f"the servo board: {VALID}"),
    ]
    for option, kind, default, about in defaults:
        parser.add_argument(option, type=kind, default=default, help=f"{about} (default: %(default)s)")
    parser.add_argument("--baud", type=_baud, help="between radio and board (default: 9600 for lsc, else 115200)")
    imu = "put an inertial sensor into the box, on a port of its own at the link's name with .imu: wt901 (default: none)"
    parser.add_argument("--imu", choices=("wt901",), help=imu)
    home = "where an error sends a Maestro's channels: ignore (default), off, or a pulse in us"
    parser.add_argument("--maestro-home", type=_home, help=home)
    timeout = "a Maestro's serial time-out in seconds of robot time (default: off)"
    parser.add_argument("--maestro-timeout", type=_number(*TIMEOUT_S), help=timeout)
    return parser


def _number(low: float, high: float) -> Callable[[str], float]:
    def number(text: str) -> float:
        if not low <= float(text) <= high:  # also not-a-number
            raise argparse.ArgumentTypeError(f"{text} is not from {low:g} to {high:g}")
        return float(text)

    return number


def _baud(text: str) -> int:
    _number(300, 1_000_000)(text)
    return int(text)


def _board(text: str) -> str:
    try:
        return parse_board(text).spec
    except ParameterError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _home(text: str) -> float | None:
    if text in ("ignore", "off"):
        return None if text == "ignore" else 0.0
    return _number(*WIDEST_US)(text)


def _face(text: str) -> str:
    if text not in FACES:
        raise argparse.ArgumentTypeError(f"{text} is not TC1 to TC8 or TO1 to TO12")
    return text


if __name__ == "__main__":
    sys.exit(main())
