# SPDX-License-Identifier: Apache-2.0
"""The frame around the commands: what an error, a wrong usage or Ctrl-C comes to."""

import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Annotated

import pytest
import typer

from sixstrut_cli import app, outputs, registry


def use(monkeypatch: pytest.MonkeyPatch, command) -> None:
    """Puts `command` in the place of the command `test`."""
    module = ModuleType("sixstrut_cli.commands.develop.test")
    module.command = command  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "sixstrut_cli.commands.develop.test", module)


def raising(error: BaseException):
    def command() -> None:
        raise error

    return command


def class_of_other_package(module: str, name: str) -> type[Exception]:
    base = type(name, (Exception,), {"__module__": module})
    return type("Special", (base,), {})


@pytest.mark.parametrize(("module", "name"), [("sim_core.errors", "SimError"), ("hardware_bridge.errors", "BridgeError")])
def test_a_packages_own_error_is_one_line(monkeypatch, capsys, module: str, name: str):
    use(monkeypatch, raising(class_of_other_package(module, name)("strut S1: too long")))
    assert app.run(["test"]) == 1
    assert capsys.readouterr().err == "error: strut S1: too long\n"


def test_an_unexpected_error_names_its_type_and_the_way_to_the_traceback(monkeypatch, capsys):
    use(monkeypatch, raising(KeyError("x")))
    assert app.run(["test"]) == 1
    assert capsys.readouterr().err == "error: KeyError: 'x' (traceback: SIXSTRUT_DEBUG=1)\n"


def test_debug_lets_the_error_through(monkeypatch):
    use(monkeypatch, raising(KeyError("x")))
    with pytest.raises(KeyError):
        app.run(["--debug", "test"])
    monkeypatch.setenv("SIXSTRUT_DEBUG", "1")
    with pytest.raises(KeyError):
        app.run(["test"])


@pytest.mark.parametrize("arguments", [["test", "--no-such-option"], ["no-such-command"], ["--no-such-option"]])
def test_wrong_usage_exits_2(monkeypatch, arguments: list[str]):
    use(monkeypatch, raising(AssertionError("was run")))
    assert app.run(arguments) == 2


def test_ctrl_c_exits_130_and_is_said(monkeypatch, capsys):
    use(monkeypatch, raising(KeyboardInterrupt()))
    assert app.run(["test"]) == 130
    assert capsys.readouterr().err == "\ninterrupted\n"


@pytest.mark.parametrize("code", [0, 1, 4])
def test_a_command_chooses_its_exit_code(monkeypatch, code: int):
    use(monkeypatch, raising(typer.Exit(code)))
    assert app.run(["test"]) == code


def test_no_command_shows_the_help(capsys):
    assert app.run([]) == 0
    output = capsys.readouterr().out
    for name in registry.names():
        assert name in output


def test_a_command_whose_module_is_missing_is_told_loudly(monkeypatch, tmp_path):
    monkeypatch.setattr(registry, "_COMMANDS", tmp_path)
    with pytest.raises(FileNotFoundError, match=r"modules are missing in .*: robot\.demo, robot\.console"):
        registry.names()


def test_starting_up_imports_neither_ros_nor_the_numerics():
    code = (
        "import sys; from sixstrut_cli import app; app.run(['--help']); "
        "print([m for m in ('rclpy', 'numba', 'numpy', 'scipy', 'sim_core', 'hardware_bridge') if m in sys.modules])"
    )
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert output.splitlines()[-1] == "[]"


def test_the_help_groups_the_commands(capsys):
    app.run([])
    said = capsys.readouterr().out
    places = [said.index(group) for group in registry.GROUPS]
    assert places == sorted(places)
    assert registry.GROUPS[0] == registry.entries()[0].group
    static = registry.static_help(None)
    for entry in registry.entries():
        assert entry.group in registry.GROUPS
        assert f"  {entry.name} " in static


def test_a_number_below_zero_is_no_option(monkeypatch):
    seen = []

    def command(places: list[str], turn: float = 0.0) -> None:
        seen.append(([word.strip() for word in places], turn))

    use(monkeypatch, command)
    assert app.run(["test", "-0.3,0.2", "-1", "--turn", "-5"]) == 0
    assert seen == [(["-0.3,0.2", "-1"], -5.0)]
    assert app.run(["test", "-0.3,x"]) == 2


def test_with_json_an_error_is_json_too(monkeypatch, capsys):
    def command(as_json: Annotated[bool, typer.Option("--json")] = False) -> None:
        raise KeyError("x")

    use(monkeypatch, command)
    assert app.run(["test", "--json"]) == 1
    said = capsys.readouterr()
    assert json.loads(said.out)["error"].startswith("KeyError: 'x'")
    assert said.err.startswith("error: ")


def test_with_json_wrong_usage_is_json_too(monkeypatch, capsys):
    def command(count: Annotated[int, typer.Option(min=1)] = 1, as_json: Annotated[bool, typer.Option("--json")] = False) -> None:
        pass

    use(monkeypatch, command)
    assert app.run(["test", "--json", "--count", "0"]) == 2
    said = capsys.readouterr()
    assert "'--count'" in json.loads(said.out)["error"]
    assert said.err.startswith("error: ")
    assert said.err.count("\n") == 1


def test_a_question_that_nobody_can_answer_is_told(monkeypatch, capsys):
    use(monkeypatch, raising(EOFError()))
    assert app.run(["test"]) == 1
    assert "standard input ended" in capsys.readouterr().err


def test_below_80_columns_help_is_plain_and_no_line_is_too_long(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "60")
    assert app.run(["roll", "--help"]) == 0
    assert app.run([]) == 0
    said = capsys.readouterr().out
    assert "│" not in said
    assert "\n  sixstrut roll --from TC6 --to TO5\n" in said
    broken = [line for line in said.splitlines() if not line.startswith("  sixstrut ")]  # an example is to be copied whole
    assert max(map(len, broken)) <= 60


def test_lines_for_people_break_between_words_at_a_terminal_only(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "30")
    line = "three words and /a/path/that/is/longer/than/the/terminal and more"
    outputs.say(line)
    assert capsys.readouterr().out == line + "\n"
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    outputs.say("  first\n" + line)
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "  first"
    assert "    /a/path/that/is/longer/than/the/terminal" in said
    assert " ".join(" ".join(said[1:]).split()) == line


def test_what_was_written_is_told_with_its_whole_path(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    outputs.wrote(Path("out/a.png"), None, Path("b.yaml"))
    assert capsys.readouterr().out == f"wrote {tmp_path}/out/a.png\nwrote {tmp_path}/b.yaml\n"
