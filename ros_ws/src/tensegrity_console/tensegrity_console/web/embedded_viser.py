# SPDX-License-Identifier: Apache-2.0
"""viser without a port of its own: what it draws goes out by our server alone."""

import contextvars
import io
import socket
import tempfile
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any

import viser
import websockets.asyncio.server

from sim_core.files.places import temporary_parent
from tensegrity_lab.errors import ConsoleError

PAGE: contextvars.ContextVar[str] = contextvars.ContextVar("PAGE", default="")
"""In viser's callbacks for a client: the page that it belongs to, as the path told by which it was connected."""


class ViserInside(viser.ViserServer):
    """Listens at a socket file in a folder of this user alone, and never asks anybody outside for a tunnel.

    `path`: the socket's. Raises ConsoleError: there is no place for it, or this viser listens in another way.
    """

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="sixstrut-view-", dir=temporary_parent())  # mode 0700
        self.path = Path(self._folder.name) / "view"
        try:
            listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            listening.bind(str(self.path))
        except OSError as error:
            self._folder.cleanup()
            raise ConsoleError(
                f"no socket can be made at {self.path} ({error}): set TMPDIR to a folder with a short name"
            ) from error
        with _serving_at(listening), redirect_stdout(io.StringIO()):  # it announces an address that there is not
            super().__init__(host="127.0.0.1", port=0, verbose=False)

    def request_share_url(self, verbose: bool = True) -> None:
        """Sharing is switched off, whoever asks."""

    def stop(self) -> None:
        """See ViserServer."""
        super().stop()
        self._folder.cleanup()


@contextmanager
def _serving_at(listening: socket.socket) -> Iterator[None]:
    """While viser starts, what it asks for as a port is this socket; without that, nothing starts."""
    module: Any = websockets.asyncio.server
    real, asked = module.serve, []

    def serve(handler: Callable[[Any], Awaitable[None]], host: Any, port: Any, **options: Any) -> Any:  # noqa: ARG001 (as viser calls it)
        asked.append(port)

        async def with_page(connection: Any) -> None:
            PAGE.set(connection.request.path.rpartition("/")[2])
            await handler(connection)

        return real(with_page, unix=True, sock=listening, **options)

    module.serve = serve
    try:
        yield
    finally:
        module.serve = real
    if not asked:
        raise ConsoleError("this version of viser listens in another way than ours: set up again with the locked one")
