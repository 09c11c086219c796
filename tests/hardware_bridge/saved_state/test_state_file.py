# SPDX-License-Identifier: Apache-2.0
"""Files that outlive the bridge, in a folder where somebody meant harm."""

import os
from pathlib import Path

import pytest

from hardware_bridge.saved_state import state_file
from hardware_bridge.saved_state.state_file import UnreadableError, state_directory


def test_what_was_written_is_read_and_nothing_is_left_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "new" / "x.json"
    assert state_file.read(path) is None
    for number in range(5):
        state_file.write(path, {"number": number}, "it", durable=number == 4)
        assert state_file.read(path) == {"number": number}
    assert list(path.parent.iterdir()) == [path]
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        '{"a": NaN}',
        '{"a": -Infinity}',
        "[" * 100_000,
        '{"a": ' + "9" * 10_000 + "}",
        "\udcff",
        '"' + "x" * 2_000_000,
    ],
)
def test_what_is_no_record_is_unreadable(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text, errors="surrogateescape")
    with pytest.raises(UnreadableError, match=r"x\.json"):
        state_file.read(tmp_path / "x.json")


def test_a_link_is_never_followed(tmp_path: Path) -> None:
    victim, path = tmp_path / "victim", tmp_path / "x.json"
    victim.write_text('{"a": 1}')
    path.symlink_to(victim)
    path.with_suffix(f".{os.getpid()}.tmp").symlink_to(victim)
    with pytest.raises(UnreadableError, match="cannot be read"):
        state_file.read(path)
    state_file.write(path, {"b": 2}, "it")
    assert victim.read_text() == '{"a": 1}'
    assert not path.is_symlink()
    assert state_file.read(path) == {"b": 2}


def test_a_pipe_and_a_folder_are_unreadable_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name in ("pipe", "folder"):
        with pytest.raises(UnreadableError):
            state_file.read(tmp_path / name)


def test_another_users_file_is_no_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    state_file.write(tmp_path / "x.json", {"a": 1}, "it")
    other = os.geteuid() + 1
    if os.geteuid() == 0:
        os.chown(tmp_path / "x.json", other, -1)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: other)
    with pytest.raises(UnreadableError, match="is of another user"):
        state_file.read(tmp_path / "x.json")


def test_the_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SIXSTRUT_STATE_DIR", str(tmp_path))
    assert state_directory() == tmp_path
    monkeypatch.delenv("SIXSTRUT_STATE_DIR")
    monkeypatch.setenv("HOME", "/home/somebody")
    assert state_directory() == Path("/home/somebody/.local/state/sixstrut")
