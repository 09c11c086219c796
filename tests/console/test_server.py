"""Who may see and ask: the token, other sites' pages, other names for this machine. Real sockets."""

import asyncio
import json
import threading
from contextlib import contextmanager

import pytest
import tornado.httpclient
import tornado.ioloop
import tornado.websocket

from sixstrut_cli.console.server import COOKIE, Server, new_token
from sixstrut_cli.errors import ConsoleError

TOKEN = "right-token"
LIMIT_S = 10.0


@contextmanager
def serving(token):
    """A server in a thread of its own; (port, what it was asked)."""
    asked, ready, place = [], threading.Event(), {}

    def order(document, answer):
        asked.append(document)
        answer({"answer": document})

    def run():
        asyncio.set_event_loop(asyncio.new_event_loop())
        place["server"] = Server("127.0.0.1", 0, token, 1, order)
        place["loop"] = tornado.ioloop.IOLoop.current()
        ready.set()
        place["loop"].start()
        place["server"].close()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert ready.wait(LIMIT_S)
    try:
        yield place["server"].port, asked
    finally:
        place["loop"].add_callback(place["loop"].stop)
        thread.join(LIMIT_S)


def fetch(port, path="/", **headers):
    """Status, headers, body; redirects are not followed."""

    async def get():
        client = tornado.httpclient.AsyncHTTPClient(force_instance=True)
        request = tornado.httpclient.HTTPRequest(
            f"http://127.0.0.1:{port}{path}", headers=headers, follow_redirects=False, request_timeout=LIMIT_S
        )
        return await client.fetch(request, raise_error=False)

    return asyncio.run(get())


def talk(port, path="/link", **headers):
    """Ask over the socket, and its answer; raises HTTPClientError if it is refused."""

    async def ask():
        request = tornado.httpclient.HTTPRequest(f"ws://127.0.0.1:{port}{path}", headers=headers, connect_timeout=LIMIT_S)
        socket = await tornado.websocket.websocket_connect(request)
        await socket.write_message(json.dumps({"do": "stop"}))
        answer = await asyncio.wait_for(socket.read_message(), LIMIT_S)
        socket.close()
        return json.loads(answer)

    return asyncio.run(ask())


def test_on_loopback_the_page_needs_no_token():
    with serving("") as (port, asked):
        assert b"sixstrut console" in fetch(port).body
        assert fetch(port, "/scene").code == 200
        assert talk(port) == {"answer": {"do": "stop"}}
        assert asked == [{"do": "stop"}]


def test_a_port_that_is_taken_is_named_with_what_to_do():
    with serving("") as (port, _), pytest.raises(ConsoleError, match=f"port {port} of 127.0.0.1: .*give another --port"):
        asyncio.run(_listen(port))


async def _listen(port):
    Server("127.0.0.1", port, "", 1, lambda order, answer: None)


def test_another_site_s_page_may_not_ask():
    with serving("") as (port, asked):
        with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
            talk(port, Origin="http://elsewhere.example")
        assert talk(port, Origin=f"http://127.0.0.1:{port}")
        assert len(asked) == 1


def test_without_a_token_the_machine_must_be_called_by_its_loopback_name():
    """A name that an attacker's server resolves to this machine (DNS rebinding) is none."""
    with serving("") as (port, asked):
        assert fetch(port, Host=f"rebound.example:{port}").code == 403
        with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
            talk(port, Host=f"rebound.example:{port}", Origin=f"http://rebound.example:{port}")
        assert fetch(port, Host=f"localhost:{port}").code == 200
        assert asked == []


def test_with_a_token_nothing_is_shown_or_taken_without_it():
    with serving(TOKEN) as (port, asked):
        for path in ("/", "/app.js", "/scene", "/?token=wrong"):
            assert fetch(port, path).code == 403
        for path in ("/link", "/scene/socket", "/link?token=wrong"):
            with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
                talk(port, path)
        assert asked == []


def test_the_right_token_is_kept_in_a_cookie_that_other_sites_do_not_send():
    with serving(TOKEN) as (port, asked):
        first = fetch(port, f"/?token={TOKEN}")
        assert first.code == 302
        assert first.headers["Location"] == "/"
        cookie = first.headers["Set-Cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        assert fetch(port, Cookie=f"{COOKIE}={TOKEN}").code == 200
        assert talk(port, Cookie=f"{COOKIE}={TOKEN}", Host=f"robot.example:{port}", Origin=f"http://robot.example:{port}")
        assert len(asked) == 1


def test_what_is_no_order_is_dropped():
    with serving("") as (port, asked):

        async def ask():
            socket = await tornado.websocket.websocket_connect(f"ws://127.0.0.1:{port}/link")
            for message in ("{", "[]", b"\xff\x00", '"stop"', '{"do": "reset"}'):
                await socket.write_message(message, binary=isinstance(message, bytes))
            return json.loads(await asyncio.wait_for(socket.read_message(), LIMIT_S))

        assert asyncio.run(ask()) == {"answer": {"do": "reset"}}
        assert asked == [{"do": "reset"}]


def test_a_token_is_long_and_never_the_same():
    assert len({new_token() for _ in range(100)}) == 100
    assert len(new_token()) >= 20
