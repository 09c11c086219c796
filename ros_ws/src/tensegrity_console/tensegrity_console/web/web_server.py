# SPDX-License-Identifier: Apache-2.0
"""The console's page and sockets, on one port (tornado); who may use them is decided in `access`.

Under the token: the page; `link`, a socket that tells facts and takes orders; `scene`, the 3D view's own page, and its socket,
between which and viser stands `view_messages`. viser has no port.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tornado.ioloop
import tornado.web
import websockets.asyncio.client
import websockets.exceptions
from websockets.typing import Subprotocol

from hardware_bridge.recording.bag_quota import RateLimit
from tensegrity_console.access import LOOPBACK, Gate, Guarded, GuardedSocket, address, listening
from tensegrity_console.web.state import Page, json_of
from tensegrity_console.web.view_messages import LONGEST, Camera, Click, for_viser, said

if TYPE_CHECKING:
    from tensegrity_console.web.main import Orders

PAGE = Path(__file__).parent / "page"
MOST_SCENE_BYTES = 50 * 1024 * 1024
"""Of one message of viser's, as viser has it."""
LONGEST_ORDER = 4096
ORDERS_AT_ONCE, ORDERS_PER_S = 40, 20
"""Of one page; a stop is always taken."""
CAMERAS_PER_S, CLICKS_PER_S = 120, 10
OWN = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src data:; connect-src 'self'; frame-src 'self'"
OWN_PAGE = f"{OWN}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
VIEW_PAGE = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""Neither may load, or tell, anything elsewhere; the view stands in our page's frame, and our page in nobody's."""
ONLY_THE_VIEW = (
    b'<style>[data-testid="floating-panel"], .mantine-Paper-root, .mantine-Notifications-root { display: none !important; }</style>'
)
"""Hides viser's own panel, which is for developers, in a wide window and a narrow one, and its remarks on the browser."""


class _File(Guarded):
    """A file of the page."""

    content: bytes
    kind: str
    policy: str

    def initialize(self, content: bytes, kind: str, policy: str) -> None:
        self.content, self.kind, self.policy = content, kind, policy

    def get(self, **_: str) -> None:
        if self.kind == "text/html" and not self.request.path.endswith(("/", "/scene")):
            self.redirect(f"{self.request.path}/")  # what the page names is beside it
            return
        self.set_header("Content-Type", f"{self.kind}; charset=utf-8")
        self.set_header("Content-Security-Policy", self.policy)
        self.finish(self.content)


class _Link(GuardedSocket):
    """One page: orders in, facts out."""

    page: Page
    scene: _SceneSocket | None = None

    def initialize(self, server: Server) -> None:
        self.server = server
        self._pace = RateLimit(ORDERS_AT_ONCE, ORDERS_PER_S)

    @property
    def max_message_size(self) -> int:
        return LONGEST_ORDER

    def open(self, *_: str, **__: str) -> None:
        self.set_nodelay(True)
        self.page = self.server.orders.arrived()
        self.server.links[self.page.number] = self
        self.send(json_of({"page": self.page.number}))

    def on_close(self) -> None:
        if hasattr(self, "page"):
            self.server.links.pop(self.page.number, None)
            self.server.orders.left(self.page)
        if self.scene is not None:
            self.scene.close()

    def on_message(self, message: str | bytes) -> None:
        try:
            order = json.loads(message)
        except (ValueError, RecursionError):
            return
        if isinstance(order, dict) and (order.get("do") == "stop" or self._pace.allows()):
            self.server.orders.carry_out(self.page, order, self.answer)

    def answer(self, document: dict[str, Any]) -> None:
        """From any thread."""
        self.server.later(lambda: self.send(json_of(document)))


class _SceneSocket(GuardedSocket):
    """The 3D view of an open page: what viser draws goes out, cameras go in, clicks come to us."""

    def initialize(self, server: Server) -> None:
        self.server = server
        self._cameras, self._clicks = RateLimit(CAMERAS_PER_S, CAMERAS_PER_S), RateLimit(CLICKS_PER_S, CLICKS_PER_S)
        self._viser: websockets.asyncio.client.ClientConnection | None = None
        self._link: _Link | None = None

    @property
    def max_message_size(self) -> int:
        return LONGEST

    def select_subprotocol(self, subprotocols: list[str]) -> str | None:
        return subprotocols[0] if subprotocols else None

    async def open(self, *_: str, number: str = "", **__: str) -> None:
        self._link = link = self.server.links.get(number)
        if link is None:
            self.close(1008, "no such page is open")
            return
        if link.scene is not None:
            link.scene.close()
        link.scene = self
        wanted = [Subprotocol(self.selected_subprotocol)] if self.selected_subprotocol else None
        self._viser = await websockets.asyncio.client.unix_connect(
            str(self.server.scene),
            uri=f"ws://localhost/{number}",
            subprotocols=wanted,
            max_size=MOST_SCENE_BYTES,
            max_queue=4,
            compression=None,
            ping_interval=None,
        )
        # tornado hears nothing of the page before this method is over
        self._pump = asyncio.create_task(self._pass_on(self._viser))

    async def _pass_on(self, viser: websockets.asyncio.client.ClientConnection) -> None:
        """One message after the other: a page that reads slowly is sent less, for viser leaves out what is outdated."""
        with suppress(
            tornado.websocket.WebSocketClosedError, tornado.iostream.StreamClosedError, websockets.exceptions.ConnectionClosed
        ):
            async for message in viser:
                await self.write_message(message, binary=isinstance(message, bytes))
        self.close()

    async def on_message(self, message: str | bytes) -> None:
        heard = said(message)
        if self._viser is None or self._link is None:
            return
        if isinstance(heard, Click) and self._clicks.allows():
            self.server.clicked(self._link.page, heard)
        elif isinstance(heard, Camera) and self._cameras.allows():
            with suppress(websockets.exceptions.ConnectionClosed):
                await self._viser.send(for_viser(heard))

    def on_close(self) -> None:
        if self._link is not None and self._link.scene is self:
            self._link.scene = None
        if self._viser is not None:
            self.server.closing = asyncio.ensure_future(self._viser.close())


class Server:
    """Made, and run, in one thread. `links`: the pages that are connected, by number; `url`: where a person opens it."""

    def __init__(self, host: str, port: int, token: str, scene: Path, orders: Orders, clicked: Callable[[Page, Click], None]):
        """Listen; raises ConsoleError as `listening`. `scene`: viser's socket. `clicked`: told of a page's click."""
        import viser

        self.links: dict[str, _Link] = {}
        self.orders, self.clicked, self.scene = orders, clicked, scene
        self.closing: asyncio.Future[None] | None = None
        self._loop = tornado.ioloop.IOLoop.current()
        view = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_bytes()
        files = [
            ("/?", (PAGE / "index.html").read_bytes(), "text/html", OWN_PAGE),
            ("/app.js", (PAGE / "app.js").read_bytes(), "text/javascript", OWN_PAGE),
            ("/style.css", (PAGE / "style.css").read_bytes(), "text/css", OWN_PAGE),
            ("/scene", view.replace(b"</head>", ONLY_THE_VIEW + b"</head>", 1), "text/html", VIEW_PAGE),
        ]
        token_first = r"/(?P<token>[^/]+)"
        routes: list[Any] = [
            (token_first + path, _File, {"content": content, "kind": kind, "policy": policy})
            for path, content, kind, policy in files
        ]
        routes += [
            (token_first + "/link", _Link, {"server": self}),
            (token_first + "/scene/(?P<number>[^/]+)", _SceneSocket, {"server": self}),
        ]
        self._http, self.port = listening(routes, Gate(token, host in LOOPBACK), host, port)
        self.url = address("http", host, self.port, token)

    def later(self, work: Callable[[], None]) -> None:
        """Do something in the server's thread, from any other."""
        self._loop.add_callback(work)

    def tell(self, document: Callable[[Page], dict[str, Any]]) -> None:
        """Send each page its own. In the server's thread."""
        for link in list(self.links.values()):
            link.send(json_of(document(link.page)))

    def close(self) -> None:
        """Let go of the port and of every page."""
        self._http.stop()
        for link in list(self.links.values()):
            link.close()
