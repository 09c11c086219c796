"""Text that came from outside, made fit to be shown: in a terminal, a log, a page or a table."""

from __future__ import annotations


def printable(text: str, most: int = 200) -> str:
    """One line without control characters, cut at ``most`` characters: no escape code reaches a terminal."""
    shown = " ".join("".join(character if character.isprintable() else " " for character in text[: 4 * most]).split())
    return shown if len(shown) <= most else shown[: most - 1] + "…"
