# SPDX-License-Identifier: Apache-2.0
"""`sixstrut trial`: a session of trials, a day long, that may end at any moment and goes on from there."""

from pathlib import Path
from typing import Annotated, Any

import typer

from sixstrut_cli import options


def command(
    session: Annotated[
        Path | None, typer.Argument(help="The session's folder; it goes on if it exists. Default: a new one.")
    ] = None,
    library: Annotated[str | None, typer.Option(help="A shipped library's name, or a YAML file; default: robust.")] = None,
    primitives: Annotated[
        str | None, typer.Option(help='Which of it: "1-40", "1,3,7-9", "P5,P12", all; of cycles "C1", cycles; default: all.')
    ] = None,
    gaits: Annotated[
        str | None,
        typer.Option(
            help="all (24), proper, improper, reference, or pairs: TC6-TO5,TO5-TC8; of cycles straight chains of 12 rolls that "
            "begin with these pairs, or chains: TC6-TO5-TC3-TO4-TC4; default: all."
        ),
    ] = None,
    repeats: Annotated[int | None, typer.Option(min=1, max=1000, help="Trials of each gait; default: 1.")] = None,
    order_seed: Annotated[int | None, typer.Option(min=0, help="Draws the order; default: drawn and kept.")] = None,
    experimenter: Annotated[str, typer.Option(help="Who runs it; default: your login.")] = "",
    robot: Annotated[str | None, typer.Option(help="Which prototype: one name for each.")] = None,
    port: Annotated[str, typer.Option(help="Device or socket://HOST:PORT of the board.")] = "",
    calibration: options.Calibration = None,
    virtual: Annotated[bool, typer.Option("--virtual", help="Virtual trials, on a virtual prototype of its own.")] = False,
    board: options.Board = "lsc",
    baud: options.Baud = 0,
    rested: Annotated[
        float, typer.Option(min=0.0, max=1e7, help="Seconds for which the actuators have rested; what nobody knows counts as run.")
    ] = 0.0,
    silent_board: options.SilentBoard = False,
    perturbation: Annotated[
        float | None,
        typer.Option(min=0.0, max=options.MOST_PERTURBATION, help="How far the virtual prototype is off; default: 0.05."),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Which virtual prototype; default: 1.")] = None,
    actuators: Annotated[
        str | None, typer.Option(help="Its actuators: ideal, stand-in, or a YAML file; default: stand-in.")
    ] = None,
    time_scale: options.TimeScale = 8.0,
    judge: Annotated[
        str,
        typer.Option(
            help="Who judges: observer, the virtual prototype's own; hand, you; imu, an inertial sensor in the box. "
            "Default: observer if the robot is virtual, else hand."
        ),
    ] = "",
    imu_port: Annotated[str, typer.Option(help="Port of the inertial sensor; default: its driver runs already.")] = "",
    mounting: Annotated[
        Path | None, typer.Option(help="How it sits, from `sixstrut calibrate imu`; a virtual one is felt at the start.")
    ] = None,
    plan_only: Annotated[bool, typer.Option("--plan", help="Show the plan and its estimated time, and leave.")] = False,
    domain: options.Domain = None,
) -> None:
    """Run a session: primitives × gaits × repeats, one record a trial in a ledger and in the bag. Resumable after anything.

    The plan comes first: order, duty, time. Then each trial is checked, rolled, judged by one key (or by the virtual prototype's
    observer) and recorded. Ctrl-C, a power cut or a kill lose nothing: the same command goes on. Then: sixstrut report SESSION.
    With --judge imu nobody needs to look: where the sensor does not know, you are asked.
    A chain of a cycle is one trial: an observer or a sensor judges it. A virtual prototype rolls it at twice real time at most.
    Exit code 0: all trials are done; 130: left before.

    sixstrut trial --library robust --primitives 1-40 --gaits all --port /dev/rfcomm0 --calibration my_calibration.yaml
    sixstrut trial bags/monday --primitives 1-4 --virtual --perturbation 0.1 --seed 3
    sixstrut trial bags/monday --virtual
    sixstrut trial --virtual --judge imu --perturbation 0.1
    sixstrut trial --virtual --library continuous --primitives C1 --gaits TC6-TO5-TC3-TO4-TC4 --repeats 4
    """
    from sim_core.printable import NAME_MOST, printable
    from tensegrity_lab.trials.robot_access import Hardware
    from tensegrity_lab.trials.session_start import TrialRequest, run
    from tensegrity_lab.trials.session_start import experimenter as login

    if virtual and port:
        raise typer.BadParameter("give --virtual, which starts a prototype of its own, or --port, not both")
    plan: dict[str, Any] = {
        "library": library,
        "primitives": primitives,
        "gaits": gaits,
        "repeats": repeats,
        "order_seed": order_seed,
        "judge": judge or None,
    }
    plan |= {"order_seed": order_seed, "robot": robot, "perturbation": perturbation, "seed": seed, "actuators": actuators}
    imu = imu_port, str(mounting or "")
    hardware = Hardware(port, board, baud, str(calibration or ""), time_scale, rested, silent_board, False, *imu)
    who = printable(experimenter or login(), NAME_MOST) or "unknown"
    raise typer.Exit(run(TrialRequest(session, plan, who, virtual, hardware, judge, plan_only, domain)))
