# SPDX-License-Identifier: Apache-2.0
"""The solver is compiled before a command's own work, so that the wait has a name."""

import time

from sim_core.rolling.warm_up import Stage, is_warm, warm_up


def compile_first(*stages: Stage) -> None:
    """Compile what a command needs, once for these sources and this machine, telling on standard error how far it is."""
    if is_warm(stages):
        return
    from rich.console import Console

    console, began = Console(stderr=True, highlight=False), time.monotonic()
    title = f"compiling the solver, once ({', '.join(stages)})"
    if not console.is_terminal:
        console.print(title)
    with console.status(title) as status:
        done = warm_up(stages, lambda name, count: status.update(f"{title}: {name}, {count} functions done"))
    if done:
        console.print(f"compiled {len(done)} functions in {time.monotonic() - began:.0f} s")
