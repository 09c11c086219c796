# SPDX-License-Identifier: Apache-2.0
"""`sixstrut faults`: the failures that must be survived, made to happen."""

import json
import signal
from typing import Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, import_checkout, output_folder, results_page, say, wrote

ROWS = range(1, 26)
PAGE = "failures.md"
EXIT_NOT_SURVIVED = 4


def command(
    only: Annotated[str, typer.Option("--only", help="Only these rows, such as 3,14.")] = "",
    output: options.Output = None,
    page: options.Page = False,
    as_json: options.Json = False,
    domain: options.Domain = None,
) -> None:
    """Make each failure happen to the real nodes with a virtual prototype, and look what comes of it (three to five minutes).

    All rows together make a page, failures.md.

    Exit code 0: all were survived; 4: one was not.

    sixstrut faults
    sixstrut faults --only 3,14
    """
    import_checkout()
    numbers = _numbers(only)
    announce(f"{len(numbers)} failures, some seconds each; Ctrl-C ends at any time, then nothing is written")
    if page and numbers != set(ROWS):
        raise typer.BadParameter("a page needs all rows: leave --only out")
    folder = None if page or numbers != set(ROWS) else output_folder("faults", output)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # its processes have to be ended

    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from sim_core.rolling.warm_up import Stage
    from tensegrity_lab.terminal.compile_notice import compile_first
    from tests.failures.page import as_markdown, without_folders
    from tests.failures.runner import run

    compile_first(Stage.ROBOT, Stage.BATCH)
    console = Console(stderr=True)
    outcomes = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=as_json) as bar:
        task = bar.add_task("", total=len(numbers))
        show = lambda row: bar.update(task, description=f"{row.number:2} {row.failure[:60]}")  # noqa: E731
        for outcome in run(numbers, show, domain, lambda line: bar.console.print(line, highlight=False)):
            outcomes.append(outcome)
            bar.advance(task)
            mark = "[red]FAILED[/red]" if outcome.problem else "[green]survived[/green]"
            bar.console.print(f"{outcome.scenario.number:3}  {mark}  {outcome.seconds:5.1f} s  {outcome.scenario.failure}")
    outcomes.sort(key=lambda outcome: outcome.scenario.number)
    failed = [outcome for outcome in outcomes if outcome.problem]
    if as_json:
        rows = [
            {
                "number": outcome.scenario.number,
                "failure": outcome.scenario.failure,
                "survived": not outcome.problem,
                "problem": outcome.problem,
                "told": outcome.evidence.told,
                "figures": outcome.evidence.figures,
                "boards": outcome.evidence.rows,
                "seconds": round(outcome.seconds, 1),
            }
            for outcome in outcomes
        ]
        typer.echo(json.dumps(rows))
    else:
        for outcome in outcomes:
            boards = [f"{board}: {', '.join(f'{k} {v}' for k, v in row.items())}" for board, row in outcome.evidence.rows.items()]
            measured = [f"{key}: {value:g}" for key, value in outcome.evidence.figures.items()]
            seen = [f"FAILED: {outcome.problem}"] if outcome.problem else map(without_folders, outcome.evidence.told)
            say(f"{outcome.scenario.number:3}  {outcome.scenario.failure}")
            for line in (*(f"operator sees: {told}" for told in seen), *measured, *boards):
                say(f"     {line}")
    if failed:
        raise typer.Exit(EXIT_NOT_SURVIVED)
    if numbers == set(ROWS):
        path = folder / PAGE if folder is not None else results_page(PAGE)
        path.write_text(as_markdown(outcomes), encoding="utf-8")
        wrote(path, err=True)


def _numbers(only: str) -> set[int]:
    """The rows asked for; all without a word."""
    if not only:
        return set(ROWS)
    parts = [part.strip() for part in only.split(",")]
    if not all(part.isdigit() and int(part) in ROWS for part in parts):
        raise typer.BadParameter(f"--only is {only!r}, valid are numbers from 1 to {len(ROWS)} with commas between, such as 3,14")
    return {int(part) for part in parts}
