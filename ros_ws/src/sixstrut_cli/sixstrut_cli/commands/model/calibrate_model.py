# SPDX-License-Identifier: Apache-2.0
"""`sixstrut calibrate-model`: make the model's first frequency the robot's."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from sixstrut_cli import options
from sixstrut_cli.outputs import announce, in_folder, output_of, say, wrote


def command(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Prototype YAML to write.", callback=output_of("prototype"))
    ] = Path("prototype.yaml"),
    frequency: Annotated[
        float | None, typer.Option(help="First natural frequency at rest on TC6, in Hz; default: first_frequency_hz.")
    ] = None,
    measured: Annotated[
        list[str] | None, typer.Option("--measured", metavar="NAME=VALUE", help="A quantity you measured; may be given often.")
    ] = None,
    keep_ropes: Annotated[bool, typer.Option(help="Only put in what was measured; leave the ropes as they are.")] = False,
    prototype: options.Prototype = None,
) -> None:
    """Scale the stiffness of all ropes until the lowest natural frequency is the measured one; write a prototype YAML.

    The robot rests on TC6, feet sticking. The ropes' stretch stays, so prestress scales alike. A simulated free vibration
    checks the result.

    sixstrut calibrate-model -o my_prototype.yaml
    sixstrut calibrate-model --frequency 4.8 --measured joint_mass_kg=0.0091 -o my_prototype.yaml
    sixstrut calibrate-model --measured tendon_stiffness_n_m=395 --keep-ropes -o my_prototype.yaml
    """
    announce("scaling the ropes until the first frequency fits, some seconds; Ctrl-C leaves at any time")
    from sim_core.dynamics.model import build_model
    from sim_core.dynamics.vibration_modes import calibrated, first_frequency_hz, vibrated_frequency_hz
    from sim_core.files.yaml_reader import sealed
    from sim_core.rolling.warm_up import Stage
    from sim_core.structure.parameters import FILE, load_prototype, rewritten, with_value
    from tensegrity_lab.terminal.compile_notice import compile_first

    text = (prototype or FILE.path).read_text(encoding="utf-8") if prototype is None or prototype.exists() else ""
    robot = load_prototype(prototype)
    changes: dict[str, tuple[Any, str, str]] = {}
    for name, value in map(_quantity, measured or []):
        changes[name] = (value, "measured", "given to calibrate-model")
        rewritten(text, {name: changes[name]})  # refuses unknown names and impossible values before anything is computed
        robot = with_value(robot, name, value)
    wanted = frequency if frequency is not None else robot.first_frequency_hz
    if frequency is not None:
        changes["first_frequency_hz"] = (frequency, "measured", "given to calibrate-model; fixes the mass damping")
        robot = replace(robot, first_frequency_hz=frequency)
    before = build_model(robot)
    compile_first(Stage.ROBOT)
    say(f"before: {robot.tendon_stiffness_n_m:.2f} N/m per rope, first frequency {first_frequency_hz(before):.4f} Hz")
    if not keep_ropes:
        robot = calibrated(robot, wanted)
        why = f"calibrated: first frequency {wanted:g} Hz at rest on TC6, feet sticking"
        for name in ("tendon_stiffness_n_m", "box_rope_stiffness_n_m"):
            value = float(f"{getattr(robot, name):.6g}")
            robot = with_value(robot, name, value)
            changes[name] = (value, "calibrated", why)
    after = build_model(robot)
    say(f"after:  {robot.tendon_stiffness_n_m:.2f} N/m per rope, first frequency {first_frequency_hz(after):.4f} Hz")
    say(f"        spectrum of a simulated free vibration: {vibrated_frequency_hz(after):.4f} Hz")
    in_folder(output).write_text(sealed(rewritten(text, changes)), encoding="utf-8")
    load_prototype(output)
    wrote(output)
    say(f"model {after.hash}")


def _quantity(text: str) -> tuple[str, float]:
    name, equals, value = text.partition("=")
    try:
        if equals:
            return name.strip(), float(value)
    except ValueError:
        pass
    raise typer.BadParameter(f"{text!r}: valid is NAME=NUMBER, such as joint_mass_kg=0.0091; `sixstrut parameters` lists the names")
