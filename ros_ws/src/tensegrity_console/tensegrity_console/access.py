# SPDX-License-Identifier: Apache-2.0
"""Who may talk to a server of ours: whoever has the address that it printed, from no page but those that are let in.

The secret is the first part of the address's path. It is in no cookie: browsers send a host's cookies to every port of that host,
so to whatever another user of this machine serves there. What else is checked: the Origin (other sites' pages) and, on loopback,
the Host (names that somebody else's server resolves to this machine). A wrong secret is answered late, the right one at once.
"""

import asyncio
import hmac
import os
import re
import secrets
import socket
import time
from collections.abc import Collection
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import tornado.httpserver
import tornado.httputil
import tornado.netutil
import tornado.web
import tornado.websocket

from sim_core.errors import FileError
from sim_core.files.bounded_reader import read_bytes
from tensegrity_lab.errors import ConsoleError

TOKEN_VARIABLE = "SIXSTRUT_TOKEN"
LOOPBACK = ("127.0.0.1", "localhost", "::1")
MOST_TOKEN = 1024
VALID = "valid are 16 to 128 letters, digits, - and _"
MOST_UNSENT = 4 * 1024 * 1024
"""Bytes that wait for one page; it is let go when there are more."""
PING_S = 30.0
"""A page that does not answer for as long is let go. A browser that draws in software on a busy machine is slow, not gone."""
FIRST_DELAY_S, LONGEST_DELAY_S = 0.25, 5.0
FORGET_S = 60.0
MOST_HELD = 200
"""Refusals that wait at the same time, of everybody; what comes meanwhile is cut off at once."""
IDLE_S = 30.0
MOST_HEADER = 16 * 1024


# ---- the secret -----------------------------------------------------------------------------------------------------


def chosen_token(file: Path | None) -> str:
    """The secret of a file, of the environment, or a new one; the environment's is taken out of it, for it is no child's.

    Raises ConsoleError: it is short, or others may read or change the file.
    """
    given = os.environ.pop(TOKEN_VARIABLE, "")
    where = f"the environment's {TOKEN_VARIABLE}"
    if file is not None:
        given, where = _read(file), str(file)
    elif not given:
        return secrets.token_urlsafe(24)
    if not re.fullmatch(r"[A-Za-z0-9_-]{16,128}", given):
        raise ConsoleError(
            f"the token in {where} is too short, too long or has other characters: {VALID}; leave it out for a new one"
        )
    return given


def _read(file: Path) -> str:
    try:
        return read_bytes(file, MOST_TOKEN, owners=(os.geteuid(),), hidden=True).decode("ascii", "replace").strip()
    except OSError as error:
        raise ConsoleError(f"--token-file {file}: {error.strerror}; give a file of yours that holds the token") from error
    except FileError as error:
        raise ConsoleError(f"--token-file {file}: {error.problem}; {error.remedy}") from error


def refuse_on_command_line(value: str | None) -> None:
    """Raises ConsoleError: --token was given, as it once could be."""
    if value is not None:
        raise ConsoleError(
            f"every user of this machine sees --token: choose another secret, and give it in {TOKEN_VARIABLE} or by --token-file"
        )


# ---- who is let in --------------------------------------------------------------------------------------------------


class Gate:
    """Judges requests.

    Args:
        token: the secret.
        loopback: whether only this machine's own names are called.
        origins: of pages that may connect beside the server's own. Programs that are no page tell none.
    """

    def __init__(self, token: str, loopback: bool, origins: Collection[str] = ()):
        self._token = token.encode()
        self._loopback = loopback
        self._origins = origins
        self._wrong: dict[str, tuple[int, float]] = {}
        self._held = 0

    def admits(self, request: tornado.httputil.HTTPServerRequest, given: str) -> bool:
        """Whether a request is let in."""
        right = hmac.compare_digest(given.encode("utf-8", "surrogatepass"), self._token)
        host = request.headers.get("Host", "")
        name = host.rsplit(":", 1)[0] if not host.endswith("]") else host
        called = not self._loopback or name.strip("[]").lower() in LOOPBACK
        return right and called and all(self._from_page(origin, host) for origin in request.headers.get_list("Origin"))

    def _from_page(self, origin: str, host: str) -> bool:
        """Whether a page may connect: one of this very server, same name, same port, or one of those that were named."""
        return origin in self._origins or urlsplit(origin).netloc.lower() == host.lower()

    async def hold(self, remote: str) -> bool:
        """Wait before a refusal is told, the longer the more this address was refused; False: too many wait, cut it off."""
        now = time.monotonic()
        times, last = self._wrong.pop(remote, (0, now))
        times = times + 1 if now - last < FORGET_S else 1
        if len(self._wrong) >= MOST_HELD:
            self._wrong.pop(next(iter(self._wrong)))  # the one that was refused longest ago
        self._wrong[remote] = (times, now)
        if self._held >= MOST_HELD:
            return False
        self._held += 1
        try:
            await asyncio.sleep(min(LONGEST_DELAY_S, FIRST_DELAY_S * 2.0 ** min(times - 1, 10)))
        finally:
            self._held -= 1
        return True


class Guarded(tornado.web.RequestHandler):
    """Only for who is let in. Routes name the first part of the path `token`; the application's setting `gate` judges."""

    async def prepare(self) -> None:
        """See RequestHandler."""
        gate: Gate = self.settings["gate"]
        if not gate.admits(self.request, self.path_kwargs.get("token") or ""):
            if not await gate.hold(self.request.remote_ip or "") and self.request.connection is not None:
                self.detach().close()
                raise tornado.web.Finish
            raise tornado.web.HTTPError(403, reason="open the address that was printed")

    def set_default_headers(self) -> None:
        """See RequestHandler. No other site may read this, embed it, or hold on to its window."""
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("Cross-Origin-Resource-Policy", "same-origin")
        self.set_header("Cross-Origin-Opener-Policy", "same-origin")
        self.set_header("Content-Security-Policy", "default-src 'none'; frame-ancestors 'none'")

    def write_error(self, status_code: int, **_: Any) -> None:
        """See RequestHandler."""
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code}: {self._reason}\n")


class GuardedSocket(tornado.websocket.WebSocketHandler, Guarded):
    """A WebSocket for who is let in; one that does not read what it is sent is let go. `unsent`: bytes that wait for it."""

    unsent = 0

    def check_origin(self, _origin: str) -> bool:
        """See WebSocketHandler: the gate has judged it."""
        return True

    def send(self, message: str | bytes) -> None:
        """In the server's thread. A page that has gone is none; one that lets too much wait has gone."""
        if self.unsent > MOST_UNSENT:
            self.close(1008, "it does not read")
            return
        size = len(message)
        try:
            written = self.write_message(message, binary=isinstance(message, bytes))
        except tornado.websocket.WebSocketClosedError:
            return
        self.unsent += size

        def over(future: Any) -> None:
            self.unsent -= size
            future.exception()  # it went meanwhile: nobody is left to be told

        written.add_done_callback(over)


class _Elsewhere(Guarded):
    """All addresses that are none: no guess is told apart from another."""

    async def prepare(self) -> None:
        self.path_kwargs = {}
        await super().prepare()


def listening(routes: list[Any], gate: Gate, host: str, port: int) -> tuple[tornado.httpserver.HTTPServer, int]:
    """A server for these routes, in this thread's loop, and its port. `port`: 0: any free one.

    Raises ConsoleError: the port is taken, or no such address is here.
    """
    application = tornado.web.Application(
        routes,
        gate=gate,
        default_handler_class=_Elsewhere,
        websocket_ping_interval=PING_S,
        websocket_ping_timeout=PING_S,
        log_function=lambda handler: None,
    )
    try:
        sockets = tornado.netutil.bind_sockets(port, host)
    except OSError as error:
        why = f"{error.strerror or error}; give another --port (0: any free one)"
        raise ConsoleError(f"cannot listen on port {port} of {host}: {why}") from error
    server = tornado.httpserver.HTTPServer(
        application, idle_connection_timeout=IDLE_S, body_timeout=IDLE_S, max_header_size=MOST_HEADER, max_body_size=MOST_HEADER
    )
    server.add_sockets(sockets)
    return server, int(sockets[0].getsockname()[1])


def address(scheme: str, host: str, port: int, token: str) -> str:
    """What a person opens."""
    name = socket.gethostname() if host in ("0.0.0.0", "::") else host
    return f"{scheme}://{f'[{name}]' if ':' in name else name}:{port}/{token}/"
