# SPDX-License-Identifier: Apache-2.0
"""Progress of long computations: how much of it, how fast, how long still."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

from tensegrity_lab.terminal.leaving import leaves_at_once

Reporter = Callable[[str], Callable[[int, int], None]]
"""A title -> a function that is told (done, total)."""


@contextmanager
def bars(unit: str, kept: str = "") -> Iterator[Reporter]:
    """Bars on standard error, one for each title.

    Args:
        unit: what is counted, e.g. "rolls".
        kept: see `leaves_at_once`; empty: Ctrl-C is an exception, as ever.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.text import Text

    class Speed(ProgressColumn):
        """On average: a speed of late jumps where work is told in large pieces."""

        def render(self, task: Task) -> Text:
            speed = task.completed / task.elapsed if task.completed and task.elapsed else None
            return Text("" if speed is None else f"{speed:.0f} {unit}/s")

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
        Speed(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    leaving = leaves_at_once(kept) if kept else nullcontext()
    with leaving, Progress(*columns, console=Console(stderr=True), speed_estimate_period=120.0) as progress:

        def bar(title: str) -> Callable[[int, int], None]:
            task = progress.add_task(title, total=1)
            return lambda done, total: progress.update(task, completed=done, total=total)

        yield bar


def duration_text(seconds: float) -> str:
    """For people: "5 h 34 min", "7 min", "40 s"."""
    minutes = round(seconds / 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60:02d} min"
    return f"{minutes} min" if seconds >= 90 else f"{seconds:.0f} s"
