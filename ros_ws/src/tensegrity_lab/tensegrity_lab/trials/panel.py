# SPDX-License-Identifier: Apache-2.0
"""What a session shows: a panel to be read from two metres, or, where there is no terminal, lines."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any, Protocol

_GLYPHS = {
    "0": ("███", "█ █", "█ █", "█ █", "███"),
    "1": ("██ ", " █ ", " █ ", " █ ", "███"),
    "2": ("███", "  █", "███", "█  ", "███"),
    "3": ("███", "  █", "███", "  █", "███"),
    "4": ("█ █", "█ █", "███", "  █", "  █"),
    "5": ("███", "█  ", "███", "  █", "███"),
    "6": ("███", "█  ", "███", "█ █", "███"),
    "7": ("███", "  █", "  █", "  █", "  █"),
    "8": ("███", "█ █", "███", "█ █", "███"),
    "9": ("███", "█ █", "███", "  █", "███"),
    "T": ("███", " █ ", " █ ", " █ ", " █ "),
    "C": ("███", "█  ", "█  ", "█  ", "███"),
    "O": (" █ ", "█ █", "█ █", "█ █", " █ "),
    "?": ("██ ", "  █", " █ ", "   ", " █ "),
    "→": ("   █  ", "    █ ", "██████", "    █ ", "   █  "),
    " ": (" ", " ", " ", " ", " "),
}
"""Letters five lines high; O is round and 0 is not."""


def big(text: str) -> str:
    """A text of T, C, O, digits, ? and → in letters that are five lines high and twice as wide. Raises KeyError: another letter."""
    rows = ("  ".join(_GLYPHS[letter][row].replace("█", "██").replace(" ", "  ") for letter in text) for row in range(5))
    return "\n".join(rows)


@dataclass(frozen=True)
class Shown:
    """What is on the panel.

    Attributes:
        kind: "virtual trials" or "trials".
        phase: what is going on.
        source, target: the next gait.
        primitive: its name.
        stands: where the robot stands.
        done, total: trials.
        successes: of those done.
        left_s: wall time still to go.
        link, duty, battery, bag: health, in words.
        question: what is asked of the person.
        keys: what may be pressed, and what that does.
        last: the last outcome.
        trouble: what is wrong.
    """

    kind: str = ""
    phase: str = ""
    source: str = "?"
    target: str = "?"
    primitive: str = ""
    stands: str = ""
    done: int = 0
    total: int = 0
    successes: int = 0
    left_s: float = 0.0
    link: str = ""
    duty: str = ""
    battery: str = ""
    bag: str = ""
    question: str = ""
    keys: tuple[tuple[str, str], ...] = ()
    last: str = ""
    trouble: str = ""


UNDO, LEAVE = ("u", "undo the last"), ("q", "leave")
"""Keys that every question of a session knows."""


def keys_text(keys: Iterable[tuple[str, str]]) -> str:
    """For a terminal: "y yes   n no"."""
    return "   ".join(f"{key} {meaning}" for key, meaning in keys)


def duration_text(seconds: float) -> str:
    """For people: "5 h 34 min", "7 min", "40 s"."""
    minutes = round(seconds / 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60:02d} min"
    return f"{minutes} min" if seconds >= 90 else f"{seconds:.0f} s"


class Panel(Protocol):
    """Where a session shows what it does."""

    def __enter__(self) -> Panel: ...

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None: ...

    def show(self, **changes: Any) -> None:
        """Change what is on the panel, see `Shown`."""

    def line(self, text: str) -> None:
        """One line that stays."""


class Lines:
    """No terminal: lines only, a question as a line."""

    def __init__(self, kind: str):
        self.shown = Shown(kind)

    def __enter__(self) -> Lines:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        return None

    def show(self, **changes: Any) -> None:
        """See Panel."""
        before, self.shown = self.shown, replace(self.shown, **changes)
        if self.shown.question and self.shown.question != before.question:
            self.line(f"{self.shown.question}  [{keys_text(self.shown.keys)}]")

    def line(self, text: str) -> None:
        """See Panel."""
        print(text, flush=True)


class Live:
    """A terminal: the whole screen, live."""

    REFRESH_HZ = 5.0

    def __init__(self, kind: str):
        from rich.live import Live as RichLive

        self.shown = Shown(kind)
        self._lines: list[str] = []
        self._live = RichLive(get_renderable=self._picture, screen=True, refresh_per_second=self.REFRESH_HZ)

    def __enter__(self) -> Live:
        self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._live.stop()
        for text in self._lines:
            print(text)

    def show(self, **changes: Any) -> None:
        """See Panel."""
        self.shown = replace(self.shown, **changes)
        if changes.get("question"):
            self._live.refresh()

    def line(self, text: str) -> None:
        """See Panel: printed when the panel is gone."""
        self._lines.append(text)

    def _picture(self) -> Any:
        return picture(self.shown)


def picture(shown: Shown) -> Any:
    """The panel as rich draws it."""
    from rich.align import Align
    from rich.console import Group
    from rich.panel import Panel as Box
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    color = "red" if shown.trouble else "yellow" if shown.question else "green"
    rate = f"{100 * shown.successes / shown.done:.0f} % succeeded" if shown.done else "none yet"
    numbers = Table.grid(expand=True)
    for _ in range(3):
        numbers.add_column(justify="center")
    numbers.add_row(
        f"[bold]{shown.done} of {shown.total}[/] trials", f"[bold]{rate}[/]", f"[bold]{duration_text(shown.left_s)}[/] left"
    )
    health = Table.grid(expand=True)
    for _ in range(4):
        health.add_column(justify="center")
    health.add_row(*(Text(text) for text in (f"link {shown.link}", f"duty {shown.duty}", f"battery {shown.battery}", shown.bag)))
    parts: list[Any] = [
        Align.center(Text(big(f"{shown.source} → {shown.target}"), style=f"bold {color}")),
        Align.center(
            Text(f"\n{shown.primitive}   {shown.phase}   the robot stands on {shown.stands or 'no known face'}", style="bold")
        ),
        Text(""),
        Align.center(ProgressBar(total=max(1, shown.total), completed=shown.done)),
        Text(""),
        numbers,
        Text(""),
        health,
    ]
    if shown.last:
        parts.append(Align.center(Text(f"\nlast: {shown.last}")))
    if shown.trouble:
        parts.append(Align.center(Text(f"\n{shown.trouble}", style="bold red")))
    if shown.question:
        parts.append(Align.center(Text(f"\n{shown.question}", style="bold yellow")))
    parts.append(Align.center(Text(f"\n{keys_text(shown.keys)}", style="dim")))
    return Box(Group(*parts), title=shown.kind, border_style=color)
