# SPDX-License-Identifier: Apache-2.0
"""`sixstrut robustness`: how often a library's gaits work on prototypes nobody trained on."""

import json
from pathlib import Path
from time import perf_counter
from typing import Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, in_folder, output_folder, picture_path, results_page, writable_folder, wrote

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
    cost: Annotated[bool, typer.Option("--cost", help="Also measure and print what a million prototypes cost.")] = False,
    page: Annotated[bool, typer.Option("--page", help="With --cost: put the table into docs/results/scaling.md.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="A few primitives on two prototypes: to see that it works.")] = False,
    prototype: options.Prototype = None,
    as_json: options.Json = False,
) -> None:
    """Roll all 24 gaits of every primitive on perturbed, held-out prototypes.

    Success rates with intervals, which uncertainty kills which gait, picture, tables.

    sixstrut robustness robust --scale 0.1 --picture robust.png --csv robust/
    sixstrut robustness robust --groups judged,slope --prototypes 50 --scheduler tcp://host:8786
    sixstrut robustness my_library.yaml --one-gait --design sobol --json
    sixstrut robustness robust --quick --cost
    """
    if page and not cost:
        raise typer.BadParameter("the page holds what a study costs: give --cost as well", param_hint="--page")
    cost_page = results_page("scaling.md") if page else None
    announce(f"rolling the gaits of {library} on perturbed prototypes; how long it takes is measured first")
    from sim_core.dynamics.model import build_model
    from sim_core.gaits.library import load_library
    from sim_core.gaits.success_counts import success_counts_text
    from sim_core.structure.parameters import load_prototype
    from sim_core.studies.attribution import attribute
    from sim_core.studies.dask_runner import runner_of
    from sim_core.studies.local_runner import compile_kernels
    from sim_core.studies.robustness import HELD_OUT_SEED, StudyPlan, require_held_out, study, success_counts_of
    from sim_core.uncertainty.perturbation_law import Law, groups_of
    from tensegrity_lab.reports.robustness_plot import robustness_picture
    from tensegrity_lab.reports.robustness_report import document_of, head_of, text_of, write_tables
    from tensegrity_lab.reports.study_cost import document_of as cost_document
    from tensegrity_lab.reports.study_cost import figures_of, table_of, write_into
    from tensegrity_lab.terminal.forecast import say_forecast
    from tensegrity_lab.terminal.progress import bars

    robot, shelf = load_prototype(prototype), load_library(library)
    law = Law(scale, groups_of(groups), correlation, design, incline)
    plan = StudyPlan(law, HELD_OUT_SEED if seed is None else seed, QUICK_PROTOTYPES if quick else prototypes, one_gait, first)
    require_held_out(shelf, plan.seed)
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
    figures = figures_of(robot, found) if cost else None
    if tables is not None:
        write_tables(found, blame, tables)
    if odds is not None:
        in_folder(odds).write_text(success_counts_text(success_counts_of(shelf, found)), encoding="utf-8")
    if figures is not None and cost_page is not None:
        write_into(cost_page, table_of(figures))
    if as_json:
        document = document_of(shelf, found, blame, wall_s)
        typer.echo(json.dumps(document | ({"figures": cost_document(figures)} if figures else {})))
    else:
        typer.echo(text_of(shelf, found, blame, wall_s))
        if figures is not None:
            typer.echo("\n" + table_of(figures))
    drawn = picture and robustness_picture(found, blame, picture, head_of(shelf, found).splitlines()[0] + f", s = {scale:g}")
    wrote(drawn, tables, odds, cost_page, err=as_json)
