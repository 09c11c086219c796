# SPDX-License-Identifier: Apache-2.0
"""Folders that cannot be written. Permissions do not bind root, so a file stands where a folder should be."""

import os
import socket
import tempfile
from pathlib import Path

import pytest

from sim_core.files import places
from sim_core.files.places import cache_folder, folder_problem, temporary_parent, writable_folder


@pytest.fixture(autouse=True)
def own_temporary_folder(tmp_path, monkeypatch):
    """And nothing is remembered of another test."""
    (tmp_path / "file").touch()
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(places, "temporary_parent", lambda: str(tmp_path / "temporary"))
    places._private.cache_clear()
    yield
    places._private.cache_clear()


def test_a_folder_that_can_be_written_is_looked_at_without_a_trace(tmp_path):
    assert folder_problem(tmp_path / "new" / "deep", locks=True) == ""
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "temporary"]


def test_why_a_folder_cannot_be_written_is_said(tmp_path, monkeypatch):
    assert (
        folder_problem(tmp_path / "file" / "deep") == f"{tmp_path}/file/deep cannot be written ({tmp_path}/file): Not a directory"
    )
    assert "GB free for" in folder_problem(tmp_path, 10**18)

    def none(*_):  # as a network file system without a lock daemon; to mount one needs root
        raise OSError(37, "No locks available")

    monkeypatch.setattr("fcntl.flock", none)
    assert folder_problem(tmp_path) == ""
    assert folder_problem(tmp_path, locks=True).endswith("No locks available")


def nobody(monkeypatch):
    """No HOME, and no user of this number."""
    monkeypatch.delenv("HOME")
    monkeypatch.setattr("pwd.getpwuid", lambda _: (_ for _ in ()).throw(KeyError("nobody")))


@pytest.mark.parametrize(("home", "told"), [(None, "HOME is not set"), ("here", "HOME is 'here'"), ("/file", "Not a directory")])
def test_without_a_home_a_private_temporary_folder_is_used_and_that_is_said_once(home, told, tmp_path, monkeypatch, capsys):
    if home is None:
        nobody(monkeypatch)
    else:
        monkeypatch.setenv("HOME", home.replace("/file", f"{tmp_path}/file"))
    private = tmp_path / "temporary" / f"sixstrut-{os.geteuid()}"
    assert writable_folder(".ros/log") == private / ".ros/log"
    assert writable_folder(".local/state/sixstrut", "", tmp_path / "file" / "x") == private / ".local/state/sixstrut"
    assert private.stat().st_mode & 0o777 == 0o700
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line
    assert str(private) in line


def test_a_temporary_folder_that_others_may_write_is_not_used(tmp_path, monkeypatch):
    nobody(monkeypatch)
    shared = tmp_path / "temporary" / f"sixstrut-{os.geteuid()}"
    shared.mkdir()
    shared.chmod(0o777)
    found = writable_folder("x").parent
    assert found != shared
    assert found.stat().st_mode & 0o777 == 0o700


def test_what_is_wanted_comes_before_home(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert writable_folder("x", None, "", tmp_path / "file" / "x", tmp_path / "own") == tmp_path / "own"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert cache_folder("kernels") == tmp_path / "cache" / "sixstrut" / "kernels"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert cache_folder("kernels") == tmp_path / ".cache" / "sixstrut" / "kernels"


def test_sockets_fit_below_a_deep_temporary_folder(tmp_path, monkeypatch):
    deep = tmp_path / ("d" * 100) / ("e" * 100)
    deep.mkdir(parents=True)
    monkeypatch.setattr(tempfile, "tempdir", str(deep))
    folder = tempfile.TemporaryDirectory(prefix="sixstrut-practice-", dir=temporary_parent())
    with folder as name, socket.socket(socket.AF_UNIX) as server:
        server.bind(f"{name}/prototype.observer")
    monkeypatch.setattr(tempfile, "tempdir", "/tmp")
    assert Path(temporary_parent()) == Path("/tmp")
