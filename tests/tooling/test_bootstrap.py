# SPDX-License-Identifier: Apache-2.0
"""The parts of set-up that decide, on a checkout where nothing is installed."""

import contextlib
import os
import shutil
import subprocess
import sys
from io import StringIO
from pathlib import Path

import pytest

from tooling import bootstrap, packages, stamps, workspace
from tooling.layout import Layout, SetupError
from tooling.process import Runner
from tooling.progress import Progress

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def fresh(tmp_path: Path) -> Path:
    """A clone that was never set up, with what the bootstrap itself needs."""
    root = tmp_path / "clone"
    command_line = Path("ros_ws/src/sixstrut_cli/sixstrut_cli")
    shutil.copytree(ROOT / "tooling", root / "tooling")
    shutil.copytree(ROOT / command_line, root / command_line)
    shutil.copy(ROOT / "sixstrut", root)
    shutil.copytree(ROOT / "requirements", root / "requirements")
    return root


def launch(root: Path, *arguments: str, **environ: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [root / "sixstrut", *arguments],
        env={**os.environ, "SIXSTRUT_PYTHON": sys.executable, **environ},
        capture_output=True,
        text=True,
        timeout=60,
    )


def installed(root: Path) -> bool:
    return (root / ".venv").exists()


@pytest.mark.parametrize("arguments", [(), ("--help",), ("test", "--help"), ("setup", "-h")])
def test_help_needs_no_set_up(fresh: Path, arguments: tuple[str, ...]):
    result = launch(fresh, *arguments)
    assert result.returncode == 0
    assert result.stdout.startswith("Usage: ./sixstrut")
    assert not installed(fresh)


def test_help_lists_every_command_that_exists(fresh: Path):
    result = launch(fresh, "--help")
    for name in ("test", "setup", "env", "clean"):
        assert f"\n  {name} " in result.stdout


def test_a_command_that_does_not_exist_is_told_before_anything_is_installed(fresh: Path):
    result = launch(fresh, "rol")
    assert result.returncode == 2
    assert "no command 'rol'" in result.stderr
    assert "did you mean roll?" in result.stderr
    assert not installed(fresh)


@pytest.mark.parametrize(
    ("words", "told"), [(("setup", "clusters"), "setup takes nothing but groups of packages: base, console, cluster"),
                        (("env", "cluster"), "env takes no options"), (("clean", "--all"), "clean takes no options")]
)  # fmt: skip
def test_set_up_takes_names_of_groups_and_nothing_else(fresh: Path, words: tuple[str, ...], told: str):
    result = launch(fresh, *words)
    assert result.returncode == 2
    assert told in result.stderr
    assert not installed(fresh)


def test_set_up_installs_the_groups_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    asked: list[tuple[str, ...]] = []
    monkeypatch.setattr(bootstrap, "set_up", lambda layout, groups: asked.append(groups))
    assert bootstrap.main(["setup", "cluster", "docs"]) == 0
    assert bootstrap.main(["setup"]) == 0
    assert asked == [("cluster", "docs"), ()]


def test_a_machine_without_compilers_is_told_before_anything_is_installed(fresh: Path, tmp_path: Path):
    tools = tmp_path / "tools"
    tools.mkdir()
    for name in ("sh", "dirname", "readlink"):
        (tools / name).symlink_to(str(shutil.which(name)))
    result = launch(fresh, "setup", PATH=str(tools))
    assert result.returncode == 3
    assert "lacks a C compiler" in result.stderr
    assert not installed(fresh)


def test_clean_on_a_fresh_clone_does_nothing(fresh: Path):
    before = sorted(fresh.iterdir())
    assert launch(fresh, "clean").returncode == 0
    assert sorted(fresh.iterdir()) == before


def test_clean_removes_ours_and_leaves_what_is_not(fresh: Path):
    (fresh / ".venv").mkdir()
    (fresh / ".venv" / "sixstrut.stamp").touch()
    (fresh / "ros_ws" / "install" / "theirs").mkdir(parents=True)
    result = launch(fresh, "clean")
    assert not installed(fresh)
    assert (fresh / "ros_ws" / "install" / "theirs").exists()
    assert "left alone" in result.stderr


@pytest.fixture
def runner(tmp_path: Path):
    lock = os.open(tmp_path / "lock", os.O_RDWR | os.O_CREAT)
    yield Runner(tmp_path / "log", lock, Progress(1, StringIO()))
    os.close(lock)


def test_a_virtual_environment_of_the_users_own_is_not_touched(fresh: Path, runner: Runner):
    layout = Layout(fresh)
    (layout.venv / "mine").mkdir(parents=True)
    with pytest.raises(SetupError, match="was not made by"):
        packages.install(layout, ["base"], runner, os.environ)
    assert (layout.venv / "mine").exists()


def test_a_workspace_built_by_an_installed_ros_is_not_touched(fresh: Path, runner: Runner):
    layout = Layout(fresh)
    (layout.install / "theirs").mkdir(parents=True)
    with pytest.raises(SetupError, match="was built by another colcon"):
        workspace.build(layout, runner, os.environ)
    assert (layout.install / "theirs").exists()


def test_a_half_made_environment_is_not_ready(fresh: Path):
    layout = Layout(fresh)
    layout.venv.mkdir()
    (layout.venv / "sixstrut.stamp").touch()
    assert packages.made_by_us(layout)
    assert packages.missing(layout, ()) == ["base"]
    assert not workspace.ready(layout)


def test_groups_are_added_and_a_new_base_brings_all_that_were_there(fresh: Path):
    layout = Layout(fresh)
    assert packages.missing(layout, ("console",)) == ["base", "console"]
    layout.venv_python.parent.mkdir(parents=True)
    layout.venv_python.symlink_to(sys.executable)
    stamp = layout.venv / "sixstrut.stamp"
    stamp.write_text("".join(f"{group} {stamps.packages_stamp(layout, group)}\n" for group in ("base", "checks")))
    assert packages.missing(layout, ()) == []
    assert packages.missing(layout, ("checks",)) == []
    assert packages.missing(layout, ("checks", "console")) == ["console"]
    with layout.lock("checks").open("a") as lock:
        lock.write("more==1 --hash=sha256:00\n")
    assert packages.missing(layout, ()) == [], "it is not needed now"
    assert packages.missing(layout, ("checks",)) == ["checks"]
    with layout.lock("base").open("a") as lock:
        lock.write("more==1 --hash=sha256:00\n")
    assert packages.missing(layout, ("console",)) == ["base", "console", "checks"]


def test_cmake_and_uv_are_in_the_lock_but_not_in_the_environment(fresh: Path):
    names = {requirement.name for requirement in packages.needed(Layout(fresh), ["base"])}
    assert "colcon-core" in names
    assert not names & {*packages.BUILD_TOOLS, packages.INSTALLER}


@pytest.mark.parametrize(
    ("settings", "as_uv"),
    [
        ("", ([], {})),
        ("global.timeout='60'\nglobal.constraint='/etc/c.txt'\n", ([], {})),
        (":env:.find-links='/a /b'\n", (["--find-links", "/a", "--find-links", "/b"], {})),
        ("global.index-url='https://own.example/simple'\n", (["--default-index", "https://own.example/simple"], {})),
        ("global.cert='/etc/own.pem'\n", ([], {"SSL_CERT_FILE": "/etc/own.pem"})),
        ("global.proxy='http://proxy.example'\n", None),
    ],
)
def test_pips_settings_are_told_to_uv_and_where_it_does_not_know_them_pip_installs(settings: str, as_uv: object):
    assert packages._as_uv(settings) == as_uv


def test_the_tools_of_the_build_go_with_it(fresh: Path, runner: Runner, monkeypatch: pytest.MonkeyPatch):
    layout = Layout(fresh)
    asked: list[str] = []

    def installed_into(layout: Layout, requirements: list, runner: Runner, environ: object, *words: str) -> None:
        asked.extend(requirement.name for requirement in requirements)
        (Path(words[-1]) / "cmake" / "data" / "bin").mkdir(parents=True)

    monkeypatch.setattr(packages, "_pip", installed_into)
    with packages.build_tools(layout, runner, os.environ) as programs:
        assert programs.is_dir()
    assert asked == list(packages.BUILD_TOOLS)
    assert not (layout.state / "build_tools").exists()


def test_a_user_without_a_home_can_build(fresh: Path, runner: Runner, monkeypatch: pytest.MonkeyPatch):
    seen: dict[str, str] = {}  # colcon ends with a traceback where there is none
    monkeypatch.setattr(Runner, "run", lambda *_, environ, **__: seen.update(environ))
    monkeypatch.setattr(packages, "build_tools", lambda *_: contextlib.nullcontext(fresh))
    monkeypatch.setattr(workspace, "_sourced", lambda _: {})
    workspace.build(Layout(fresh), runner, {"PATH": os.defpath})
    assert seen["HOME"] == str(Layout(fresh).state)


@pytest.mark.parametrize(("uv_fails", "asked"), [(False, ["uv"]), (True, ["uv", "pip"])])
def test_uv_is_used_where_it_is_there_and_pip_where_uv_fails(
    fresh: Path, runner: Runner, tmp_path: Path, uv_fails: bool, asked: list
):
    told = tmp_path / "told"
    layout = Layout(fresh)
    for path, name, code in ((tmp_path / "uv", "uv", int(uv_fails)), (layout.venv_python, "pip", 0)):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'#!/bin/sh\necho {name} "$@" >> {told}\nexit {code}\n')
        path.chmod(0o755)
    with packages.build_tools(layout, runner, {"PATH": f"{tmp_path}:{os.environ['PATH']}"}):
        pass
    lines = told.read_text().splitlines()
    assert lines.pop(0) == "pip -m pip --disable-pip-version-check config list", "how it reaches packages"
    assert [line.split()[0] for line in lines] == asked
    assert all("--require-hashes --no-deps" in line for line in lines)
