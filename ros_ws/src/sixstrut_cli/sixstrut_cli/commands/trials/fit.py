# SPDX-License-Identifier: Apache-2.0
"""`sixstrut fit`: what trials say of this robot."""

import json
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, import_checkout, in_folder, output_folder, output_of, results_page, wrote


def command(
    trials: Annotated[
        list[Path] | None,
        typer.Argument(metavar="SESSION_OR_BAG...", help="Sessions' folders, and bags; default: the newest session."),
    ] = None,
    ensemble: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write the fitted ensemble here, for rehearse and search.", callback=output_of("ensemble")
        ),
    ] = None,
    odds: options.SuccessCounts = None,
    counts_only: Annotated[
        bool,
        typer.Option("--counts-only", help="No ensemble: the shipped success counts and each gait's own trials. Takes no time."),
    ] = False,
    weight: Annotated[float, typer.Option(min=0.01, help="Trials of a gait that what was known before is worth.")] = 4.0,
    members: Annotated[int, typer.Option(min=2, help="Members drawn in each round.")] = 128,
    rounds: Annotated[int, typer.Option(min=0, help="Rounds after the first, at most.")] = 2,
    seed: Annotated[int, typer.Option(min=0, help="Same seed and trials, same ensemble.")] = 1,
    lapse: Annotated[float, typer.Option(help="Probability of a trial that comes out otherwise than it should.")] = 0.03,
    prior: Annotated[
        str, typer.Option(help="Half ranges, e.g. friction=0.6,slope_deg=5.", show_default="see docs/results/learning.md")
    ] = "",
    library: Annotated[str | None, typer.Option(help="Of bags whose library is not shipped.")] = None,
    demonstrate: Annotated[
        bool, typer.Option("--demonstrate", help="Instead: fit hidden virtual robots, and test what was learnt.")
    ] = False,
    robots: Annotated[int, typer.Option(min=1, help="Of a demonstration.")] = 3,
    primitives: Annotated[int, typer.Option(min=1, help="Of each class, of a demonstration.")] = 4,
    searched: Annotated[int, typer.Option(min=0, help="Of a demonstration: robots for which a library is searched.")] = 1,
    output: options.Output = None,
    page: options.Page = False,
    prototype: options.Prototype = None,
    as_json: options.Json = False,
) -> None:
    """Estimate friction, stiffness, rest lengths, strokes and slope from trials' outcomes.

    It writes an ensemble of robots, and how likely each gait is.

    Robots are drawn from a prior, roll every tried gait, and are weighted by the outcomes that they foretell.

    sixstrut fit
    sixstrut fit bags/monday --ensemble my_ensemble.yaml --odds my_odds.yaml
    sixstrut fit bags/monday bags/tuesday --counts-only --odds my_odds.yaml
    sixstrut fit --demonstrate
    """
    announce(
        "fitting hidden robots, some minutes" if demonstrate else "reading the trials; how long the fit takes is measured first"
    )
    from sim_core.dynamics.model import build_model
    from sim_core.structure.parameters import load_prototype
    from tensegrity_lab.session_data.folder import newest_session
    from tensegrity_lab.studies import fit as fitting
    from tensegrity_lab.studies.fit_trials import read_tries

    model = build_model(load_prototype(prototype))
    asked = fitting.FitOptions(members, rounds, seed, lapse, fitting.prior_of(prior), weight)
    if demonstrate:
        import_checkout()
        from tests.studies.learning import Setting
        from tests.studies.learning_page import demonstrated

        target = results_page("learning.md") if page else output_folder("fit", output) / "learning.md"
        setting = Setting(**vars(asked), robots=robots, primitives=primitives, searched=searched)
        typer.echo(demonstrated(model, setting, library or "improved", target))
        wrote(target)
        return
    if page or output is not None:
        raise typer.BadParameter("only a demonstration makes a page: give --demonstrate as well", param_hint="--page, --output")
    if counts_only and (ensemble is not None or odds is None):
        raise typer.BadParameter("it makes no ensemble: give --odds FILE, and not --ensemble", param_hint="--counts-only")
    tries = read_tries(options.given_or(newest_session, trials), model, library)
    found = None if counts_only else fitting.fitted(model, tries, asked, odds is not None)
    if ensemble is not None and found is not None:
        fitting.write_ensemble(in_folder(ensemble), model, tries, found)
        wrote(ensemble, err=as_json)
    if odds is not None:
        fitting.write_probabilities(in_folder(odds), model, tries, found, asked)
    document = fitting.document_of(tries, found)
    typer.echo(json.dumps(document) if as_json else fitting.text_of(tries, found))
    wrote(odds, err=as_json)
