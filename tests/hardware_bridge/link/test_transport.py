# SPDX-License-Identifier: Apache-2.0
import os
import socket
import threading
import time
from pathlib import Path

import pytest

from hardware_bridge.errors import LinkLost, PortBusy, PortMissing, PortWrongKind, TransportError
from hardware_bridge.link.transport import SerialTransport
from tests.hardware_bridge.helpers import Wire, read_exactly


def test_bytes_go_both_ways(wire: Wire) -> None:
    transport = SerialTransport(wire.port)
    transport.open()
    transport.write_all(b"\x00\x0a\x0d\x11\x13\xff")
    assert os.read(wire._near, 100) == b"\x00\x0a\x0d\x11\x13\xff"
    os.write(wire._near, b"abcdef")
    assert read_exactly(transport, 4) == b"abcd"
    assert transport.read_available() == b"ef"
    assert transport.read_available() == b""
    transport.close()


def test_a_missing_port_names_port_and_remedy(tmp_path: Path) -> None:
    port = str(tmp_path / "rfcomm9")
    with pytest.raises(PortMissing, match="does not exist; start the virtual prototype, or power the robot") as caught:
        SerialTransport(port).open()
    assert caught.value.port == port


def test_a_link_to_nothing_is_a_missing_port(tmp_path: Path) -> None:
    (tmp_path / "prototype").symlink_to("/dev/pts/9999")
    with pytest.raises(PortMissing):
        SerialTransport(str(tmp_path / "prototype")).open()


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_a_port_that_is_none_says_so(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "thing"
    path.touch() if kind == "file" else path.mkdir()
    with pytest.raises(PortWrongKind, match="no serial port"):
        SerialTransport(str(path)).open()


def test_a_url_of_no_known_kind_is_refused() -> None:
    with pytest.raises(TransportError, match="nonsense://x"):
        SerialTransport("nonsense://x").open()


def test_a_port_opens_once_only(wire: Wire) -> None:
    first, second = SerialTransport(wire.port), SerialTransport(wire.port)
    first.open()
    with pytest.raises(PortBusy, match="in use; stop the other program"):
        second.open()
    first.close()
    second.open()
    second.close()


def test_a_socket_url_works_and_opens_once_only() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
        transport, other = SerialTransport(url), SerialTransport(url)
        transport.open()
        peer, _ = server.accept()
        with peer:
            with pytest.raises(PortBusy):
                other.open()
            transport.write_all(b"hello")
            assert peer.recv(10) == b"hello"
            peer.sendall(b"back")
            assert read_exactly(transport, 4) == b"back"
        transport.close()


def test_a_socket_that_nobody_serves_is_a_missing_port() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
    with pytest.raises(PortMissing):
        SerialTransport(url).open()


def test_a_port_that_does_not_open_in_time_is_given_up_and_closed_later(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    class Late:
        closed = threading.Event()

        def close(self) -> None:
            self.closed.set()

    release, late = threading.Event(), Late()
    with monkeypatch.context() as slow:
        slow.setattr("serial.serial_for_url", lambda *_, **__: release.wait() and late)
        transport = SerialTransport(wire.port, open_timeout_s=0.05)
        for _ in range(2):
            with pytest.raises(PortMissing, match=r"did not open in 0\.05 s"):
                transport.open()
        release.set()
        assert late.closed.wait(10.0)
    transport.open_timeout_s = 10.0
    transport.open()
    transport.close()


def test_a_full_port_is_an_error_within_its_limit_and_says_if_a_part_went_out(wire: Wire) -> None:
    transport = SerialTransport(wire.port, write_timeout_s=0.04)
    transport.open()
    errors: list[LinkLost] = []
    for size in (1_000_000, 25):
        start = time.monotonic()
        with pytest.raises(LinkLost) as caught:
            transport.write_all(bytes(size))
        assert time.monotonic() - start < 2.0
        errors.append(caught.value)
    assert errors[0].dirty
    assert "supply off and on" in str(errors[0])
    assert not errors[1].dirty
    transport.close()


def test_a_dead_peer_is_noticed_by_every_call(wire: Wire) -> None:
    transport = SerialTransport(wire.port)
    transport.open()
    wire.cut()
    with pytest.raises(LinkLost):
        transport.read_available()
    with pytest.raises(LinkLost):
        transport.write_all(b"x")
    transport.close()
    transport.close()
    with pytest.raises(LinkLost, match="not open"):
        transport.write_all(b"x")
