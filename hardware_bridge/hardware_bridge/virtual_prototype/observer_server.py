# SPDX-License-Identifier: Apache-2.0
"""The observer: a Unix socket that tells every client, about 20 times a second of robot time, what a camera would see.

One JSON line an observation: `{"robot_time_ns", "face", "detail", "settled", "nodes_m": 12 x 3, "box_m": 3, "late_s"}`,
with a null `face` on no face. A client that does not read loses observations, never parts of a line, and holds up nobody.
"""

import contextlib
import socket
from pathlib import Path

from hardware_bridge.prototype_client import private_files
from hardware_bridge.prototype_client.observation import Observation, encode_observation

PERIOD_S = 0.05
_MAX_CLIENTS = 16


class Observer:
    """The server's side. Nothing here waits."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._server = private_files.listen(path, _MAX_CLIENTS)
        self._clients: dict[socket.socket, bytes] = {}

    def fileno(self) -> int:
        """Readable when somebody wants to watch."""
        return self._server.fileno()

    def accept(self) -> None:
        """Lets in whoever waits."""
        with contextlib.suppress(OSError):
            client, _ = self._server.accept()
            client.setblocking(False)
            if len(self._clients) < _MAX_CLIENTS:
                self._clients[client] = b""
            else:
                client.close()

    def tell(self, observation: Observation) -> None:
        """One observation to every client that has taken the one before."""
        if not self._clients:
            return
        line = encode_observation(observation)
        for client, unsent in list(self._clients.items()):
            try:
                rest = unsent[client.send(unsent) :] if unsent else b""
                if not rest:
                    rest = line[client.send(line) :]
                self._clients[client] = rest
            except BlockingIOError:
                continue
            except OSError:
                client.close()
                del self._clients[client]

    def close(self) -> None:
        """Ends all, and removes the socket's path."""
        for client in self._clients:
            client.close()
        self._clients.clear()
        self._server.close()
        self.path.unlink(missing_ok=True)
