# SPDX-License-Identifier: Apache-2.0
"""What a session shows: a panel to be read from two metres, or, where there is no terminal, lines."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Self

from tensegrity_lab.terminal.progress import duration_text

REFRESH_HZ = 5.0

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


class Panel:
    """Where a session shows what it does: the whole screen of a terminal; without one lines, a question as a line.

    Attributes:
        shown: what is on it.
    """

    def __init__(self, kind: str, terminal: bool = False, told: Callable[[Shown], None] = lambda shown: None):
        """Args: kind: see `Shown`. terminal: there is one. told: hears every change as well."""
        from rich.live import Live

        self.shown = Shown(kind)
        self._told = told
        self._lines: list[str] = []
        draw = lambda: picture(self.shown)  # noqa: E731
        self._live = Live(get_renderable=draw, screen=True, refresh_per_second=REFRESH_HZ) if terminal else None

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *details: object) -> None:
        if self._live is not None:
            self._live.stop()
        for text in self._lines:
            print(text)

    def show(self, **changes: Any) -> None:
        """Change what is on the panel, see `Shown`."""
        before, self.shown = self.shown, replace(self.shown, **changes)
        if self.shown.question and self.shown.question != before.question:
            if self._live is not None:
                self._live.refresh()
            else:
                self.line(f"{self.shown.question}  [{keys_text(self.shown.keys)}]")
        self._told(self.shown)

    def line(self, text: str) -> None:
        """One line that stays; below the screen once that is gone."""
        if self._live is not None:
            self._lines.append(text)
        else:
            print(text, flush=True)


def picture(shown: Shown) -> Any:
    """The panel as rich draws it."""
    from rich.align import Align
    from rich.console import Group
    from rich.panel import Panel as Box
    from rich.progress_bar import ProgressBar
    from rich.table import Column, Table
    from rich.text import Text

    color = "red" if shown.trouble else "yellow" if shown.question else "green"
    rate = f"{shown.successes} of {shown.done} succeeded" if shown.done else "none yet"

    def row(*cells: Text) -> Table:
        table = Table.grid(*(Column(justify="center") for _ in cells), expand=True)
        table.add_row(*cells)
        return table

    def line(text: str, style: str = "") -> Any:
        return Align.center(Text(f"\n{text}", style=style))

    counts = f"{shown.done} of {shown.total} trials", rate, f"{duration_text(shown.left_s)} left"
    health = f"link {shown.link}", f"duty {shown.duty}", f"battery {shown.battery}", shown.bag
    parts = [
        Align.center(Text(big(f"{shown.source} → {shown.target}"), style=f"bold {color}")),
        line(f"{shown.primitive}   {shown.phase}   the robot stands on {shown.stands or 'no known face'}\n", "bold"),
        Align.center(ProgressBar(total=max(1, shown.total), completed=shown.done)),
        Text(""),
        row(*(Text(text, style="bold") for text in counts)),
        Text(""),
        row(*map(Text, health)),
    ]
    told = (f"last: {shown.last}" if shown.last else "", ""), (shown.trouble, "bold red"), (shown.question, "bold yellow")
    parts += [line(text, style) for text, style in told if text]
    return Box(Group(*parts, line(keys_text(shown.keys), "dim")), title=shown.kind, border_style=color)
