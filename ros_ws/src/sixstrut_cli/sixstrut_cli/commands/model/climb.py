# SPDX-License-Identifier: Apache-2.0
"""`sixstrut climb`: how steep each primitive of a library still rolls uphill."""

import json
from pathlib import Path
from statistics import median
from typing import Annotated

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, console, in_folder, output_of, say, wrote


def command(
    library: Annotated[str, typer.Argument(metavar="LIBRARY", help="A shipped library's name, or a YAML file.")] = "robust",
    actuators: Annotated[str, typer.Option(help="ideal, stand-in (they feel their load), or a YAML file.")] = "stand-in",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="YAML file to write as well.", callback=output_of("climb limits"))
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Print the steepest ground that each primitive climbs: the nominal robot, straight uphill, from rest to rest.

    Symmetry makes it the same for all 24 gaits of a primitive. The traveller prefers steep climbers where the ground leans.

    sixstrut climb
    sixstrut climb improved --actuators ideal
    sixstrut climb my_library.yaml --json
    """
    announce(f"library {library}: every primitive uphill, some seconds each; Ctrl-C leaves at any time")
    from sim_core.dynamics.actuators import require_actuators
    from sim_core.gaits.climb_limits import climbs_text
    from sim_core.gaits.library import load_library
    from sim_core.rolling.warm_up import Stage
    from tensegrity_lab.studies.climb import climbs_of
    from tensegrity_lab.terminal.compile_notice import compile_first
    from tensegrity_lab.terminal.leaving import leaves_at_once

    shelf, parameters = load_library(library), require_actuators(actuators)
    compile_first(Stage.ROBOT)
    with leaves_at_once("nothing was written"), console().status("climbing") as status:
        found = climbs_of(shelf, parameters, actuators, lambda name: status.update(f"climbing: {name} of {len(shelf.primitives)}"))
    if output is not None:
        in_folder(output).write_text(climbs_text(found), encoding="utf-8")
        wrote(output, err=True)
    if as_json:
        typer.echo(json.dumps({"library": shelf.name, "how": found.how, "steepest_deg": dict(found.steepest_deg)}))
        return
    say(f"library {shelf.name}: {found.how}; virtual")
    for primitive in shelf.primitives:
        deg = found.steepest_deg[primitive.name]
        source, target = primitive.roll_class
        say(f"  {primitive.name:<4} {source}→{target}  " + (f"{deg:5.2f}°" if deg else "does not roll on level ground"))
    for roll_class in dict.fromkeys(primitive.roll_class for primitive in shelf.primitives):
        climbed = [found.steepest_deg[one.name] for one in shelf.primitives if one.roll_class == roll_class]
        still = sum(deg == 0.0 for deg in climbed)
        words = f"{len(climbed)} primitives, {still} of them do not roll on level ground"
        say(f"{roll_class.name}: {words}; median {median(climbed):.2f}°, best {max(climbed):.2f}°")
