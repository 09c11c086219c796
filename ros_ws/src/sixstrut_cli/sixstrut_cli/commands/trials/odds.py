# SPDX-License-Identifier: Apache-2.0
"""`sixstrut odds`: were the probabilities that rehearsals foretold right?"""

import json
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, output_folder, picture_path, say, wrote


def command(
    bags: Annotated[
        list[Path] | None,
        typer.Argument(metavar="BAG_OR_FOLDER...", help="Bags, and folders with bags; default: the newest session or bag."),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="PNG: predicted probability against the share that succeeded; default: out/odds/odds.png.", callback=picture_path
        ),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Set what the planner's rehearsals foretold against what then happened, roll by roll: calibration plot and Brier score.

    A roll counts if it was rehearsed and somebody, or the virtual prototype's observer, saw where it ended.

    sixstrut odds bags/example
    sixstrut odds bags/monday bags/tuesday --picture odds.png
    """
    announce("reading bags: some seconds for each that is large")
    from sim_core.studies.binomial_intervals import counted
    from tensegrity_lab.bags.rehearsed_rolls import bags_of, foretold_in, newest
    from tensegrity_lab.reports.success_statistics import calibration
    from tensegrity_lab.reports.trial_plots import calibration_picture

    picture = picture or output_folder("odds") / "odds.png"
    files = bags_of(options.given_or(newest, bags))
    found = [one for path in files for one in foretold_in(path)]
    rolls = [one for one in found if not one.is_chain]
    if len(found) > len(rolls):
        typer.echo(
            f"left out: {len(found) - len(rolls)} chain(s); single rolls are compared here, `report` counts chains", err=True
        )
    told = calibration([one.odds for one in rolls], [one.won for one in rolls])
    if told is None:
        typer.echo(
            f"no roll in {len(files)} bag(s) was rehearsed and then seen to end: the planner's parameter rehearse_members is 0, "
            "or nobody looked (set_face)",
            err=True,
        )
        raise typer.Exit(1)
    if as_json:
        document = {"rolls": [one._asdict() for one in rolls], "brier": told.brier, "expected": told.expected}
        bins = [(one.low, one.high, one.rate.trials, one.expected, one.rate.value) for one in told.bins]
        typer.echo(json.dumps(document | {"observed": told.observed, "bins": bins, "picture": str(picture)}))
        calibration_picture([(f"{len(rolls)} rolls", told)], picture)
        return
    say(f"{'foretold':>15}  {'mean':>6}  succeeded")
    for one in told.bins:
        share = counted(one.rate.successes, one.rate.trials)
        say(f"{100 * one.low:6.0f} … {100 * one.high:3.0f} %  {100 * one.expected:4.0f} %  {share}")
    say(
        f"{len(rolls)} rolls of {len(files)} bag(s): {100 * told.expected:.1f} % foretold, {100 * told.observed:.1f} % succeeded; "
        f"Brier score {told.brier:.3f} (0: perfect; 0.25: a coin)"
    )
    for roll in rolls:
        if not roll.won:
            where = f"most rehearsals ended on {roll.likely}, {round(roll.members * roll.odds)} of {roll.members} rolled"
            say(f"{roll.bag}: {roll.primitive} {roll.source}→{roll.target} ended on {roll.ended or 'no face'}; {where}")
    wrote(calibration_picture([(f"{len(rolls)} rolls", told)], picture))
