from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from hardware_bridge.errors import TimeScaleError
from hardware_bridge.virtual_port import Handshake, agree_on_time_scale, default_link, handshake_path, read_handshake
from tests.hardware_bridge.helpers import Wire

SHAKE = Handshake(1, "x", "/dev/pts/1", 8.0, "o")


def test_a_living_prototype_is_known_by_its_handshake(start_prototype: Callable) -> None:
    running = start_prototype(time_scale=8.0)
    shake = read_handshake(str(running.link))
    assert shake is not None
    assert (shake.pid, shake.time_scale, shake.device) == (os.getpid(), 8.0, os.readlink(running.link))
    assert set(vars(shake)) == {"pid", "instance", "device", "time_scale", "observer", "board"}, "nothing of its parameters"


def test_a_dead_prototypes_files_prove_nothing(start_prototype: Callable, tmp_path: Path) -> None:
    running = start_prototype()
    text, device = handshake_path(running.link).read_text(), os.readlink(running.link)
    running.kill()
    handshake_path(running.link).write_text(text)
    running.link.symlink_to(device)
    assert read_handshake(str(running.link)) is None


def test_a_real_port_of_that_name_is_real(start_prototype: Callable, wire: Wire, tmp_path: Path) -> None:
    running = start_prototype()
    running.link.unlink()
    running.link.symlink_to(wire.port)
    assert read_handshake(str(running.link)) is None
    assert read_handshake(wire.port) is None
    assert read_handshake(str(tmp_path / "nothing")) is None


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"pid": "x"}'])
def test_a_broken_handshake_is_none(start_prototype: Callable, text: str) -> None:
    running = start_prototype()
    handshake_path(running.link).write_text(text)
    assert read_handshake(str(running.link)) is None


def test_the_time_scale_is_the_prototypes() -> None:
    assert agree_on_time_scale("p", None, SHAKE) == 8.0
    assert agree_on_time_scale("p", 8.0, SHAKE) == 8.0
    assert agree_on_time_scale("p", None, None) == 1.0
    with pytest.raises(TimeScaleError, match="the virtual prototype runs at 8"):
        agree_on_time_scale("p", 1.0, SHAKE)
    with pytest.raises(TimeScaleError, match="valid is 1 only"):
        agree_on_time_scale("p", 2.0, None)


def test_the_default_link_follows_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIXSTRUT_STATE_DIR", "/a")
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/b")
    assert default_link() == Path("/a/prototype")
    monkeypatch.delenv("SIXSTRUT_STATE_DIR")
    assert default_link() == Path("/b/sixstrut/prototype")
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert default_link().name == "prototype"
    assert default_link().parent.name == f"sixstrut-{os.getuid()}"
