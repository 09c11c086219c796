# SPDX-License-Identifier: Apache-2.0
"""One holder a port, however its name is spelled, on real ptys and sockets."""

import hashlib
import os
import pty
import signal
import socket
import subprocess
import sys
import tempfile
import termios
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hardware_bridge.errors import PortBusy, PortMissing, PortWrongKind
from hardware_bridge.link.port_lock import lock_port
from hardware_bridge.link.transport import SerialTransport
from tests.hardware_bridge.helpers import Wire, wait_for


@pytest.fixture
def held(wire: Wire) -> Iterator[SerialTransport]:
    transport = SerialTransport(wire.port)
    transport.open()
    yield transport
    transport.close()


def test_a_device_is_one_port_whatever_path_leads_to_it(held: SerialTransport, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(held.port)
    (tmp_path / "link to the link").symlink_to("link")
    folder, name = os.path.split(held.port)
    spelled = [str(tmp_path / "link"), str(tmp_path / "link to the link"), f"{folder}/../pts/./{name}"]
    try:
        os.mknod(tmp_path / "node", 0o600 | 0o020000, os.stat(held.port).st_rdev)
        spelled.append(str(tmp_path / "node"))
    except PermissionError:
        pass  # only root makes nodes
    for port in spelled:
        with pytest.raises(PortBusy, match=f"is in use; stop the other program that holds it, process {os.getpid()}"):
            SerialTransport(port).open()


@pytest.mark.parametrize("scheme", ["spy", "SPY", "alt", "hwgrep", "loop", "rfc2217", "cp2110"])
def test_a_scheme_that_hides_a_device_is_refused_before_anything_is_opened(held: SerialTransport, scheme: str) -> None:
    with pytest.raises(PortWrongKind, match=f"{scheme}:// is not taken: it hides the device behind it; give a device"):
        SerialTransport(f"{scheme}://{held.port}").open()


@pytest.mark.parametrize(
    "url", ["socket://", "socket://:5", "socket://h", "socket://h:x", "socket://h:1/logging=debug", "socket://u@h:1"]
)
def test_a_socket_has_a_host_and_a_port_and_nothing_else(url: str) -> None:
    with pytest.raises(PortWrongKind):
        SerialTransport(url).open()


def test_a_prototypes_link_and_its_pty_are_one_port(start_prototype: Callable) -> None:
    running = start_prototype()
    by_link, by_device = SerialTransport(str(running.link)), SerialTransport(os.readlink(running.link))
    by_link.open()
    with pytest.raises(PortBusy):
        by_device.open()
    by_link.close()
    by_device.open()
    by_device.close()


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST", "127.0.0.1", "127.1", "0.0.0.0", "[::ffff:127.0.0.1]"])
def test_this_machines_addresses_are_one(host: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        number = server.getsockname()[1]
        first = SerialTransport(f"socket://127.0.0.1:{number}")
        first.open()
        with pytest.raises(PortBusy, match="is in use"):
            SerialTransport(f"socket://{host}:{number}").open()
        first.close()
        other = lock_port(f"socket://127.0.0.1:{number % 65535 + 1}")
        lock_port(f"socket://{host}:{number}").release()
        other.release()


def test_another_name_for_a_device_is_refused_where_it_cannot_be_followed() -> None:
    for port in ("/dev/ptmx", "/dev/tty"):
        with pytest.raises((PortWrongKind, PortMissing)):
            SerialTransport(port).open()
    with pytest.raises(PortWrongKind, match="stands for another device; give the device itself"):
        SerialTransport("/dev/ptmx").open()


def test_the_lock_is_the_machines_and_dies_with_its_process(wire: Wire) -> None:
    words = [sys.executable, "-c", "import sys; from hardware_bridge.link.port_lock import lock_port; lock_port(sys.argv[1]); "
             "held = lock_port(sys.argv[1]); print('held', flush=True); sys.stdin.read()"]  # fmt: skip
    words[2] = words[2].replace("lock_port(sys.argv[1]); held", "held")
    with subprocess.Popen([*words, wire.port], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        with pytest.raises(PortBusy, match=f"process {process.pid}"):
            lock_port(wire.port)
        process.send_signal(signal.SIGKILL)
    lock_port(wire.port).release()


def test_a_terminal_that_somebody_sits_at_is_no_robots_port() -> None:
    """A lost pty's name goes to the next window: its keys must not die because a bridge opens its port again."""
    process, terminal = pty.fork()
    if process == 0:
        os.execvp("sleep", ["sleep", "60"])
    try:
        wait_for(lambda: os.path.realpath(f"/proc/{process}/fd/0").startswith("/dev/pts/"), "the terminal")
        before = termios.tcgetattr(terminal)
        transport = SerialTransport(os.path.realpath(f"/proc/{process}/fd/0"))
        with pytest.raises(PortBusy, match=rf"is the terminal of process {process} \((sleep|python[0-9.]*)\)"):
            transport.open()
        assert termios.tcgetattr(terminal) == before
    finally:
        os.kill(process, signal.SIGKILL)
        os.close(terminal)
        os.waitpid(process, 0)


def test_nothing_is_opened_in_a_shared_folder(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
        victim, planted = tmp_path / "victim", Path(tempfile.gettempdir())
        victim.write_text("mine")
        planted /= f"sixstrut-port-{os.getuid()}-{hashlib.sha256(url.encode()).hexdigest()[:16]}.lock"
        planted.symlink_to(victim)
        try:
            transport = SerialTransport(url)
            transport.open()
            transport.close()
        finally:
            planted.unlink()
    assert victim.read_text() == "mine"
