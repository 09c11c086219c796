# SPDX-License-Identifier: Apache-2.0
"""`sixstrut bench`: speed, accuracy and memory, side by side with MuJoCo; or, with --stack, what the stack itself costs."""

import importlib
import json
import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, import_checkout, output_folder, results_page, wrote


def command(
    stack: Annotated[
        bool, typer.Option("--stack", help="What the stack itself costs instead: twin, latency, recorder, processes, start.")
    ] = False,
    library: Annotated[
        str | None, typer.Option(metavar="NAME", help="Only roll this library's gaits and cycles in MuJoCo, and count.")
    ] = None,
    imu: Annotated[bool, typer.Option("--imu", help="Only how well an inertial sensor in the box tells the face.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="A minute or two, rougher figures; not for --page.")] = False,
    threads: Annotated[
        int | None, typer.Option(min=1, help="Threads to measure besides one; default: 2, if there are two processors.")
    ] = None,
    output: options.Output = None,
    page: options.Page = False,
    as_json: options.Json = False,
    prototype: options.Prototype = None,
) -> None:
    """Measure the solver beside MuJoCo: the same robot, the same policies, one run (about five minutes).

    The first run installs MuJoCo. With --stack, measure what the stack itself costs instead (about
    as long, no MuJoCo). Leave the computer alone while it measures.

    sixstrut bench
    sixstrut bench --stack
    sixstrut bench --stack --quick --json
    sixstrut bench --library continuous --page
    sixstrut bench --imu --quick
    """
    import_checkout()
    if page and (quick or prototype is not None):
        raise typer.BadParameter("the page is of a whole run: leave --quick and --prototype out", param_hint="--page")
    if imu:
        if stack or library is not None or output is not None or prototype is not None:
            raise typer.BadParameter("it writes no file and measures nothing else: leave the others out", param_hint="--imu")
        _tell_faces(quick, threads, results_page("imu.md") if page else None, as_json)
        return
    name = "rolling_on.md" if library else "benchmark_stack.md" if stack else "benchmark.md"
    path = results_page(name) if page else output_folder("bench", output) / name
    announce("measuring, about five minutes; --quick one or two; Ctrl-C leaves at any time, then nothing is written")
    if library is not None:
        _in_mujoco(library, 4 if quick else 20, threads, path if page else None, as_json, prototype)
    elif stack:
        if threads is not None or prototype is not None:
            raise typer.BadParameter("--threads and --prototype are of the solver's benchmark: leave them out with --stack")
        _measure_stack(quick, path, as_json)
    else:
        _measure_solver(quick, threads, path, as_json, prototype)


def _say(what: str) -> None:
    typer.echo(what, err=True)


def _measure_stack(quick: bool, path: Path, as_json: bool) -> None:
    from tests.benchmarks.stack import measure, metrics, report

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # its processes have to be ended
    _tell(report, measure.measure(metrics.QUICK if quick else metrics.Plan(), _say), path, as_json)


def _measure_solver(quick: bool, threads: int | None, path: Path, as_json: bool, prototype: Path | None) -> None:
    from sim_core.dynamics.model import build_model
    from sim_core.structure.parameters import load_prototype
    from sim_core.twin.model_versions import label_of
    from tests.benchmarks.solver import equilibrium, measure, report

    load = os.getloadavg()[0]
    most = threads or min(2, os.cpu_count() or 1)
    plan = measure.Plan(threads=tuple(dict.fromkeys((1, most))))
    if quick:
        plan = replace(plan, tasks=8, rounds=2, budget_s=0.1, judged=64, memory_rolls=4)
    robot = load_prototype(prototype)
    tasks = measure.tasks_of(robot, plan.tasks, plan.seed)
    speeds = measure.speeds(measure.engines_of(robot), measure.moments_of(tasks, plan.seed), plan, _say)
    judged = measure.judged_rolls(robot, measure.tasks_of(robot, plan.judged, plan.seed), most, _say)
    rehearsal = measure.rehearsal(robot, most, _say)
    rests = equilibrium.rests(robot)
    accuracies = measure.accuracies(robot, tasks, most, _say)
    memories = measure.memories(str(prototype) if prototype else None, plan, _say)
    machine = report.this_machine(importlib.import_module("mujoco").__version__, (load, os.getloadavg()[0]))
    result = report.Report(machine, plan, label_of(build_model(robot).hash), speeds, judged, rehearsal, rests, accuracies, memories)
    _tell(report, result, path, as_json)


def _tell(report: Any, result: Any, path: Path, as_json: bool) -> None:
    """Write the page and its picture; print it. `report`: the module that knows how."""
    picture = path.parent / "images" / f"{path.stem}.png"
    typer.echo(report.as_json(result) if as_json else report.as_markdown(result, None))
    path.write_text(report.as_markdown(result, f"images/{picture.name}"), encoding="utf-8")
    wrote(path, report.draw(result, picture), err=True)


def _tell_faces(quick: bool, threads: int | None, page: Path | None, as_json: bool) -> None:
    from tensegrity_lab.reports.markdown import write_into
    from tests.benchmarks.imu import faults, measure

    cores, rolls = threads or min(2, os.cpu_count() or 1), 600 if quick else 30_000
    _say(f"some {rolls} rolls; 600 take a minute on two processors; Ctrl-C leaves at any time, then nothing is written")
    found = measure.measured(rolls, cores, 1, _say)
    typer.echo(json.dumps(measure.document_of(found)) if as_json else measure.text_of(found))
    if as_json and page is None:
        return
    spoilt = faults.tables(*((10, 10) if quick else (200, 200)), cores, 1)
    typer.echo(f"\n{spoilt}", err=as_json)
    if page:
        write_into(page, "imu", measure.text_of(found))
        write_into(page, "imu faults", spoilt)
        wrote(page, err=as_json)


def _in_mujoco(name: str, robots: int, threads: int | None, page: Path | None, as_json: bool, prototype: Path | None) -> None:
    from sim_core.gaits.library import load_library
    from sim_core.structure.parameters import load_prototype
    from tensegrity_lab.reports.markdown import write_into
    from tests.benchmarks.solver import cycles_in_mujoco, library_in_mujoco

    shelf, robot, cores = load_library(name), load_prototype(prototype), threads or min(2, os.cpu_count() or 1)
    if page and not shelf.cycles:
        raise typer.BadParameter(f"library {shelf.name} has no cycles for the page: leave --page out", param_hint="--page")
    _say(f"rolling {24 * len(shelf.primitives)} gaits in MuJoCo, a minute or so; each cycle some minutes")
    tried = library_in_mujoco.tried_in_mujoco(robot, shelf, cores)
    compared = cycles_in_mujoco.compared_with_mujoco(robot, shelf, robots, cores) if shelf.cycles else []
    if as_json:
        works, pairs = tried.possible
        rates = {p.name: rate.value for p, rate in zip(shelf.primitives, tried.rates, strict=True)}
        document = {"library": shelf.name, "hash": shelf.hash, "rates": rates, "all": float(tried.wins.mean())}
        document |= {"rolls_with_a_gait": works, "rolls": pairs, "cycles": cycles_in_mujoco.compared_document(compared)}
        typer.echo(json.dumps(document))
    else:
        typer.echo(library_in_mujoco.text_of(tried))
        if compared:
            typer.echo("\n" + cycles_in_mujoco.compared_text(shelf, compared))
    if page:
        write_into(page, "mujoco", cycles_in_mujoco.compared_text(shelf, compared))
        wrote(page, err=as_json)
