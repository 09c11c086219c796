# SPDX-License-Identifier: Apache-2.0
"""The command line's frame: finds the command, runs it, and turns errors into one line and an exit code.

A command is a module in `sixstrut_cli/commands/` with a function `command`, annotated as typer wants it:

    def command(gait: Annotated[str, typer.Argument(help="…")], speed: Annotated[float, typer.Option()] = 1.0) -> None:
        \"\"\"What it does; shown by `./sixstrut NAME --help`.\"\"\"

It appears once the module exists and `registry.py` names it. `CONTEXT_SETTINGS` and `COMMAND_CLASS`, if present, go to typer.
Only the module of the command that was asked for is imported, so each may import what it likes at its top.

Exit codes: 0 done, 1 the command failed, 2 wrong usage, 3 set-up failed, 130 interrupted. A command ends itself with
another one by `raise typer.Exit(code)`. It raises its package's errors as they are: `sim_core.errors.SimError` and
`hardware_bridge.errors.BridgeError` become one line `error: …`; so does everything unexpected, with the way to its
traceback.
"""

import functools
import importlib
import inspect
import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Sequence
from typing import Annotated, Any

import typer

from sixstrut_cli import registry

EXIT_FAILED = 1
EXIT_INTERRUPTED = 130

# Base classes of errors that say all there is to say. By name: importing them here would import numpy at each start.
EXPECTED_ERRORS = frozenset({"sim_core.errors.SimError", "hardware_bridge.errors.BridgeError"})

NARROW = 80
"""Columns."""

_STEERING = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
"""What would steer a terminal."""
_NEGATIVE = re.compile(r"-\.?\d[\d.]*(,[-\d.]+)?")
"""A number or place below 0, which is no option: a blank in front says so, and every parser of numbers drops it."""
_SETTINGS = {"help_option_names": ["--help", "-h"]}


def main() -> None:
    """Entry point of `python -m sixstrut_cli` and of the executable `sixstrut`."""
    from sim_core.printable import replace_what_cannot_be_shown  # not before: the help needs no package but this one

    replace_what_cannot_be_shown()
    sys.exit(run(sys.argv[1:]))


def run(arguments: Sequence[str]) -> int:
    """Runs one command line; returns its exit code."""
    if narrow() and (not arguments or arguments[0] in _SETTINGS["help_option_names"]):
        print(registry.static_help(None))
        return 0
    words = [f" {word}" if _NEGATIVE.fullmatch(word) else word for word in arguments]
    try:
        return build(words)(args=words or ["--help"], prog_name="sixstrut", standalone_mode=False) or 0
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nothing left to flush at exit
        return EXIT_FAILED
    except Exception as error:
        usage = isinstance(error, typer.TyperException)
        if debugging(arguments) and not usage:
            raise
        text = _STEERING.sub("", _describe(error))  # a file's text may be in it
        print(f"error: {text}", file=sys.stderr)
        if "--json" in words:
            print(json.dumps({"error": text}))  # where a script reads
        return getattr(error, "exit_code", EXIT_FAILED)


def build(arguments: Sequence[str]) -> typer.Typer:
    """The application for this command line: the command asked for in full, the others as their help line."""
    app = typer.Typer(
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None if narrow() else "rich",
        context_settings=_SETTINGS,
    )
    app.callback()(_frame)
    asked = next((a for a in arguments if not a.startswith("-")), None)
    for entry in registry.entries():
        if entry.name == asked and entry.module is not None:
            module = importlib.import_module(f"sixstrut_cli.commands.{entry.module}")
            settings = {**_SETTINGS, **getattr(module, "CONTEXT_SETTINGS", {})}
            command_class = getattr(module, "COMMAND_CLASS", None)
            text = inspect.cleandoc(module.command.__doc__ or "")
            if narrow():  # plain help would join the examples; \b says that these lines stay as they are
                text = text.replace("\n\nsixstrut ", "\n\n\b\nsixstrut ")
            app.command(entry.name, help=text, context_settings=settings, cls=command_class)(_interruptible(module.command))
        else:
            app.command(entry.name, help=entry.help, rich_help_panel=entry.group)(_elsewhere(entry.name))
    return app


def _frame(
    debug: Annotated[bool, typer.Option("--debug", envvar="SIXSTRUT_DEBUG", help="Show the traceback of an error.")] = False,
) -> None:
    """A six-strut rolling tensegrity robot: its model, its gaits, its ROS 2 nodes."""


def _interruptible(command: Callable[..., None]) -> Callable[..., None]:
    """The command, which says so when it is interrupted."""

    @functools.wraps(command)
    def run(*words: Any, **options: Any) -> None:
        try:
            command(*words, **options)
        except KeyboardInterrupt:
            print("\ninterrupted", file=sys.stderr)
            raise typer.Exit(EXIT_INTERRUPTED) from None

    return run


def _elsewhere(name: str) -> Callable[[], None]:
    """Stands for a command in the help. Running it is never our part: set-up's own commands are done by ./sixstrut."""

    def stub() -> None:
        print(f"error: `{name}` is a command of the ./sixstrut script in the repository", file=sys.stderr)
        raise typer.Exit(EXIT_FAILED)

    return stub


def narrow() -> bool:
    """Whether frames would be rubble here: help is plain text then."""
    return shutil.get_terminal_size().columns < NARROW


def debugging(arguments: Sequence[str]) -> bool:
    """Whether tracebacks are wanted."""
    return "--debug" in arguments or os.environ.get("SIXSTRUT_DEBUG", "") not in ("", "0")


def _describe(error: Exception) -> str:
    if isinstance(error, typer.TyperException):
        return f"{error.format_message()} (sixstrut COMMAND --help tells what is valid)"
    if isinstance(error, typer.Abort):
        return "standard input ended, and there was a question left"
    ancestors = {f"{cls.__module__}.{cls.__qualname__}" for cls in type(error).__mro__}
    if ancestors & EXPECTED_ERRORS:
        return str(error)
    return f"{type(error).__name__}: {error} (traceback: SIXSTRUT_DEBUG=1)"
