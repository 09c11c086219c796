# SPDX-License-Identifier: Apache-2.0
"""Behind ./sixstrut: sets the checkout up if that is not done yet, then becomes the command that was asked for.

    ./sixstrut COMMAND …   set up if needed, then run the command
    ./sixstrut setup       only set up; with names of groups of packages, these too
    ./sixstrut env         set up if needed, then print the environment for a shell: eval "$(./sixstrut env)"
    ./sixstrut clean       remove what set-up made

Standard library only. Exit codes of its own: 2 wrong usage, 3 this machine or the network stands in the way of set-up,
130 interrupted.
"""

import os
import shutil
import signal
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from io import TextIOWrapper
from pathlib import Path
from types import FrameType
from typing import NoReturn

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "ros_ws" / "src" / "sixstrut_cli")]

from sixstrut_cli import registry  # noqa: E402
from tooling import environment, machine, packages, workspace  # noqa: E402
from tooling.exclusive import exclusive  # noqa: E402
from tooling.layout import Layout, SetupError  # noqa: E402
from tooling.process import Runner  # noqa: E402
from tooling.progress import Progress  # noqa: E402

EXIT_USAGE = 2
EXIT_SETUP = 3
EXIT_INTERRUPTED = 130


def main(arguments: Sequence[str]) -> int:
    """Run a command line; the exit status."""
    layout = Layout(ROOT)
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    try:
        return _dispatch(layout, arguments)
    except SetupError as error:
        print(f"sixstrut: {error}", file=sys.stderr)
        return EXIT_SETUP
    except KeyboardInterrupt:
        print("\nsixstrut: interrupted; the next run goes on from here", file=sys.stderr)
        return EXIT_INTERRUPTED


def _dispatch(layout: Layout, arguments: Sequence[str]) -> int:
    name = next((a for a in arguments if not a.startswith("-")), None)
    wants_help = name is None or any(a in ("--help", "-h") for a in arguments)
    if wants_help and (name in registry.SETUP_COMMANDS or not _ready(layout)):
        print(registry.static_help(name))
        return 0
    if name is not None and name not in registry.names():
        near = get_close_matches(name, registry.names(), 1)
        meant = f"did you mean {near[0]}? All: ./sixstrut --help" if near else f"there are: {', '.join(registry.names())}"
        print(f"sixstrut: no command {name!r}; {meant}", file=sys.stderr)
        return EXIT_USAGE
    more = [word for word in arguments if word != name] if name in registry.SETUP_COMMANDS else []
    if not set(more) <= set(packages.GROUPS if name == "setup" else ()):
        takes = f"nothing but groups of packages: {', '.join(packages.GROUPS)}" if name == "setup" else "no options"
        print(f"sixstrut: {name} takes {takes}", file=sys.stderr)
        return EXIT_USAGE
    if name == "clean":
        return _clean(layout)
    set_up(layout, (*registry.packages_of(name, arguments), *more))
    if name == "env":
        print(environment.exports(environment.overlay(os.environ, layout, workspace.paths(layout))))
        return 0
    if name == "setup":
        print(f"ready: {layout.venv} and {layout.install}")
        return 0
    return _become(layout, arguments)


def _ready(layout: Layout, groups: Sequence[str] = ()) -> bool:
    return not packages.missing(layout, groups) and workspace.ready(layout)


def set_up(layout: Layout, groups: Sequence[str] = ()) -> None:
    """Does what is not done yet. Each result bears a stamp, written last, of all that it depends on.

    Args:
        layout: of the checkout.
        groups: of packages, needed beside the base.
    """
    if _ready(layout, groups):
        return
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:  # leave `nohup` its way
            signal.signal(number, _exit_on_signal)
    with exclusive(layout.state / "lock") as lock:
        todo = packages.missing(layout, groups)
        todo_workspace = "base" in todo or not workspace.ready(layout)
        if not todo and not todo_workspace:
            return  # the one we waited for has done it
        machine.check(layout.root, os.environ, needs_disk="base" in todo)
        layout.log.write_text("", encoding="utf-8")
        steps = packages.STEPS if "base" in todo else len(todo[:1])
        progress = Progress(steps + workspace.STEPS * todo_workspace)
        runner = Runner(layout.log, lock, progress)
        if todo:
            packages.install(layout, todo, runner, os.environ)
        if todo_workspace:
            workspace.build(layout, runner, os.environ)
        layout.chosen_python.write_text(f"{sys.executable}\n", encoding="utf-8")


def _exit_on_signal(number: int, _frame: FrameType | None) -> None:
    """So that the running step is ended too, instead of left behind."""
    sys.exit(128 + number)


def _become(layout: Layout, arguments: Sequence[str]) -> NoReturn:
    """Replaces this process, so that signals and the exit code are the command's own."""
    environ = environment.applied(os.environ, environment.for_command(os.environ, layout, workspace.paths(layout)))
    python = str(layout.venv_python)
    # -P: the folder that the user happens to be in is no place to import from.
    os.execve(python, [python, "-P", "-m", "sixstrut_cli", *arguments], environ)


def _clean(layout: Layout) -> int:
    with exclusive(layout.state / "lock"):
        if workspace.made_by_us(layout):
            workspace.remove(layout)
        if packages.made_by_us(layout):
            packages.remove(layout)
        shutil.rmtree(layout.state)
    left = [path for path in (layout.venv, layout.install) if path.exists()]
    for path in left:
        print(f"sixstrut: left alone, as ./sixstrut did not make it: {path}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
