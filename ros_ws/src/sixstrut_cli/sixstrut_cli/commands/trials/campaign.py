# SPDX-License-Identifier: Apache-2.0
"""`sixstrut campaign`: whole libraries on virtual prototypes, and a sample of it through the whole stack."""

import os
import shlex
import time
from pathlib import Path
from typing import Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, import_checkout, require_folder, results_page, say, wrote


def command(
    output: Annotated[Path | None, typer.Argument(metavar="FOLDER", help="A new folder. Default: one in bags/.")] = None,
    libraries: Annotated[
        str, typer.Option(help="Names or YAML files; the first is set against each other one.")
    ] = "robust,improved,previous",
    primitives: Annotated[str, typer.Option(help='Which of each: "1-40", "1,3,7-9", all.')] = "all",
    gaits: Annotated[str, typer.Option(help="all (24), proper, improper, reference, or pairs.")] = "all",
    prototypes: Annotated[int, typer.Option(min=1, help="Virtual prototypes.")] = 4,
    seed: Annotated[int, typer.Option(min=0, help="Of the first prototype; draws orders and the sample, too.")] = 1,
    perturbation: options.Perturbation = 0.1,
    sample: Annotated[int, typer.Option(min=0, help="Trials to run through the whole stack as well.")] = 12,
    time_scale: options.TimeScale = 8.0,
    page: options.Page = False,
) -> None:
    """Run libraries × 24 gaits on virtual prototypes, fast; a sample of the trials through the whole stack; write a report.

    Sessions are folders like those of `sixstrut trial`, marked as computed by the batch solver; `sixstrut report` and
    `sixstrut fit` read them.

    sixstrut campaign
    sixstrut campaign /tmp/small --primitives 1,21 --gaits reference --prototypes 1 --sample 2
    """
    announce(f"libraries {libraries} on {prototypes} virtual prototype(s): some minutes; Ctrl-C keeps what is finished")
    from sim_core.rolling.warm_up import Stage
    from tensegrity_lab.terminal.compile_notice import compile_first
    from tensegrity_lab.terminal.progress import bars

    import_checkout()
    from tests.studies.campaign import CampaignRequest, run

    root = Path(os.environ.get("SIXSTRUT_ROOT", "."))
    folder = output or root / "bags" / f"campaign_{time.strftime('%Y%m%d_%H%M%S', time.gmtime())}"
    require_folder(folder)
    names = tuple(filter(None, (name.strip() for name in libraries.split(","))))
    words = ["./sixstrut", "campaign", "--libraries", libraries, "--primitives", primitives, "--gaits", gaits]
    words += ["--prototypes", str(prototypes), "--seed", str(seed), "--perturbation", f"{perturbation:g}", "--sample", str(sample)]
    words += ["--page"] if page else []
    target = results_page("campaign.md") if page else None
    chosen = primitives, gaits, prototypes, seed, perturbation, sample
    asked = CampaignRequest(folder, names, *chosen, time_scale, target, shlex.join(words))
    compile_first(Stage.BATCH, *([Stage.ROBOT] if sample else []))
    say(f"into {folder.resolve()}" + (f"; at the end {sample} trials through the whole stack" if sample else ""), err=True)
    try:
        with bars("rolls") as bar:
            done = run(asked, bar, lambda text: say(text, err=True))
    except KeyboardInterrupt:
        say(f"\ninterrupted: the sessions that are finished are kept in {folder.resolve()}, for report and fit", err=True)
        raise typer.Exit(130) from None
    for summary in done.summaries:
        typer.echo(summary)
    if done.pairs:
        typer.echo(f"through the whole stack: {sum(pair.agrees for pair in done.pairs)} of {len(done.pairs)} trials agree")
    wrote(*done.reports, folder / "campaign.md", target)
