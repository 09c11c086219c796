"""The console's page and sockets, on one port, and who may use them (tornado).

`/` is the page; `/link` a socket that tells facts and takes orders; `/scene` the 3D view's own page and socket, passed on to viser,
which itself listens on loopback only. Everything needs the token, if there is one. What another site's page sends is refused: by
its Origin, and, without a token, by its Host (DNS rebinding). viser's own port, on loopback, asks for nothing: who reaches it sees
the scene and can select a face or a place; nothing moves by that.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import re
import secrets
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import tornado.httpserver
import tornado.ioloop
import tornado.netutil
import tornado.web
import tornado.websocket

from sixstrut_cli.errors import ConsoleError

PAGE = Path(__file__).parent / "page"
COOKIE = "sixstrut_console"
LOOPBACK = ("127.0.0.1", "localhost", "::1")
MOST_BYTES = 50 * 1024 * 1024
"""Of one message of the 3D view, as viser has it."""

ONLY_THE_VIEW = b'<style>[data-testid="floating-panel"], .mantine-Notifications-root { display: none !important; }</style>'
"""Hides viser's own panel, which is for developers, and its remarks on the browser."""

Order = Callable[[dict[str, Any], Callable[[dict[str, Any]], None]], None]
"""Carries out what a page asks for; the second argument answers it, from any thread."""


def require_token(token: str) -> None:
    """Raises ConsoleError: it is short, or does not fit into an address."""
    if not re.fullmatch(r"[A-Za-z0-9_-]{8,}", token):
        raise ConsoleError("--token: valid are 8 or more letters, digits, - and _; leave it out to get a new one")


def new_token() -> str:
    """A token that nobody guesses."""
    return secrets.token_urlsafe(16)


class _Guarded(tornado.web.RequestHandler):
    """Only for who may."""

    def initialize(self, token: str, **more: Any) -> None:
        self.token = token
        for name, value in more.items():
            setattr(self, name, value)

    def prepare(self) -> None:
        if not self.allowed():
            raise tornado.web.HTTPError(403, reason="give the token that the console printed")

    def allowed(self) -> bool:
        """The token is right; or none is needed, and the request was meant for this machine."""
        if not self.token:
            host = (self.request.host or "").rsplit(":", 1)[0].strip("[]")
            return host in LOOPBACK
        given = self.get_query_argument("token", "") or self.get_cookie(COOKIE, "") or ""
        return hmac.compare_digest(given.encode(), self.token.encode())

    def set_default_headers(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("Content-Security-Policy", "frame-ancestors 'self'")  # no other site may put our buttons under its own

    def write_error(self, status_code: int, **_: Any) -> None:
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code}: {self._reason}\n")


class _File(_Guarded):
    """A file of the page; the first one keeps the token in a cookie that no other site's requests carry."""

    content: bytes
    kind: str

    def get(self) -> None:
        if self.token and self.get_query_argument("token", ""):
            self.set_cookie(COOKIE, self.token, httponly=True, samesite="Strict")
            self.redirect(self.request.path)
            return
        self.set_header("Content-Type", f"{self.kind}; charset=utf-8")
        self.finish(self.content)


class _Link(tornado.websocket.WebSocketHandler, _Guarded):
    """One page: orders in, facts out. Origin is checked by tornado: only this server's own page may connect."""

    server: Server

    def open(self, *_: str, **__: str) -> None:
        self.server.links.add(self)

    def on_close(self) -> None:
        self.server.links.discard(self)

    def on_message(self, message: str | bytes) -> None:
        try:
            order = json.loads(message)
        except json.JSONDecodeError:
            return
        if isinstance(order, dict):
            self.server.order(order, self.answer)

    def answer(self, document: dict[str, Any]) -> None:
        """From any thread."""
        self.server.later(lambda: self.send(json.dumps(document)))

    def send(self, text: str) -> None:
        """In the server's thread; a page that has gone is none."""
        _write(self, text)


class _SceneSocket(tornado.websocket.WebSocketHandler, _Guarded):
    """The 3D view's socket, passed on to viser byte by byte."""

    scene_port: int
    _viser: tornado.websocket.WebSocketClientConnection | None = None

    def select_subprotocol(self, subprotocols: list[str]) -> str | None:
        return subprotocols[0] if subprotocols else None

    async def open(self, *_: str, **__: str) -> None:
        wanted = [self.selected_subprotocol] if self.selected_subprotocol else None
        self._viser = await tornado.websocket.websocket_connect(
            f"ws://127.0.0.1:{self.scene_port}/", subprotocols=wanted, max_message_size=MOST_BYTES
        )
        # tornado hears nothing of the page before this method is over
        self._pump = asyncio.create_task(self._pass_on(self._viser))

    async def _pass_on(self, viser: tornado.websocket.WebSocketClientConnection) -> None:
        while (message := await viser.read_message()) is not None:
            _write(self, message)
        self.close()

    async def on_message(self, message: str | bytes) -> None:
        if self._viser is not None:
            await self._viser.write_message(message, binary=isinstance(message, bytes))

    def on_close(self) -> None:
        if self._viser is not None:
            self._viser.close()


def _write(to: tornado.websocket.WebSocketHandler, message: str | bytes) -> None:
    """Send it, if the other end is still there."""
    with suppress(tornado.websocket.WebSocketClosedError):
        written = to.write_message(message, binary=isinstance(message, bytes))
        written.add_done_callback(lambda future: future.exception())  # it went meanwhile: nobody is left to be told


class Server:
    """Made, and run, in one thread.

    Attributes:
        links: the pages that are connected. order: carries out what they ask for. url: where a person opens it.
    """

    def __init__(self, host: str, port: int, token: str, scene_port: int, order: Order):
        """Listen. Args: port: 0: any free one. Raises ConsoleError: the port is taken, or no such address is here."""
        import viser

        self.links: set[_Link] = set()
        self.order = order
        self._loop = tornado.ioloop.IOLoop.current()
        common = {"token": token}
        scene = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_bytes()
        files = [
            ("/", (PAGE / "index.html").read_bytes(), "text/html"),
            ("/app.js", (PAGE / "app.js").read_bytes(), "text/javascript"),
            ("/style.css", (PAGE / "style.css").read_bytes(), "text/css"),
            ("/scene", scene.replace(b"</head>", ONLY_THE_VIEW + b"</head>", 1), "text/html"),
        ]
        routes: list[Any] = [(path, _File, {**common, "content": content, "kind": kind}) for path, content, kind in files]
        routes += [
            ("/link", _Link, {**common, "server": self}),
            ("/scene/socket", _SceneSocket, {**common, "scene_port": scene_port}),
        ]
        application = tornado.web.Application(routes, websocket_max_message_size=MOST_BYTES, log_function=lambda handler: None)
        try:
            sockets = tornado.netutil.bind_sockets(port, host)
        except OSError as error:
            why = f"{error.strerror}; give another --port (0: any free one), or --host"
            raise ConsoleError(f"the console cannot listen on port {port} of {host}: {why}") from error
        self._http = tornado.httpserver.HTTPServer(application)
        self._http.add_sockets(sockets)
        self.port = int(sockets[0].getsockname()[1])
        name = socket.gethostname() if host in ("0.0.0.0", "::") else host
        shown = f"[{name}]" if ":" in name else name
        self.url = f"http://{shown}:{self.port}/" + (f"?token={token}" if token else "")

    def later(self, work: Callable[[], None]) -> None:
        """Do something in the server's thread, from any other."""
        self._loop.add_callback(work)

    def tell(self, document: dict[str, Any]) -> None:
        """Send it to every page. In the server's thread."""
        text = json.dumps(document)
        for link in list(self.links):
            link.send(text)

    def close(self) -> None:
        """Let go of the port and of every page."""
        self._http.stop()
        for link in list(self.links):
            link.close()
