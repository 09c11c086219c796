# SPDX-License-Identifier: Apache-2.0
"""`sixstrut validate`: the solver against mechanics."""

from __future__ import annotations

import json
from fnmatch import fnmatch
from time import perf_counter
from typing import TYPE_CHECKING, Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, import_checkout, output_folder, results_page, say, wrote

if TYPE_CHECKING:
    from tests.validation import Case

EXIT_CASE_FAILED = 4
PAGE = "validation.md"


def command(
    only: Annotated[
        str | None, typer.Option(metavar="PATTERN", help="Only cases whose name holds this, or matches it (with * and ?).")
    ] = None,
    output: options.Output = None,
    page: options.Page = False,
    as_json: options.Json = False,
    prototype: options.Prototype = None,
) -> None:
    """Compare the solver with closed forms and independent computations (a minute or two), and write a page of the results.

    Exit code 0: every case holds; 4: one does not.

    sixstrut validate
    sixstrut validate --only restitution
    sixstrut validate --only 'elastica*' -o elastica
    """
    import_checkout()
    announce("the solver against closed forms: all cases take a minute or two; Ctrl-C leaves at any time")
    from sim_core.dynamics.model import build_model
    from sim_core.structure.parameters import load_prototype
    from tensegrity_lab.terminal.progress import bars
    from tests.validation import CASES, Setting
    from tests.validation.page import write_page

    chosen = [name for name in CASES if only is None or only in name or fnmatch(name, only)]
    if not chosen:
        raise typer.BadParameter(f"no case matches {only!r}: valid are {', '.join(CASES)}", param_hint="--only")
    if page and (only is not None or prototype is not None):
        raise typer.BadParameter(
            "the page is of all cases and the nominal robot: leave --only and --prototype out", param_hint="--page"
        )
    path = results_page(PAGE) if page else output_folder("validate", output) / PAGE
    setting = Setting(load_prototype(prototype))
    model = build_model(setting.prototype)
    results: dict[str, Case] = {}
    seconds: dict[str, float] = {}
    with bars("cases", "nothing was written") as bar:
        report = bar("cases")
        for number, name in enumerate(chosen, start=1):
            began = perf_counter()
            results[name] = CASES[name](setting)
            seconds[name] = perf_counter() - began
            report(number, len(chosen))
    failed = [name for name, case in results.items() if not case.result.passed]
    if as_json:
        typer.echo(json.dumps(_document(results, seconds, model.hash), indent=1))
    else:
        _print_cases(results)
        typer.echo(f"{len(results) - len(failed)} of {len(results)} cases hold, model {model.hash}, {sum(seconds.values()):.0f} s")
    files = write_page(path, results, model.hash, model.steps_per_second)
    wrote(path, err=as_json)
    typer.echo(f"and {len(files) - 1} pictures", err=as_json)
    if failed:
        typer.echo(f"not within tolerance: {', '.join(failed)}", err=True)
        raise typer.Exit(EXIT_CASE_FAILED)


def _document(results: dict[str, Case], seconds: dict[str, float], model_hash: str) -> dict[str, object]:
    return {
        "schema": 1,
        "model_hash": model_hash,
        "passed": all(case.result.passed for case in results.values()),
        "cases": [
            {
                "case": name,
                "name": case.name,
                "checked": case.checked,
                **case.result._asdict(),
                "error": case.result.error,
                "passed": case.result.passed,
                "source": case.source,
                "note": case.note,
                "seconds": round(seconds[name], 2),
            }
            for name, case in results.items()
        ],
    }


def _print_cases(results: dict[str, Case]) -> None:
    from tests.validation.page import allowed, number, with_unit

    for name, case in results.items():
        result = case.result
        verdict, measured = "holds" if result.passed else "FAILS", with_unit(result.measured, result.unit)
        say(f"{verdict}  {name}: {measured}, reference {number(result.reference)} {allowed(result, unit=False)}")
