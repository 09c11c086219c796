# SPDX-License-Identifier: Apache-2.0
"""`sixstrut replay`: step the twin through a recorded session."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, picture_path, say, writable, wrote


def command(
    bag: Annotated[Path, typer.Argument(help="A bag: a folder of the bridge or of rosbag2, or an .mcap file.")],
    actuators: Annotated[
        str, typer.Option(help="The twin's actuators, as the twin had them: ideal, stand-in, or a YAML file.")
    ] = "ideal",
    compare: Annotated[bool, typer.Option("--compare", help="Also a bag of another model: compare its faces only.")] = False,
    trial: Annotated[list[int] | None, typer.Option(min=1, help="Only this trial of a session; may be given often.")] = None,
    trials: Annotated[bool, typer.Option("--trials", help="Trial by trial, all of them.")] = False,
    ensemble: Annotated[int, typer.Option(min=0, max=10_000, help="Also each trial on so many perturbed twins.")] = 0,
    changes: Annotated[
        list[str] | None, typer.Option("--set", help="What if: NAME=VALUE of the model, such as mu_s=0.45; may be given often.")
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="PNG of the session, or of one trial; default: BAG_replay.png beside the bag; none with --json or for trials.",
            callback=picture_path,
        ),
    ] = None,
    animation: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A moving picture of the session, .webp or .gif, of eight seconds.", callback=writable),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Step the twin through the commands that were sent; compare faces with those observed, bits with the live twin's.

    Trial by trial the twin starts at rest on the trial's source and is told no face: where it parts from the record, how it ends.
    Exit code 0: same bits as live and on the recorded face at the end, or every trial's outcome as recorded; 4: not. A bag that was
    recorded with another model is refused with both hashes, unless numbers are changed (--set) or --compare says so.

    sixstrut replay bags/example
    sixstrut replay bags/example --picture session.png --set mu_s=0.45 --set mu_k=0.4
    sixstrut replay bags/example --animation rolls.webp
    sixstrut replay bags/monday/bags/session_20260102_030405 --trial 17 --ensemble 24 --picture trial.png
    """
    announce(f"stepping the twin through {bag}")
    from sim_core.rolling.warm_up import Stage
    from tensegrity_lab.bags.trial_replay import parsed_changes
    from tensegrity_lab.terminal.compile_notice import compile_first

    asked = parsed_changes(changes or [])
    if ensemble and not (trial or trials):
        raise typer.BadParameter("--ensemble tells how likely trials were: give --trial N or --trials too")
    if animation is not None and (trial or trials or animation.suffix not in (".webp", ".gif")):
        raise typer.BadParameter("it shows a whole session: a file .webp or .gif, without --trial", param_hint="--animation")
    compile_first(Stage.ROBOT, *([Stage.BATCH] if ensemble else []))
    if trial or trials:
        same = _by_trial(bag, trial or [], ensemble, asked, compare, picture, as_json)
    else:
        same = _whole(bag, asked, actuators, compare, picture, animation, as_json)
    if not same:
        raise typer.Exit(4)


def _by_trial(
    bag: Path, numbers: Sequence[int], members: int, changes: dict[str, float], compare: bool, picture: Path | None, as_json: bool
) -> bool:
    from hardware_bridge.recording.bag_reader import read_bag
    from hardware_bridge.recording.bag_types import TOPICS
    from sim_core.studies.binomial_intervals import counted
    from sim_core.studies.rehearsal import Ensemble
    from tensegrity_lab.bags import trial_replay
    from tensegrity_lab.bags.replay import require_same_model
    from tensegrity_lab.reports.trial_plots import course_picture

    lines = trial_replay.chosen_trials(trial_replay.trials_of(bag), numbers)
    if picture is not None and len(lines) != 1:
        raise typer.BadParameter(f"--picture shows one trial, and {len(lines)} are asked for: give --trial N")
    recorded = read_bag(bag, topics=TOPICS)
    session = recorded.session(until_ns=0)  # its attachments
    model = trial_replay.changed_model(session, changes)
    if not (changes or compare):
        require_same_model(session, model)
    courses = []
    for line in lines:
        if numbers or line.robot_s == line.robot_s:  # a trial that never ended is replayed only if asked for
            courses.append(trial_replay.replay_trial(recorded, line, model))
            if not as_json:
                say(trial_replay.course_text(courses[-1]))
    odds = {}
    if members:
        shelf = trial_replay.library_of(session)
        gaits = {gait.name: gait for gait in (trial_replay.gait_in(shelf, course.line) for course in courses)}
        law = Ensemble(model, members=members)
        for told in law.rehearse(list(gaits.values())):
            odds[told.gait.name] = told
            if not as_json:
                ends = ", ".join(f"{face} {count}" for face, count in told.outcomes.items())
                rate = counted(told.rate.successes, members)
                say(f"{told.gait.name} on perturbed twins ({law.law.brief}): {rate}; ends on {ends}")
    agree = [course.agrees for course in courses if course.agrees is not None]
    if as_json:
        rows = [_document(course, odds) for course in courses]
        typer.echo(json.dumps({"bag": str(bag), "model_hash": model.hash, "changes": changes, "trials": rows}))
    else:
        what_if = f" with {', '.join(f'{name} = {value:g}' for name, value in changes.items())}" if changes else ""
        say(f"{sum(agree)} of {len(agree)} trials end as recorded{what_if}; model {model.hash}")
    if picture is not None:
        wrote(course_picture(courses[0], picture), err=as_json)
    return all(agree)


def _document(course: Any, odds: dict[str, Any]) -> dict[str, Any]:
    line = course.line
    told = odds.get(line.name)
    return {
        **{key: getattr(line, key) for key in ("number", "primitive", "source", "target", "chain", "rolls")},
        "outcome": str(line.outcome),
        "recorded_faces": list(line.faces),
        "twin_faces": list(course.faces),
        "twin_actuated": course.actuated,
        "twin_returned": course.returned,
        "twin_succeeds": course.succeeds,
        "agrees": course.agrees,
        "parted_s": course.parted_s,
        "largest_m": float(course.apart_m.max()) if len(course.apart_m) else None,
        "end_m": float(course.apart_m[-1]) if len(course.apart_m) else None,
        "odds": told and {"successes": told.rate.successes, "members": told.rate.trials, "outcomes": told.outcomes},
    }


def _whole(
    bag: Path, changes: dict[str, float], actuators: str, compare: bool, picture: Path | None, animation: Path | None, as_json: bool
) -> bool:
    from hardware_bridge.recording.bag_on_disk import whole_bag
    from hardware_bridge.recording.bag_reader import read_session
    from hardware_bridge.recording.bag_types import TOPICS
    from sim_core.dynamics.actuators import require_actuators
    from sim_core.dynamics.robot import Robot
    from sim_core.files.places import folder_problem
    from tensegrity_lab.bags.felt_faces import FeltFaces
    from tensegrity_lab.bags.replay import model_of, replay, require_same_model
    from tensegrity_lab.bags.trial_replay import changed_model
    from tensegrity_lab.reports.animation import Moment, Stand, animate, moment_of
    from tensegrity_lab.reports.figure import session_picture
    from tensegrity_lab.terminal.progress import bars

    if picture is None and not as_json:
        whole = whole_bag(bag.resolve())
        picture = (Path() if folder_problem(whole.parent) else whole.parent) / f"{whole.stem}_replay.png"
    drives = require_actuators(actuators)
    session = read_session(bag, topics=TOPICS)
    if not (changes or compare):
        require_same_model(session, model_of(session))
    model = changed_model(session, changes, drives)
    moments: list[Moment] = []
    felt = FeltFaces(session)

    def watch(time_s: float, robot: Robot) -> None:
        felt(time_s, robot)
        if animation is not None:
            moments.append(moment_of(time_s, robot))

    with bars("events", "nothing was written") as bar:
        result = replay(session, model, drives, bar("replaying"), watch)
    same_bits = result.same_states == result.live_states
    same_face = result.recorded is None or result.final == result.recorded

    def draw() -> None:
        shown = picture and session_picture(session, result, picture)
        stands = [Stand(check.time_s, check.predicted) for check in result.faces if check.predicted]
        title = f"{bag.name}: the twin, stepped through a recorded session"
        wrote(shown, animation and animate(moments, stands, animation, title), err=as_json)

    if as_json:
        told = {key: getattr(result, key) for key in ("digest", "step", "model_hash", "live_states", "same_states", "resets")}
        faces = [{**vars(check), "agrees": check.agrees} for check in result.faces]
        ends = {"final_face": result.final, "recorded_face": result.recorded}
        sensor = {"measurements": felt.measurements, "then": felt.then, "now": felt.now} if felt.measurements else None
        typer.echo(json.dumps({"bag": str(bag), **told, "faces": faces, **ends, "imu": sensor}))
        draw()
        return same_bits and same_face
    for check in result.faces:
        mark = "as" if check.agrees else "but"
        seen = f"{mark} {check.source} saw {check.observed or 'no face'}"
        say(f"  {check.time_s:6.1f} s  twin on {check.predicted or 'no face'}, {seen}")
    if result.live_states:
        verdict = "the same bits" if same_bits else f"different bits from event {result.first_difference} on"
        say(f"  {result.same_states} of {result.live_states} recorded states of the live twin: {verdict}")
    else:
        typer.echo("  the bag holds no states of a live twin with this model to compare with")
    if felt.measurements:
        say(f"  {felt.text()}")
    end = f"ended on {result.final or 'no face'}"
    say(f"  {end}, recorded: {result.recorded or 'nobody looked'}{'' if same_face else ' — they differ'}")
    say(f"  final state {result.digest} at step {result.step}, model {result.model_hash}")
    draw()
    return same_bits and same_face
