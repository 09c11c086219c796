# SPDX-License-Identifier: Apache-2.0
"""A report as one self-contained HTML page: no script, no network, pictures inside."""

import base64
import re
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; max-width: 1080px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.6em; } h2 { font-size: 1.2em; margin-top: 2em; border-bottom: 1px solid #ccc; }
table { border-collapse: collapse; margin: .6em 0; }
th, td { padding: .2em .7em; text-align: left; border-bottom: 1px solid #e4e4e4; }
th { background: #f4f4f4; } td.n { text-align: right; font-variant-numeric: tabular-nums; }
img { max-width: 100%; } code { background: #f4f4f4; padding: 0 .25em; font-size: .9em; }
.virtual { background: #fff3cd; border: 1px solid #e0c060; padding: .6em 1em; } .note { color: #555; font-size: .93em; }
summary { cursor: pointer; font-weight: 600; }
"""


def page(title: str, parts: Iterable[str]) -> str:
    """The whole document."""
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{escape(title)}</title>'
    body = "\n".join(parts)
    start = f'<!doctype html>\n<html lang="en"><head>{head}<style>{STYLE}</style></head>\n<body>\n<h1>{escape(title)}</h1>'
    return f"{start}\n{body}\n</body></html>\n"


def heading(text: str) -> str:
    """A section's title."""
    return f"<h2>{escape(text)}</h2>"


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph. `kind`: "note" or "virtual"."""
    return f'<p class="{kind}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def picture(path: Path, what: str) -> str:
    """A PNG, inside the page, or a line that there is none. `what`: it shows, for those who cannot see it."""
    if not path.exists():
        return paragraph(f"(no picture: {what})", "note")
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<p><img alt="{escape(what)}" src="data:image/png;base64,{data}"></p>'


def table(head: Sequence[str], rows: Iterable[Sequence[object]], codes: Sequence[int] = ()) -> str:
    """A table; numbers go right. `codes`: columns that hold commands."""
    lines = ["<table><tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in head) + "</tr>"]
    for row in rows:
        cells = []
        for at, cell in enumerate(row):
            text = escape(str(cell))
            if at in codes and text:
                text = f"<code>{text}</code>"
            cells.append(f'<td class="n">{text}</td>' if _is_number(str(cell)) else f"<td>{text}</td>")
        lines.append("<tr>" + "".join(cells) + "</tr>")
    return "\n".join([*lines, "</table>"])


def folded(summary: str, content: str) -> str:
    """What is opened on a click."""
    return f"<details><summary>{escape(summary)}</summary>\n{content}\n</details>"


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[−-]?[0-9.]+(e[+-]?[0-9]+)?( %)?", text) is not None
