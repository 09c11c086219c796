# SPDX-License-Identifier: Apache-2.0
"""`sixstrut report`: the figures of sessions of trials."""

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, output_folder, wrote


class _Greedy(TyperCommand):
    """`--against A B` means both: not A alone, and B among the others."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        words: list[str] = []
        behind = ""
        for word in args:
            if word.startswith("-"):
                behind = word
                words.append(word)
            elif behind == "--against":
                words += [word] if words[-1] == "--against" else ["--against", word]
            else:
                words.append(word)
        return super().parse_args(ctx, words)


COMMAND_CLASS = _Greedy


def command(
    sessions: Annotated[
        list[Path] | None,
        typer.Argument(help="Folders of sessions, or bags with trials; several are taken together; default: the newest."),
    ] = None,
    against: Annotated[list[Path] | None, typer.Option(help="Sessions to compare with: all that follow.")] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Folder to write to; default: report in the first session's, or BAG_report beside a bag."
        ),
    ] = None,
) -> None:
    """Success rates with intervals, the paper's Figure 8, tests, symmetry, predictions: one page, with CSV and PNG beside it.

    sixstrut report
    sixstrut report bags/monday
    sixstrut report bags/monday bags/tuesday --against bags/previous -o report
    """
    announce("reading the sessions and drawing, some seconds; the page is written at the end")
    from hardware_bridge.recording.bag_on_disk import is_bag, whole_bag
    from tensegrity_lab.reports.trial_report import TrialReport, summary_of
    from tensegrity_lab.session_data.folder import newest_session

    sessions = options.given_or(newest_session, sessions)
    words = ["./sixstrut", "report", *map(str, sessions), *(word for path in against or [] for word in ("--against", str(path)))]
    bag = whole_bag(sessions[0].resolve())
    beside = bag.with_name(f"{bag.stem}_report") if is_bag(bag) else sessions[0] / "report"
    folder = output_folder("report", output or beside)
    report = TrialReport(sessions, against or [], shlex.join(words))
    typer.echo(summary_of(report))
    wrote(report.write(folder))
    typer.echo("tables and pictures are beside it")
