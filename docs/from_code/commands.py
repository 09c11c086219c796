# SPDX-License-Identifier: Apache-2.0
"""The page of commands: each with its help, arguments and options, as typer has them."""

import re
from pathlib import Path

import typer
import typer.main

from docs.from_code import NOTE, table
from sixstrut_cli import app, registry

EXIT_CODES = (
    ("0", "done"),
    ("1", "an error; one line on standard error says what to do"),
    ("2", "wrong usage"),
    ("3", "the machine lacks something that set-up needs"),
    (
        "4",
        "done, but the answer is no: a roll that is not feasible, a travel that did not arrive, a replay that differs, a case of "
        "`validate` that does not hold, a failure that `faults` did not see survived, a page that is not what the code says "
        "(`docs --check`), something that the doctor would mend",
    ),
    ("130", "interrupted"),
)

ENVIRONMENT = (
    ("SIXSTRUT_BAGS", "folder of the bags of a bridge that is not told another one; else `bags` in the working directory"),
    (
        "SIXSTRUT_STATE_DIR",
        "folder of what is known of robots; else `~/.local/state/sixstrut`. The virtual prototype's link is there, too",
    ),
    ("SIXSTRUT_TOKEN", "the secret in the addresses of `console` and `foxglove`; else a new one at each start"),
    ("SIXSTRUT_DEBUG", "`1`: an error shows its traceback, as with `./sixstrut --debug COMMAND`"),
    ("SIXSTRUT_PYTHON", "the interpreter that set-up uses; else 3.12, 3.13 or 3.11, whichever runs"),
    ("NUMBA_CACHE_DIR", "folder of the compiled solver; else beside its sources"),
)
_EXAMPLE = re.compile(r"((?:\w+=\S+ )*)sixstrut ")


def page(_: Path) -> str:
    """The page, as Markdown."""
    entries = registry.entries()
    lines = ["# Commands", "", NOTE, "", "`./sixstrut COMMAND --help` shows the same.", ""]
    lines += table(("command", "does"), [(f"[`{entry.name}`](#{entry.name})", entry.help) for entry in entries])
    lines += ["", "## Exit codes", "", *table(("code", "means"), EXIT_CODES)]
    variables = [(f"`{name}`", text) for name, text in ENVIRONMENT]
    lines += ["", "## Environment variables", "", *table(("variable", "means"), variables)]
    for entry in entries:
        lines += ["", f"## {entry.name}", ""]
        lines += [entry.help] if entry.module is None else _command(entry.name)
    return "\n".join(lines) + "\n"


def _command(name: str) -> list[str]:
    group = typer.main.get_command(app.build([name]))
    command = group.commands[name]  # type: ignore[attr-defined]
    context = typer.Context(command, info_name=name)
    usage = " ".join(["./sixstrut", name, *command.collect_usage_pieces(context)])
    prose, examples = _parts((command.help or "").replace("\b\n", ""))
    lines = [*map(_plain, prose), "", "```text", usage, "```"]
    if examples:
        lines += ["", "For example:", "", "```text", *examples, "```"]
    records = [one.get_help_record(context) for one in command.params if one.name != "help" and not getattr(one, "hidden", False)]
    return [
        *lines,
        "",
        *table(("argument or option", "means"), [(f"`{names}`", _plain(told)) for names, told in filter(None, records)]),
    ]


def _parts(text: str) -> tuple[list[str], list[str]]:
    """What a command's help says, and its examples, which begin with the command line's name, or with variables before it."""
    lines = text.splitlines()
    examples = [_EXAMPLE.sub(r"\1./sixstrut ", line.strip()) for line in lines if _EXAMPLE.match(line.strip())]
    prose = [line for line in lines if not _EXAMPLE.match(line.strip())]
    while prose and not prose[-1].strip():
        prose.pop()
    return prose, examples


def _plain(text: str) -> str:
    """Help without what would be markup in Markdown."""
    return re.sub(r"([<>*_])", r"\\\1", " ".join(text.replace("<=", "≤").replace(">=", "≥").split()))
