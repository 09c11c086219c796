# SPDX-License-Identifier: Apache-2.0
"""What is virtual is proven: the robot behind a port is a virtual prototype only if nobody could have made us believe so."""

import fcntl
import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from hardware_bridge.driver import bridge as bridge_module
from hardware_bridge.driver.bridge import Bridge
from hardware_bridge.errors import PortMissing, PrototypeError, TimeScaleError, WrongPrototype
from hardware_bridge.prototype_client.fault_client import inject
from hardware_bridge.prototype_client.handshake import (
    Handshake,
    agree_on_time_scale,
    default_link,
    examine,
    faults_path,
    lock_path,
    observer_path,
    read_handshake,
    require_prototype,
)
from hardware_bridge.prototype_client.observer_client import ObserverClient
from hardware_bridge.virtual_prototype.pty_port import PseudoPort
from tests.hardware_bridge.helpers import MID, Wire, wait_for
from tests.hardware_bridge.strangers import NOBODY, needs_root, shared_folder, stranger

SHAKE = Handshake(1, "x", "/dev/pts/1", 8.0, "o")


@pytest.fixture
def others_pty() -> Iterator[str]:
    """A pty of another process of ours: a real board, perhaps behind socat."""
    code = "import os, sys\nnear, far = os.openpty()\nprint(os.ttyname(far), flush=True)\nsys.stdin.read()"
    words = [sys.executable, "-I", "-S", "-c", code]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        yield child.stdout.readline().strip()
        child.stdin.close()


@contextmanager
def impostor(link: Path, device: str, **changes: object) -> Iterator[None]:
    """Everything that lies beside a prototype's link, and somebody who answers: but no prototype."""
    link.symlink_to(device)
    answer = {"instance": "abc", "device": device, "time_scale": 20.0, "board": "lsc"} | changes
    with ExitStack() as closing:
        lock = closing.enter_context(lock_path(link).open("w"))
        os.chmod(lock.fileno(), 0o600)
        fcntl.flock(lock, fcntl.LOCK_EX)
        server = closing.enter_context(socket.socket(socket.AF_UNIX))
        server.bind(str(faults_path(link)))
        os.chmod(faults_path(link), 0o600)
        server.listen()

        def serve() -> None:
            while True:
                try:
                    connection, _ = server.accept()
                except OSError:
                    return
                with connection, connection.makefile("rb") as lines:
                    question = json.loads(lines.readline() or b"{}")
                    if question:
                        connection.sendall(json.dumps({"who": question["who"]} | answer).encode() + b"\n")

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield
        finally:
            server.shutdown(socket.SHUT_RDWR)
            thread.join()


# ---- who is believed ------------------------------------------------------------------------------------------------------


def test_a_living_prototype_is_known_by_its_handshake(start_prototype: Callable) -> None:
    running = start_prototype(time_scale=8.0)
    shake = read_handshake(str(running.link))
    assert shake is not None
    assert (shake.pid, shake.time_scale, shake.device) == (os.getpid(), 8.0, os.readlink(running.link))
    assert set(vars(shake)) == {"pid", "instance", "device", "time_scale", "observer", "board"}, "nothing of its parameters"


def test_what_proves_a_prototype_is_for_this_user_alone(tmp_path: Path, start_prototype: Callable) -> None:
    before = os.umask(0)
    try:
        running = start_prototype(name="new/prototype")
    finally:
        os.umask(before)
    assert running.link.parent.stat().st_mode & 0o777 == 0o700
    for path in (lock_path, faults_path, observer_path):
        assert path(running.link).stat().st_mode & 0o077 == 0


def test_a_dead_prototypes_files_prove_nothing(start_prototype: Callable) -> None:
    running = start_prototype()
    device = os.readlink(running.link)
    running.kill()
    running.link.symlink_to(device)
    assert read_handshake(str(running.link)) is None


def test_a_real_port_of_that_name_is_real(start_prototype: Callable, wire: Wire, tmp_path: Path) -> None:
    running = start_prototype()
    running.link.unlink()
    running.link.symlink_to(wire.port)
    handshake, doubt = examine(str(running.link))
    assert handshake is None
    assert f"the link leads to {wire.port}, but" in doubt
    assert examine(wire.port) == (None, ""), "nothing there looks like a prototype"
    assert examine(str(tmp_path / "nothing")) == (None, "")


def test_a_link_to_a_board_with_nothing_beside_it_is_a_real_port_without_a_word(wire: Wire, tmp_path: Path) -> None:
    (tmp_path / "by-id").symlink_to(wire.port)
    assert examine(str(tmp_path / "by-id")) == (None, "")


def test_a_right_answer_for_a_pty_that_is_another_processs_is_not_believed(others_pty: str, tmp_path: Path) -> None:
    with impostor(tmp_path / "prototype", others_pty):
        handshake, doubt = examine(str(tmp_path / "prototype"))
    assert handshake is None
    assert doubt == f"{others_pty} is not the pty of the virtual prototype, process {os.getpid()}"


def test_the_near_end_of_another_pty_proves_nothing_about_this_one(others_pty: str, wire: Wire, tmp_path: Path) -> None:
    far = os.open(others_pty, os.O_RDWR | os.O_NOCTTY)  # the answering process has this far end, and the near end of wire's
    try:
        with impostor(tmp_path / "prototype", others_pty):
            assert read_handshake(str(tmp_path / "prototype")) is None
    finally:
        os.close(far)


@pytest.mark.parametrize(
    "changes",
    [{"who": "the nonce of yesterday"}, {"instance": ""}, {"time_scale": -1.0}, {"time_scale": "fast"}, {"time_scale": None}],
)
def test_a_wrong_answer_is_not_believed(wire: Wire, tmp_path: Path, changes: dict[str, object]) -> None:
    link = tmp_path / "prototype"
    with impostor(link, wire.port):
        assert read_handshake(str(link)) is not None, "it is the answer that makes the difference"
    for path in (link, faults_path(link)):
        path.unlink()
    with impostor(link, wire.port, **changes):
        handshake, doubt = examine(str(link))
    assert handshake is None
    assert doubt


def test_a_folder_or_lock_that_others_can_write_to_is_not_believed(start_prototype: Callable, tmp_path: Path) -> None:
    running = start_prototype()
    tmp_path.chmod(0o777)
    assert examine(str(running.link)) == (None, f"others can write to folder {tmp_path}: chmod go-w")
    tmp_path.chmod(0o700)
    lock_path(running.link).chmod(0o666)
    assert examine(str(running.link)) == (None, "others can write to prototype.lock: chmod go-w")
    lock_path(running.link).chmod(0o600)
    assert read_handshake(str(running.link)) is not None


def test_a_link_instead_of_folder_or_lock_is_not_followed(start_prototype: Callable, tmp_path: Path) -> None:
    running = start_prototype(name="real/prototype")
    (tmp_path / "alias").symlink_to(tmp_path / "real")
    handshake, doubt = examine(str(tmp_path / "alias" / "prototype"))
    assert handshake is None
    assert "is a link" in doubt
    lock_path(running.link).rename(tmp_path / "lock")
    lock_path(running.link).symlink_to(tmp_path / "lock")
    assert "is a link" in examine(str(running.link))[1]


# ---- what is made -----------------------------------------------------------------------------------------------------------


def test_a_prototype_writes_through_no_link(tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.write_text("years of work")
    lock_path(tmp_path / "prototype").symlink_to(precious)
    with pytest.raises(PrototypeError, match="is a link"):
        PseudoPort(tmp_path / "prototype")
    assert precious.read_text() == "years of work"
    lock_path(tmp_path / "prototype").unlink()
    (tmp_path / "alias").symlink_to(tmp_path)
    with pytest.raises(PrototypeError, match=r"is a link.*give --link in a folder of your own"):
        PseudoPort(tmp_path / "alias" / "prototype")


def test_a_prototype_does_not_live_where_others_can_write(tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    with pytest.raises(PrototypeError, match=r"others can write to folder .*: chmod go-w; give --link"):
        PseudoPort(tmp_path / "prototype")
    assert not list(tmp_path.iterdir())


def test_the_default_link_follows_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIXSTRUT_STATE_DIR", "/a")
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/b")
    assert default_link() == Path("/a/prototype")
    monkeypatch.delenv("SIXSTRUT_STATE_DIR")
    assert default_link() == Path("/b/sixstrut/prototype")
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert default_link().name == "prototype"
    assert default_link("/lab/blue") == default_link().with_name("prototype-lab-blue")
    assert default_link().parent.name == f"sixstrut-{os.getuid()}"


# ---- other users of the machine -----------------------------------------------------------------------------------------------


@needs_root
def test_a_folder_that_another_user_made_first_proves_nothing_and_is_not_used(
    wire: Wire, make_bridge: Callable[..., Bridge], caplog: pytest.LogCaptureFixture
) -> None:
    """Attack A7: a time scale of 20 and the prototype's calibration, for a robot at another pty."""
    claim = {"pid": 1, "instance": "a", "device": wire.port, "time_scale": 20.0, "observer": "o", "board": "lsc"}
    attack = """
folder, device, claim = sys.argv[1:]
os.mkdir(folder, 0o777)
os.symlink(device, folder + "/prototype")
lock = open(folder + "/prototype.lock", "w")
fcntl.flock(lock, fcntl.LOCK_EX)
open(folder + "/prototype.json", "w").write(claim)
server = socket.socket(socket.AF_UNIX)
server.bind(folder + "/prototype.faults")
server.listen()
"""
    with shared_folder() as shared:
        link = shared / "sixstrut-0" / "prototype"
        with stranger(attack, str(link.parent), wire.port, json.dumps(claim)):
            assert examine(str(link)) == (None, f"folder {link.parent} belongs to user {NOBODY}")
            with pytest.raises(PortMissing, match=f"belongs to user {NOBODY}; start one, or give the board's port"):
                require_prototype(link)
            with pytest.raises(TimeScaleError, match="valid is 1 only"):
                make_bridge(str(link), time_scale=20.0).open()
            bridge = make_bridge(str(link))
            bridge.open()
            assert (bridge.snapshot().virtual_port, bridge.snapshot().time_scale, bridge.observer) == (False, 1.0, None)
            assert f"belongs to user {NOBODY}" in caplog.text, "and somebody says why"
            with pytest.raises(PrototypeError, match=f"belongs to user {NOBODY}; give --link in a folder of your own"):
                PseudoPort(link)
            assert not wire.moves()


@needs_root
def test_a_link_of_another_user_proves_nothing(start_prototype: Callable, tmp_path: Path) -> None:
    running = start_prototype()
    device = os.readlink(running.link)
    running.link.unlink()
    running.link.symlink_to(device)
    os.chown(running.link, NOBODY, NOBODY, follow_symlinks=False)
    assert examine(str(running.link)) == (None, "prototype belongs to another user")


@needs_root
def test_a_socket_of_another_users_process_is_neither_watched_nor_told_anything(tmp_path: Path) -> None:
    attack = "server = socket.socket(socket.AF_UNIX)\nserver.bind(sys.argv[1])\nserver.listen()"
    with shared_folder() as shared:
        path = shared / "prototype.faults"
        with stranger(attack, str(path)):
            met: list[bool] = []
            client = ObserverClient(str(path), lambda seen: None, met.append)
            wait_for(lambda: client.refused, "the client's refusal")
            client.close()
            assert met == []
            with pytest.raises(PrototypeError, match=f"is user {NOBODY}'s"):
                inject(shared / "prototype", "clear")


# ---- the bridge -----------------------------------------------------------------------------------------------------------------


def test_the_bridge_tells_which_prototype_it_drives(
    start_prototype: Callable, wire: Wire, make_bridge: Callable[..., Bridge]
) -> None:
    running = start_prototype()
    virtual, real = make_bridge(str(running.link)), make_bridge(wire.port)
    for bridge in (virtual, real):
        bridge.open()
    shake = read_handshake(str(running.link))
    assert shake is not None
    assert virtual.snapshot().prototype == shake.instance
    assert real.snapshot().prototype == ""


def test_only_the_prototype_that_is_meant_is_armed(
    start_prototype: Callable, wire: Wire, make_bridge: Callable[..., Bridge]
) -> None:
    ours, other = start_prototype(), start_prototype(name="other")
    meant = read_handshake(str(ours.link))
    assert meant is not None
    for port, found in ((wire.port, "is at a real port"), (str(other.link), "drives virtual prototype")):
        bridge = make_bridge(port)
        bridge.open()
        with pytest.raises(WrongPrototype, match=f"virtual prototype {meant.instance} was to be armed, but this bridge {found}"):
            bridge.arm("a demo", True, MID, prototype=meant.instance)
        assert bridge.snapshot().mode.value == "DISARMED"
    assert not wire.moves()
    bridge = make_bridge(str(ours.link))
    bridge.open()
    assert bridge.arm("a demo", True, MID, prototype=meant.instance)


def test_a_link_that_changes_between_proof_and_opening_is_not_driven(
    start_prototype: Callable, others_pty: str, make_bridge: Callable[..., Bridge], monkeypatch: pytest.MonkeyPatch
) -> None:
    running = start_prototype()

    def proven_and_then_changed(port: str) -> object:
        found = examine(port)
        running.link.unlink()
        running.link.symlink_to(others_pty)
        return found

    monkeypatch.setattr(bridge_module, "examine", proven_and_then_changed)
    bridge = make_bridge(str(running.link))
    with pytest.raises(PortMissing, match="changed while it was opened"):
        bridge.open()
    assert not bridge.snapshot().link_ok
    assert not bridge.snapshot().virtual_port


def test_the_time_scale_is_the_prototypes() -> None:
    assert agree_on_time_scale("p", None, SHAKE) == 8.0
    assert agree_on_time_scale("p", 8.0, SHAKE) == 8.0
    assert agree_on_time_scale("p", None, None) == 1.0
    with pytest.raises(TimeScaleError, match="the virtual prototype runs at 8"):
        agree_on_time_scale("p", 1.0, SHAKE)
    with pytest.raises(TimeScaleError, match="valid is 1 only"):
        agree_on_time_scale("p", 2.0, None)
