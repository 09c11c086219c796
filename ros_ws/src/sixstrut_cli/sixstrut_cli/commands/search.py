"""`sixstrut search`: find a primitive library."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli.commands.options import PrototypeOption


def command(
    output: Annotated[Path, typer.Option("--output", "-o", help="Library YAML to write.")] = Path("library.yaml"),
    seed: Annotated[int, typer.Option(help="Same seed, same library.")] = 1,
    candidates: Annotated[int, typer.Option(min=1, help="Feasible policies to find per class before choosing.")] = 24,
    keep: Annotated[int, typer.Option(min=1, help="Primitives to keep per class.")] = 6,
    training: Annotated[int, typer.Option(min=1, help="Perturbed prototypes on which candidates are tried.")] = 8,
    scale: Annotated[float, typer.Option(help="Their perturbation, 0.05 for ±5 %.")] = 0.05,
    prototype: PrototypeOption = None,
) -> None:
    """Find primitives of both classes by a seeded random search (some minutes). The shipped library `first` is this command's.

    sixstrut search -o mine.yaml
    sixstrut search --seed 7 --candidates 20 --keep 10
    """
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from sim_core.library import library_text
    from sim_core.model import build_model
    from sim_core.parameters import load_prototype
    from sim_core.search import Progress as Step
    from sim_core.search import SearchPlan, search
    from sim_core.warm_up import Stage
    from sixstrut_cli.compiling import compile_first

    plan = SearchPlan(seed, candidates, keep, training, scale)
    model = build_model(load_prototype(prototype))
    compile_first(Stage.BATCH)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed}/{task.total}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns) as bars:
        tasks = {}

        def report(step: Step) -> None:
            key = (step.roll_class, step.phase)
            if key not in tasks:
                tasks[key] = bars.add_task("", total=step.total)
            what = f"finding ({step.tried} policies tried)" if step.phase == "find" else "trials in 24 gaits"
            bars.update(tasks[key], completed=step.done, description=f"{step.roll_class}: {what}")

        library = search(model, plan, report)
    output.write_text(library_text(library), encoding="utf-8")
    for primitive in library.primitives:
        margins = primitive.margins
        typer.echo(
            f"{primitive.name} {primitive.roll_class.name} {' '.join(f'{v:+d}' for v in primitive.policy)} mm: "
            f"{100 * margins['success']:.0f} % of {margins['trials']:.0f} trials at ±{100 * scale:g} %"
        )
    typer.echo(f"wrote {output} (library {library.hash}, model {library.model_hash})")
