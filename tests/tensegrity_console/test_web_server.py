# SPDX-License-Identifier: Apache-2.0
"""Who may see and ask: the secret, other sites' pages, other names of the machine, guesses, deaf pages. Real sockets."""

import asyncio
import json
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
import tornado.httpclient
import tornado.ioloop
import tornado.websocket

from tensegrity_console import access
from tensegrity_console.web.state import Page
from tensegrity_console.web.web_server import Server
from tensegrity_lab.errors import ConsoleError

TOKEN = "the-right-token-0"
LIMIT_S = 10.0


class Orders:
    """Answers an order with itself, and keeps it."""

    def __init__(self):
        self.pages, self.asked = {}, []

    def arrived(self):
        page = Page()
        self.pages[page.number] = page
        return page

    def left(self, page):
        self.pages.pop(page.number, None)

    def carry_out(self, page, order, answer):
        self.asked.append(order)
        answer({"answer": order})


@contextmanager
def serving(host="127.0.0.1"):
    """A server in a thread of its own; (port, who was asked)."""
    orders, ready, place = Orders(), threading.Event(), {}

    def run():
        asyncio.set_event_loop(asyncio.new_event_loop())
        place["server"] = Server(host, 0, TOKEN, Path("/nowhere"), orders, lambda page, click: None)
        place["loop"] = tornado.ioloop.IOLoop.current()
        ready.set()
        place["loop"].start()
        place["server"].close()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert ready.wait(LIMIT_S)
    orders.server = place["server"]
    try:
        yield place["server"].port, orders
    finally:
        place["loop"].add_callback(place["loop"].stop)
        thread.join(LIMIT_S)


def fetch(port, path="/", **headers):
    """Status, headers, body; redirects are not followed."""

    async def get():
        client = tornado.httpclient.AsyncHTTPClient(force_instance=True)
        request = tornado.httpclient.HTTPRequest(
            f"http://127.0.0.1:{port}{path}", headers=headers, follow_redirects=False, request_timeout=60.0
        )
        return await client.fetch(request, raise_error=False)

    return asyncio.run(get())


def talk(port, path=f"/{TOKEN}/link", **headers):
    """Ask over the socket, and its answer; raises HTTPClientError if it is refused."""

    async def ask():
        request = tornado.httpclient.HTTPRequest(f"ws://127.0.0.1:{port}{path}", headers=headers, connect_timeout=LIMIT_S)
        line = await tornado.websocket.websocket_connect(request)
        await line.write_message(json.dumps({"do": "stop"}))
        while "answer" not in (told := json.loads(await asyncio.wait_for(line.read_message(), LIMIT_S))):
            pass
        line.close()
        return told

    return asyncio.run(ask())


@pytest.fixture
def quick(monkeypatch):
    """Refusals are told soon, for tests that look at other things."""
    monkeypatch.setattr(access, "LONGEST_DELAY_S", 0.01)


def test_who_has_the_address_sees_and_asks():
    with serving() as (port, orders):
        assert orders.server.url == f"http://127.0.0.1:{port}/{TOKEN}/"
        assert b"sixstrut console" in fetch(port, f"/{TOKEN}/").body
        assert fetch(port, f"/{TOKEN}").headers["Location"] == f"/{TOKEN}/"
        assert fetch(port, f"/{TOKEN}/scene").code == 200
        assert talk(port) == {"answer": {"do": "stop"}}
        assert orders.asked == [{"do": "stop"}]


def test_without_the_secret_nothing_is_shown_or_taken(quick):
    with serving() as (port, orders):
        for path in ("/", "/app.js", "/scene", "/wrong/", "/wrong/app.js", f"/?token={TOKEN}", f"/{TOKEN}x/", f"//{TOKEN}/"):
            reply = fetch(port, path)
            assert (reply.code, reply.body) == (403, b"403: open the address that was printed\n"), path
        for path in ("/link", "/wrong/link", "/scene/socket", f"/link?token={TOKEN}"):
            with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
                talk(port, path)
        assert orders.asked == []


def test_the_secret_is_kept_in_no_cookie_and_nothing_may_be_embedded_or_read_elsewhere():
    """A cookie would be sent to every port of the host: to whatever another user serves there."""
    with serving() as (port, _):
        for path in (f"/{TOKEN}/", f"/{TOKEN}/app.js", f"/{TOKEN}/scene"):
            headers = fetch(port, path).headers
            assert "Set-Cookie" not in headers
            assert not [name for name in headers if name.startswith("Access-Control")]
            assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
            assert headers["Referrer-Policy"] == "no-referrer"
        assert "frame-ancestors 'none'" in fetch(port, f"/{TOKEN}/").headers["Content-Security-Policy"]
        assert "frame-ancestors 'self'" in fetch(port, f"/{TOKEN}/scene").headers["Content-Security-Policy"]


def test_a_port_that_is_taken_is_named_with_what_to_do():
    with serving() as (port, _), pytest.raises(ConsoleError, match=f"port {port} of 127.0.0.1: .*give another --port"):
        asyncio.run(_listen(port))


async def _listen(port):
    Server("127.0.0.1", port, TOKEN, Path("/nowhere"), Orders(), lambda page, click: None)


@pytest.mark.parametrize("origin", ["http://elsewhere.example", "http://127.0.0.1:1", "null", "file://"])
def test_another_site_s_page_may_not_ask_even_if_it_knew_the_secret(quick, origin):
    with serving() as (port, orders):
        with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
            talk(port, Origin=origin)
        assert fetch(port, f"/{TOKEN}/", Origin=origin).code == 403
        assert orders.asked == []
        assert talk(port, Origin=f"http://127.0.0.1:{port}")


def test_on_loopback_the_machine_must_be_called_by_its_loopback_name(quick):
    """A name that an attacker's server resolves to this machine (DNS rebinding) is none."""
    with serving() as (port, orders):
        assert fetch(port, f"/{TOKEN}/", Host=f"rebound.example:{port}").code == 403
        with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
            talk(port, Host=f"rebound.example:{port}", Origin=f"http://rebound.example:{port}")
        assert fetch(port, f"/{TOKEN}/", Host=f"localhost:{port}").code == 200
        assert fetch(port, f"/{TOKEN}/", Host=f"[::1]:{port}").code == 200
        assert orders.asked == []


def test_from_elsewhere_it_is_called_by_its_own_names():
    with serving("0.0.0.0") as (port, _):
        assert talk(port, Host=f"robot.example:{port}", Origin=f"http://robot.example:{port}")


def test_a_wrong_secret_is_told_late_and_meanwhile_the_right_one_at_once(monkeypatch):
    """Held for an hour: whatever comes back meanwhile did not wait for it."""
    monkeypatch.setattr(access, "FIRST_DELAY_S", 3600.0)
    monkeypatch.setattr(access, "LONGEST_DELAY_S", 3600.0)
    with serving() as (port, _), socket.create_connection(("127.0.0.1", port)) as guess:
        guess.sendall(f"GET /wrong/ HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
        for _ in range(3):
            assert fetch(port, f"/{TOKEN}/").code == 200
            assert talk(port) == {"answer": {"do": "stop"}}
        guess.setblocking(False)
        with pytest.raises(BlockingIOError):
            guess.recv(1)


def test_refusals_take_longer_each_time_and_few_wait(monkeypatch):
    waited = []

    async def sleep(seconds):
        waited.append(seconds)

    monkeypatch.setattr(access.asyncio, "sleep", sleep)
    gate = access.Gate(TOKEN, True)
    assert all(asyncio.run(gate.hold("127.0.0.1")) for _ in range(8))
    assert waited == [0.25, 0.5, 1.0, 2.0, 4.0, 5.0, 5.0, 5.0]
    assert asyncio.run(gate.hold("192.0.2.1"))
    assert waited[-1] == 0.25, "who guesses elsewhere delays nobody else"
    gate._held = access.MOST_HELD
    assert not asyncio.run(gate.hold("127.0.0.1")), "beyond that they are cut off"


def test_what_is_no_order_is_dropped():
    with serving() as (port, orders):

        async def ask():
            line = await tornado.websocket.websocket_connect(f"ws://127.0.0.1:{port}/{TOKEN}/link")
            for message in ("{", "[]", b"\xff\x00", '"stop"', "[" * 4000, '{"do": "reset"}'):
                await line.write_message(message, binary=isinstance(message, bytes))
            while "answer" not in (told := json.loads(await asyncio.wait_for(line.read_message(), LIMIT_S))):
                pass
            return told

        assert asyncio.run(ask()) == {"answer": {"do": "reset"}}
        assert orders.asked == [{"do": "reset"}]


def test_too_many_orders_are_left_out_but_never_a_stop():
    with serving() as (port, orders):

        async def ask():
            line = await tornado.websocket.websocket_connect(f"ws://127.0.0.1:{port}/{TOKEN}/link")
            for _ in range(300):
                await line.write_message('{"do": "reset"}')
            await line.write_message('{"do": "stop"}')
            while json.loads(await asyncio.wait_for(line.read_message(), LIMIT_S)) != {"answer": {"do": "stop"}}:
                pass

        asyncio.run(ask())
        assert len(orders.asked) < 200
        assert orders.asked[-1] == {"do": "stop"}


@pytest.mark.slow
@pytest.mark.parametrize("pings_s", [1.0, 30.0])
def test_a_page_that_does_not_read_is_let_go(monkeypatch, pings_s):
    """Because it answers no ping; and, long before that, because too much waits for it."""
    monkeypatch.setattr(access, "PING_S", pings_s)
    monkeypatch.setattr(access, "MOST_UNSENT", 500_000)
    with serving() as (port, orders), socket.socket() as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.connect(("127.0.0.1", port))
        key = "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
        head = f"GET /{TOKEN}/link HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n{key}\r\n"
        deaf.sendall(head.encode())
        until = time.monotonic() + 60.0
        while not orders.pages:
            assert time.monotonic() < until
            time.sleep(0.005)
        (link,) = orders.server.links.values()
        most = 0
        while orders.pages:
            assert time.monotonic() < until, "it was kept"
            orders.server.later(lambda: orders.server.tell(lambda page: {"facts": "x" * (100 if pings_s < 10.0 else 200_000)}))
            most = max(most, link.unsent)
            time.sleep(0.02)
        assert most < 1_000_000


def test_a_new_token_is_long_and_never_the_same(monkeypatch):
    monkeypatch.delenv(access.TOKEN_VARIABLE, raising=False)
    tokens = {access.chosen_token(None) for _ in range(100)}
    assert len(tokens) == 100
    assert min(map(len, tokens)) >= 32


def test_a_token_of_one_s_own_comes_by_the_environment_or_a_private_file(tmp_path, monkeypatch):
    monkeypatch.setenv(access.TOKEN_VARIABLE, TOKEN)
    assert access.chosen_token(None) == TOKEN
    assert access.TOKEN_VARIABLE not in access.os.environ, "what is started later is not told"
    file = tmp_path / "token"
    file.write_text(TOKEN + "\n")
    file.chmod(0o600)
    assert access.chosen_token(file) == TOKEN


@pytest.mark.parametrize(
    ("text", "mode", "words"),
    [
        ("tiny-one", 0o600, "valid are 16 to 128 letters"),
        ("sixteen letters!", 0o600, "valid are 16 to 128 letters"),
        (TOKEN, 0o644, "chmod 600"),
        (TOKEN, 0o620, "chmod 600"),
    ],
)
def test_a_token_that_is_weak_or_that_others_can_read_is_refused_and_not_repeated(tmp_path, text, mode, words):
    file = tmp_path / "token"
    file.write_text(text)
    file.chmod(mode)
    with pytest.raises(ConsoleError, match=words) as refused:
        access.chosen_token(file)
    assert text not in str(refused.value)


def test_a_token_file_is_a_file_and_no_link(tmp_path):
    (tmp_path / "real").write_text(TOKEN)
    (tmp_path / "real").chmod(0o600)
    (tmp_path / "link").symlink_to(tmp_path / "real")
    for path, words in ((tmp_path / "link", "give a file"), (tmp_path / "none", "give a file"), (tmp_path, "no regular file")):
        with pytest.raises(ConsoleError, match=words):
            access.chosen_token(path)


@pytest.mark.parametrize("command", ["console", "foxglove"])
def test_a_token_on_the_command_line_is_refused_before_anything_starts(command):
    words = [sys.executable, "-m", "sixstrut_cli", command, "--token", "a-secret-in-the-list-of-processes"]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=60.0)
    assert ended.returncode != 0
    (line,) = ended.stderr.strip().splitlines()
    assert "SIXSTRUT_TOKEN" in line
    assert "--token-file" in line
    assert "a-secret-in" not in line
