# SPDX-License-Identifier: Apache-2.0
import platform
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from tooling import machine
from tooling.layout import SetupError


def folder_with(tmp_path: Path, *names: str) -> dict[str, str]:
    """An environment whose PATH holds just these programs."""
    for name in names:
        (tmp_path / name).write_text("#!/bin/sh\n")
        (tmp_path / name).chmod(0o755)
    return {"PATH": str(tmp_path)}


def test_a_machine_with_clang_and_make_will_do(tmp_path: Path):
    assert machine.compiler_problems(folder_with(tmp_path, "clang", "clang++", "make")) == []


def test_a_missing_compiler_is_named_with_the_package_to_install(tmp_path: Path):
    (problem,) = machine.compiler_problems(folder_with(tmp_path, "g++", "make"))
    assert "a C compiler" in problem
    assert "C++" not in problem
    assert "build-essential" in problem


def test_make_is_named_when_missing(tmp_path: Path):
    assert machine.compiler_problems(folder_with(tmp_path, "cc", "c++"))[0].startswith("lacks make:")


def test_a_compiler_named_by_the_user_counts_instead_of_the_usual_ones(tmp_path: Path):
    environ = folder_with(tmp_path, "gcc-13", "c++", "make")
    assert machine.compiler_problems({**environ, "CC": "gcc-13"}) == []
    assert machine.compiler_problems({**environ, "CC": "gcc-14"})


@pytest.mark.parametrize(("system", "processor"), [("Darwin", "arm64"), ("Linux", "aarch64"), ("Windows", "AMD64")])
def test_a_platform_without_wheels_is_named(monkeypatch: pytest.MonkeyPatch, system: str, processor: str):
    monkeypatch.setattr(platform, "system", lambda: system)
    monkeypatch.setattr(platform, "machine", lambda: processor)
    (problem,) = machine.platform_problems()
    assert f"this is {system} on {processor}" in problem


@pytest.mark.parametrize(("libc", "found"), [(None, "no glibc"), ("glibc 2.27", "found glibc 2.27")])
def test_a_c_library_too_old_or_of_another_kind_is_named(monkeypatch: pytest.MonkeyPatch, libc: str | None, found: str):
    monkeypatch.setattr(machine, "_libc", lambda: libc)
    (problem,) = machine.platform_problems()
    assert "needs glibc 2.28" in problem
    assert found.split()[-1] in problem


def test_a_path_that_the_build_tools_break_on_is_refused():
    assert machine.path_problems(Path("/home/me/my robot"))
    assert machine.path_problems(Path("/home/me/robot-2_x/ü")) == []


def checkout(folder: Path, links: bool = True, end: bytes = b"\n") -> Path:
    (folder / "sixstrut").write_bytes(b"#!/bin/sh" + end)
    sources = folder / "ros_ws" / "src"
    sources.mkdir(parents=True)
    for name in machine.LINKED:
        (folder / name).mkdir()
        if links:
            (sources / name).symlink_to(f"../../{name}")
        else:
            (sources / name).write_text(f"../../{name}")  # as git writes it with core.symlinks=false
    return folder


def test_all_problems_are_told_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=300_000_000))
    with pytest.raises(SetupError) as error:
        machine.check(checkout(tmp_path), {"PATH": str(tmp_path)}, needs_disk=True)
    assert [line.split()[0] for line in str(error.value).splitlines()] == ["the", "lacks", "0.3"]


def test_a_clone_without_links_is_told_how_to_get_them(tmp_path: Path):
    assert machine.checkout_problems(Path(__file__).parents[2]) == []
    (problem,) = machine.checkout_problems(checkout(tmp_path, links=False))
    assert "symbolic links sim_core and hardware_bridge" in problem
    assert "core.symlinks true" in problem


def test_a_checkout_with_other_line_ends_is_told(tmp_path: Path):
    (problem,) = machine.checkout_problems(checkout(tmp_path, end=b"\r\n"))
    assert "CR LF: clone it again" in problem


def test_a_file_system_without_links_or_programs_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    assert machine.file_system_problems(tmp_path) == []

    def refused(*_: object, **__: object) -> None:  # by vfat, and by a file system mounted noexec; to mount one needs root
        raise PermissionError(1, "Operation not permitted")

    for what, name in ((Path, "symlink_to"), (subprocess, "run")):
        with monkeypatch.context() as patch:
            patch.setattr(what, name, refused)
            (problem,) = machine.file_system_problems(tmp_path)
        assert "Operation not permitted" in problem
        assert "move the checkout to a local disk" in problem
    assert list(tmp_path.iterdir()) == []
