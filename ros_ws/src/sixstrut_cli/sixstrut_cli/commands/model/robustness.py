# SPDX-License-Identifier: Apache-2.0
"""`sixstrut robustness`: how often a library's gaits work on prototypes nobody trained on."""

from __future__ import annotations

import json
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import (
    announce,
    import_checkout,
    in_folder,
    output_folder,
    picture_path,
    results_page,
    writable_folder,
    wrote,
)

if TYPE_CHECKING:
    from sim_core.gaits.library import Library
    from sim_core.structure.parameters import Prototype
    from sim_core.studies.attribution import Attribution
    from sim_core.studies.robustness import Study, StudyPlan
    from tests.studies.study_cost import Figures

QUICK_PROTOTYPES, QUICK_FAILURES, QUICK_PRIMITIVES = 2, 20, 3


def command(
    library: Annotated[str, typer.Argument(metavar="LIBRARY", help="A shipped library's name, or a YAML file.")],
    prototypes: Annotated[int, typer.Option(min=1, help="Perturbed prototypes, K.")] = 20,
    scale: Annotated[float, typer.Option(help="Their perturbation s, 0.05 for ±5 %.")] = 0.05,
    seed: Annotated[int | None, typer.Option(min=0, help="Of the prototypes; never a training seed.", show_default="90001")] = None,
    first: Annotated[int, typer.Option(min=0, help="Number of the first prototype of this seed: to do a study in slices.")] = 0,
    groups: Annotated[
        str, typer.Option(help="Uncertainties, with commas: judged, all, or names; a leading - takes one out.")
    ] = "judged",
    correlation: Annotated[float, typer.Option(help="Of ropes, nodes, struts or joints of one batch, 0 to 1.")] = 0.0,
    incline: Annotated[float, typer.Option(help="Incline of the ground in degrees, downhill all round.")] = 0.0,
    design: Annotated[str, typer.Option(help="independent, or sobol (low discrepancy).")] = "independent",
    one_gait: Annotated[
        bool, typer.Option("--one-gait", help="The reference gait on 24 K prototypes instead of 24 gaits on K.")
    ] = False,
    failures: Annotated[int, typer.Option(min=0, help="Failed trials to try again, to see what kills them; 0: none.")] = 200,
    scheduler: options.Scheduler = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="PNG, like the paper's Figure 8; default: out/robustness/LIBRARY.png; none with --json.", callback=picture_path
        ),
    ] = None,
    tables: Annotated[
        Path | None, typer.Option("--csv", metavar="FOLDER", help="Folder for the CSV tables.", callback=writable_folder)
    ] = None,
    odds: options.SuccessCounts = None,
    cycles: Annotated[
        bool, typer.Option("--cycles", help="Roll on by the library's cycles instead, with ideal and with loaded actuators.")
    ] = False,
    cost: Annotated[bool, typer.Option("--cost", help="Also measure and print what a million prototypes cost.")] = False,
    page: Annotated[bool, typer.Option("--page", help="With --cost or --cycles: put the table into docs/results.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="A few primitives on two prototypes: to see that it works.")] = False,
    prototype: options.Prototype = None,
    as_json: options.Json = False,
) -> None:
    """Roll all 24 gaits of every primitive on perturbed, held-out prototypes.

    Success rates with intervals, which uncertainty kills which gait, picture, tables. With --cycles: twelve rolls in a row without
    a stop, on 24 K prototypes: rates, speed, and how far it goes in ten minutes under the actuators' duty.

    sixstrut robustness robust --scale 0.1 --picture robust.png --csv robust/
    sixstrut robustness robust --groups judged,slope --prototypes 50 --scheduler tcp://host:8786
    sixstrut robustness my_library.yaml --one-gait --design sobol --json
    sixstrut robustness robust --quick --cost
    sixstrut robustness continuous --cycles --scale 0.1
    """
    if page and not (cost or cycles):
        raise typer.BadParameter("the pages hold what a study costs, and cycles: give --cost or --cycles", param_hint="--page")
    if cycles and (cost or odds or tables or picture or one_gait):
        raise typer.BadParameter(
            "cycles have no picture, tables, odds or costs: leave --picture, --csv, --odds, --cost and --one-gait out",
            param_hint="--cycles",
        )
    page_path = results_page("rolling_on.md" if cycles else "scaling.md") if page else None
    announce(f"rolling the gaits of {library} on perturbed prototypes; how long it takes is measured first")
    from sim_core.dynamics.model import build_model
    from sim_core.gaits.library import load_library
    from sim_core.structure.parameters import load_prototype
    from sim_core.studies.attribution import attribute
    from sim_core.studies.dask_runner import runner_of
    from sim_core.studies.local_runner import compile_kernels
    from sim_core.studies.robustness import HELD_OUT_SEED, StudyPlan, require_held_out, study
    from sim_core.uncertainty.perturbation_law import Law, groups_of
    from tensegrity_lab.terminal.forecast import say_forecast
    from tensegrity_lab.terminal.progress import bars

    robot, shelf = load_prototype(prototype), load_library(library)
    law = Law(scale, groups_of(groups), correlation, design, incline)
    plan = StudyPlan(law, HELD_OUT_SEED if seed is None else seed, QUICK_PROTOTYPES if quick else prototypes, one_gait, first)
    require_held_out(shelf, plan.seed)
    if cycles:
        count = plan.prototypes * (QUICK_PRIMITIVES if quick else 24)
        _roll_on(robot, shelf, plan, count, scheduler, page_path, as_json)
        return
    if picture is None and not as_json:
        picture = output_folder("robustness") / f"{shelf.name}.png"
    primitives = shelf.primitives
    if quick:
        failures = min(failures, QUICK_FAILURES)
        classes = {p.roll_class: [q for q in primitives if q.roll_class is p.roll_class] for p in primitives}
        primitives = tuple(p for rows in classes.values() for p in rows[:QUICK_PRIMITIVES])
    if scheduler is None:
        compile_kernels(robot)  # not counted as work
        rolls = len(primitives) * 24 * plan.prototypes
        say_forecast(f"{len(primitives)} primitives × 24 gaits × {plan.prototypes} prototypes", rolls, build_model(robot))
    with runner_of(scheduler) as run, bars("rolls", "nothing was written; --first and --prototypes do a study in slices") as bar:
        began = perf_counter()
        found = study(robot, primitives, plan, run, bar("trials"))
        wall_s = perf_counter() - began
        blame = attribute(robot, found, failures, run, bar("what kills")) if failures else None
    figures = None
    if cost:
        import_checkout()
        from tests.studies.study_cost import figures_of

        figures = figures_of(robot, found)
    _tell(shelf, found, blame, wall_s, figures, page_path, tables, odds, picture, as_json)


def _tell(
    shelf: Library, found: Study, blame: Attribution | None, wall_s: float, figures: Figures | None, page: Path | None,
    tables: Path | None, odds: Path | None, picture: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Print and write what was found."""
    from sim_core.gaits.success_counts import success_counts_text
    from sim_core.studies.robustness import success_counts_of
    from tensegrity_lab.reports.markdown import write_into
    from tensegrity_lab.reports.robustness_plot import robustness_picture
    from tensegrity_lab.reports.robustness_report import document_of, head_of, text_of, write_tables

    if tables is not None:
        write_tables(found, blame, tables)
    if odds is not None:
        in_folder(odds).write_text(success_counts_text(success_counts_of(shelf, found)), encoding="utf-8")
    if figures is not None and page is not None:
        write_into(page, "cost", figures.table)
    if as_json:
        document = document_of(shelf, found, blame, wall_s)
        typer.echo(json.dumps(document | ({"figures": figures.document} if figures else {})))
    else:
        typer.echo(text_of(shelf, found, blame, wall_s))
        if figures is not None:
            typer.echo("\n" + figures.table)
    drawn = picture and robustness_picture(
        found, blame, picture, head_of(shelf, found).splitlines()[0] + f", s = {found.plan.law.scale:g}"
    )
    wrote(drawn, tables, odds, page, err=as_json)


def _roll_on(
    robot: Prototype, shelf: Library, plan: StudyPlan, count: int, scheduler: str | None, page: Path | None, as_json: bool
) -> None:
    """The study of cycles on `count` prototypes."""
    from sim_core.dynamics.actuators import IDEAL, STAND_IN, load_actuators
    from sim_core.dynamics.model import build_model
    from sim_core.errors import LibraryError
    from sim_core.studies.dask_runner import runner_of
    from tensegrity_lab.reports.markdown import write_into
    from tensegrity_lab.terminal.progress import bars

    import_checkout()
    from tests.studies.chain_report import chains_document, chains_text
    from tests.studies.chain_study import chain_study
    from tests.studies.pace_bound import pace_bounds

    if not shelf.cycles:
        raise LibraryError(
            f"library {shelf.name!r} has no cycles: the shipped continuous has; `sixstrut search continuous` makes some"
        )
    actuators = ((IDEAL, None), (STAND_IN, load_actuators()))
    with runner_of(scheduler) as run, bars("chains", "nothing was written") as bar:
        chains = chain_study(robot, shelf, plan.law, plan.seed, count, actuators, run, bar("trials"))
    about = shelf, plan.law, plan.seed, count, chains, pace_bounds(build_model(robot))
    typer.echo(json.dumps(chains_document(*about)) if as_json else chains_text(*about))
    if page is not None:
        write_into(page, "cycles", chains_text(*about))
    wrote(page, err=as_json)
