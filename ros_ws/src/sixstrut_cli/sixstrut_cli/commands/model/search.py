# SPDX-License-Identifier: Apache-2.0
"""`sixstrut search`: find a primitive library."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, output_folder, picture_path, require_output, say, wrote

if TYPE_CHECKING:
    from sim_core.gaits.library import Library
    from sim_core.search.cycle_search import CyclePlan, CycleSearch
    from sim_core.search.genetic_search import Progress, Search, SearchPlan
    from sim_core.structure.parameters import Prototype


def command(
    plan_name: Annotated[
        Literal["improved", "previous", "robust", "staged", "continuous"],
        typer.Argument(metavar="PLAN", help="improved, previous, robust, staged or continuous."),
    ] = "improved",
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Library YAML; default: out/search/PLAN.yaml.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Same seed and options, same library.")] = 1,
    keep: Annotated[
        int | None, typer.Option(min=1, help="Primitives per class, or cycles.", show_default="20 primitives, 2 cycles")
    ] = None,
    roll_class: Annotated[str | None, typer.Option("--class", help="TC6-TO5 or TO5-TC6; default: both.")] = None,
    active: Annotated[int | None, typer.Option(min=1, max=6, help="Struts that a policy may move.", show_default="6")] = None,
    apart: Annotated[int | None, typer.Option(min=1, help="Two primitives differ by so many mm in some strut.")] = None,
    generations: Annotated[int | None, typer.Option(min=1, help="At most so many.", show_default="the plan's")] = None,
    evaluations: Annotated[int | None, typer.Option(min=1, help="At most so many rolls of the nominal robot.")] = None,
    ensemble: options.Ensemble = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Begin anew, even if a stopped search could go on.")] = False,
    scheduler: options.Scheduler = None,
    picture: Annotated[Path | None, typer.Option(help="PNG; default: beside the library.", callback=picture_path)] = None,
    prototype: options.Prototype = None,
    as_json: options.Json = False,
) -> None:
    """Find primitives of both classes with a genetic algorithm; the shipped libraries are made by their plans' names.

    improved: feasible with the improved model. previous: with the paper's previous model. robust: improved, and those that work
    best on perturbed prototypes and inclined ground. staged: robust's, and those that tip in one stage and stand firm in the next.
    continuous: staged's primitives, and cycles that roll on without stopping.
    Ctrl-C stops it; the same command goes on after the last finished generation.

    sixstrut search
    sixstrut search robust -o my_library.yaml --seed 7
    sixstrut search continuous
    sixstrut search robust --ensemble my_ensemble.yaml -o my_library.yaml
    sixstrut search --active 3 --class TO5-TC6 --keep 5 -o three_struts.yaml
    """
    announce(f"searching a library by the plan {plan_name}: minutes, robust longer; Ctrl-C leaves, the same command goes on")
    from sim_core.gaits.library import library_text
    from sim_core.rolling.warm_up import Stage
    from sim_core.search.genetic_search import SearchPlan
    from sim_core.search.library_recipes import search_of
    from sim_core.structure.parameters import load_prototype
    from sim_core.studies.dask_runner import runner_of
    from tensegrity_lab.reports.library_plot import library_picture
    from tensegrity_lab.terminal.compile_notice import compile_first
    from tensegrity_lab.terminal.leaving import leaves_at_once

    path = output or output_folder("search") / f"{plan_name}.yaml"
    require_output(path, "primitive library")
    changes: dict[str, Any] = {"seed": seed, "keep": keep, "active": active, "apart_mm": apart, "generations": generations}
    changes |= {"evaluations": evaluations, "classes": roll_class and (roll_class,), "name": output and path.stem}
    changes = {name: value for name, value in changes.items() if value is not None}
    robot = load_prototype(prototype)
    plan = _plan(plan_name, robot, ensemble, changes)
    path.parent.mkdir(parents=True, exist_ok=True)
    if scheduler is None:
        compile_first(Stage.BATCH)
    stopped = path.with_suffix(".search.json")
    state = None if fresh else _read(stopped)
    with runner_of(scheduler) as runner:
        search = search_of(robot, plan, runner, state)
        wanted = "primitives of each class" if isinstance(plan, SearchPlan) else "cycles"
        say(f"searching {plan.keep} {wanted}, {plan.generations} generations at most", err=True)
        if state is not None:
            typer.echo(f"going on after generation {search.generation} of {stopped} (--fresh begins anew)", err=True)
        with leaves_at_once(f"every finished generation is kept in {stopped}; the same command goes on from there"):
            _run(search, stopped)
        say("choosing among the best on more robots", err=True)
        library = search.library()
    path.write_text(library_text(library), encoding="utf-8")
    stopped.unlink(missing_ok=True)
    done = search.progress
    drawn = picture or path.with_suffix(".png")
    if as_json:
        counts = {key: count for key, count in _counts(library).items() if count or key in done.found}
        typer.echo(json.dumps({"library": str(path), "hash": library.hash, "primitives": counts, "rolls": done.rolled}))
        library_picture(library, drawn)
        return
    _tell(library, done)
    wrote(path, library_picture(library, drawn))
    say(
        f"library {library.hash}, model {library.model_hash}: {done.rolled} rolls or chains of the nominal robot, "
        f"{done.trained} trials on training prototypes"
    )


def _plan(name: str, robot: Prototype, ensemble: Path | None, changes: Mapping[str, Any]) -> SearchPlan | CyclePlan:
    """The plan of that name, changed by the options given."""
    from sim_core.dynamics.model import build_model
    from sim_core.search.library_recipes import PLANS, fitted_to
    from sim_core.uncertainty.ensemble import load_posterior

    plan = PLANS[name]
    if ensemble is not None:
        if name != "robust":
            raise typer.BadParameter("robots of your own are for the plan robust", param_hint="--ensemble")
        posterior = load_posterior(ensemble)
        posterior.require(build_model(robot))
        plan = fitted_to(posterior)
    strange = [change for change in changes if not hasattr(plan, change)]
    if strange:
        option = {"classes": "class"}.get(strange[0], strange[0])
        raise typer.BadParameter(f"the plan {name} has no such choice: leave it out", param_hint=f"--{option}")
    return replace(plan, **changes)


def _counts(library: Library) -> dict[str, int]:
    from sim_core.structure.roll_classes import CLASSES

    counts = {name: sum(p.roll_class.name == name for p in library.primitives) for name in CLASSES}
    return counts | {"cycles": len(library.cycles)}


def _tell(library: Library, done: Progress) -> None:
    from sim_core.gaits.cycle import cycle_line

    for p in library.primitives:
        shown = ", ".join(f"{key} {value:g}" for key, value in p.margins.items())
        typer.echo(f"{p.name} {p.roll_class.name} {' '.join(f'{v:+d}' for v in p.policy)} mm: {shown}")
    for cycle in library.cycles:
        typer.echo(cycle_line(cycle))
    counts = _counts(library)
    for name in done.found:
        if counts[name] < done.wanted:
            typer.echo(f"only {counts[name]} of {done.wanted} {name} in {done.rolled} rolls", err=True)


def _read(path: Path) -> Mapping[str, Any] | None:
    from sim_core.errors import FileError
    from sim_core.files.bounded_reader import read_text

    try:
        state: Mapping[str, Any] = json.loads(read_text(path, 256_000_000))
    except FileNotFoundError:
        return None
    except (ValueError, RecursionError, FileError) as error:
        raise typer.BadParameter(f"{path} is damaged ({error}); --fresh begins anew") from error
    return state


def _run(search: Search | CycleSearch, keep: Path) -> None:
    """Search to the end, keeping the state after each generation."""
    from rich import progress
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[found]}"), TextColumn("{task.fields[speed]}"),
        TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip
    with progress.Progress(*columns, console=Console(stderr=True)) as bars:
        task = bars.add_task("generation 0", total=1.0, found="", speed="")
        while not search.done:
            search.step()
            _keep(search, keep)
            now = search.progress
            seconds = bars.tasks[0].elapsed or 1e-9
            found = ", ".join(f"{name} {now.found[name]}/{now.wanted} (best {now.best[name]:.2f})" for name in now.found)
            rolls = now.rolled + now.trained
            bars.update(
                task, completed=now.finished, description=f"generation {now.generation}", found=found,
                speed=f"{rolls} rolls, {rolls / seconds:.0f}/s",
            )  # fmt: skip


def _keep(search: Search | CycleSearch, path: Path) -> None:
    """Write the state so that an interruption leaves the old one or the new one, whole."""
    new = path.with_suffix(".new")
    new.write_text(json.dumps(search.state), encoding="utf-8")
    new.replace(path)
