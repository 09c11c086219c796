# SPDX-License-Identifier: Apache-2.0
"""`sixstrut travel`: the virtual prototype rolls to a place on the floor."""

from __future__ import annotations

import json
import tempfile
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, console, import_checkout, output_folder, results_page, wrote

if TYPE_CHECKING:
    from tensegrity_lab.stack.virtual_stack import VirtualRobot
    from tensegrity_lab.studies.travel import Trip
    from tests.studies.travels import Case


def command(
    place: Annotated[
        list[str] | None, typer.Argument(metavar="X,Y", help="Place on the floor in m; the robot starts at 0,0.")
    ] = None,
    study: Annotated[
        int,
        typer.Option(metavar="N", min=0, help="Instead: N goals at 1 m, on two floors, with what is known of gaits and without."),
    ] = 0,
    level: Annotated[
        bool, typer.Option("--level", help="Of a study: level ground only; --page writes it into the page of rolling on.")
    ] = False,
    reach: Annotated[float, typer.Option(min=0.02, help="How near is near enough, in m.")] = 0.08,
    most_rolls: Annotated[int, typer.Option(min=1, help="Give up after so many rolls.")] = 60,
    ignore_odds: Annotated[bool, typer.Option("--ignore-odds", help="Take all gaits for equally likely.")] = False,
    imu: Annotated[
        bool, typer.Option("--imu", help="Nobody looks: an inertial sensor in its box tells the faces, its place is predicted.")
    ] = False,
    seed: options.Seed = 1,
    from_face: options.FromFace = "TC6",
    perturbation: options.Perturbation = 0.05,
    incline: options.Incline = 0.0,
    time_scale: options.TimeScale = 8.0,
    board: options.Board = "lsc",
    actuators: options.Actuators = "stand-in",
    library: options.Library = "robust",
    domain: options.Domain = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for bags, pictures, and a study's trips.", show_default="bags, out/travel"),
    ] = None,
    page: options.Page = False,
    as_json: options.Json = False,
) -> None:
    """Roll the virtual prototype to a place on the floor, through the whole stack: replanned after every roll from where it rests.

    Exit code 0: it arrived; 4: it gave up, and says why. In a running stack: the action `travel`, or RViz's 2D Goal Pose.
    A study that was stopped goes on with the same command and --output.

    sixstrut travel 0.6,0.3
    sixstrut travel -1.0,-0.5 --incline 3 --seed 7
    sixstrut travel 2.0,0.0 --library continuous --time-scale 2 --imu --perturbation 0.1
    sixstrut travel --study 10 -o bags/travels --page
    """
    if study and domain is not None:
        raise typer.BadParameter("a study takes a domain of its own for each trip", param_hint="--domain")
    if bool(place) == bool(study):
        raise typer.BadParameter("give a place such as 0.6,0.3, or --study N", param_hint="X,Y")
    if level and not study:
        raise typer.BadParameter("only a study is made on two floors: give --study N as well", param_hint="--level")
    if imu and study:
        raise typer.BadParameter("a study is of robots that are seen", param_hint="--imu")
    if page and not study:
        raise typer.BadParameter("only a study makes a page: give --study N as well", param_hint="--page")
    bags = output or (output_folder("travel") if study else Path("bags"))
    goal_m = options.place_of(place) if place else (0.0, 0.0)
    announce("a virtual robot rolls, some seconds each; Ctrl-C holds the struts, closes the bag and ends")
    from tensegrity_lab.stack.virtual_stack import VirtualRobot

    robot = VirtualRobot(from_face, seed, perturbation, time_scale, board, actuators, library, bags, incline)
    robot.require()
    if not place:
        _study(study, robot, bags, level, page)
        return
    from tensegrity_lab.commissioning.imu_mounting import virtual_mounting
    from tensegrity_lab.studies.travel import travel
    from tensegrity_lab.studies.travel_plot import travel_picture

    screen = console()
    screen.print(robot.describe)
    robot.compile()
    with screen.status("starting") as status, tempfile.TemporaryDirectory(prefix="sixstrut-imu-") as folder:
        if imu:
            robot = replace(robot, mounting=(mounting := Path(folder) / "mounting.yaml"))
            virtual_mounting(mounting, seed, perturbation, status.update)
        trip = travel(robot, goal_m, status.update, reach, most_rolls, not ignore_odds, domain, screen.print)
    picture = Path(trip.bag).with_suffix(".png")
    if as_json:
        typer.echo(json.dumps(asdict(trip) | {"ratio": trip.ratio, "speed_m_min": trip.speed_m_min, "picture": str(picture)}))
    else:
        typer.echo(" → ".join(trip.faces))
        typer.echo(f"{'arrived' if trip.success else 'did not arrive'}: {trip.reason}")
        ratio = f"path {trip.path_m:.2f} m for {trip.straight_m - trip.left_m:.2f} m won"
        rolls = f"{trip.rolls} rolls ({trip.chained} in chains), {trip.missed} missed"
        typer.echo(f"{rolls}, {trip.robot_s:.0f} s of rolling, {trip.speed_m_min:.2f} m/min; {ratio}")
        if imu:
            typer.echo(f"its observer, whom nobody heard, saw it {trip.seen_left_m:.2f} m from the goal")
        wrote(Path(trip.bag))
    wrote(travel_picture(trip, picture), err=as_json)
    if not trip.success:
        raise typer.Exit(4)


def _study(goals: int, robot: VirtualRobot, folder: Path, level: bool, page: bool) -> None:
    import_checkout()
    from tests.studies.travels import cases_of, read_trips, study

    robot.compile()
    cases = cases_of(goals, robot.seed, robot.library, level)
    screen = console()
    try:
        with screen.status("starting") as status:
            study(cases, robot, folder, status.update, screen.print)
    except KeyboardInterrupt:
        typer.echo(f"\ninterrupted: every finished trip is kept in {folder.resolve()}; the same command goes on", err=True)
        raise typer.Exit(130) from None
    finally:  # a page of what there is, also if it is ended early
        known = read_trips(folder)
        found = {case: known[case.key] for case in cases if case.key in known}
        if found:
            _write(cases, found, robot, folder, level, page)


def _write(cases: list[Case], found: dict[Case, Trip], robot: VirtualRobot, folder: Path, level: bool, page: bool) -> None:
    from tensegrity_lab.reports.markdown import write_into
    from tensegrity_lab.studies.travel_plot import study_picture
    from tests.studies.travels import groups_of, level_text, page_of, words_of

    chosen = f"--study {len({case.number for case in cases})} --seed {robot.seed} --time-scale {robot.time_scale:g}"
    chosen += "".join(
        f" --{name} {value}"
        for name, value, usual in (("library", robot.library, "robust"), ("actuators", robot.actuators, "stand-in"))
        if value != usual
    )
    command = f"./sixstrut travel {chosen}{' --level' if level else ''} -o {folder}{' --page' if page else ''}"
    if level:
        typer.echo(text := level_text(found, robot, command))
        if page and len(found) == len(cases):
            write_into(results_page("rolling_on.md"), f"travels {robot.actuators}", text)
        return
    target = results_page("travel.md") if page else folder / "travel.md"
    images = target.parent / "images"
    images.mkdir(parents=True, exist_ok=True)
    groups = groups_of(found)
    panels = [(", ".join(words_of(group)), [trip for case, trip in found.items() if case.group == group]) for group in groups]
    text = page_of(found, len(cases) - len(found), robot, command, "images/travel.png")
    target.write_text(text, encoding="utf-8")
    typer.echo(text)
    wrote(target, study_picture(panels, images / "travel.png"))
