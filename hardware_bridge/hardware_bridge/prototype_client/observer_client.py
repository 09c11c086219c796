# SPDX-License-Identifier: Apache-2.0
"""The bridge's eye: follows an observer's socket from a thread of its own, and comes back when the observer does."""

import contextlib
import logging
import socket
import threading
from collections.abc import Callable

from hardware_bridge.errors import ObserverError
from hardware_bridge.prototype_client import private_files
from hardware_bridge.prototype_client.observation import Observation, decode_observation

_log = logging.getLogger(__name__)
ROOT = 0
_RETRY_S = 0.5
_LONGEST_LINE = 65536


class ObserverClient:
    """Calls `on_observation` with every observation, in order, from its thread; an exception there is logged.

    Args:
        path: the observer's Unix socket, such as `Bridge.observer`; its process must be this user's, or root's.
        on_observation: takes an `Observation`.
        on_connection: told True when the observer is there, False when it is gone.

    Attributes:
        refused: it was somebody else's.
    """

    def __init__(
        self,
        path: str,
        on_observation: Callable[[Observation], None],
        on_connection: Callable[[bool], None] = lambda connected: None,
    ) -> None:
        self._path = path
        self._on_observation = on_observation
        self._on_connection = on_connection
        self.refused = False
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="observer", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends within half a second. Not from within a callback."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ending.is_set():
            try:
                with private_files.connect(self._path, _RETRY_S, trusted=(ROOT,)) as connection, contextlib.suppress(OSError):
                    self._tell(True)
                    try:
                        self._follow(connection)
                    finally:
                        self._tell(False)
            except PermissionError as error:  # what strangers see is not believed
                if not self.refused:
                    self.refused = True
                    _log.error("the observer is not followed: %s", error.strerror)
            except OSError:
                pass  # it is not there, or not yet
            self._ending.wait(_RETRY_S)

    def _follow(self, connection: socket.socket) -> None:
        buffer = b""
        while not self._ending.is_set():
            try:
                data = connection.recv(_LONGEST_LINE)
            except TimeoutError:
                continue
            if not data:
                return
            *lines, buffer = (buffer + data).split(b"\n")
            for line in lines:
                self._observe(line)
            if len(buffer) > _LONGEST_LINE:
                _log.error("the observer at %s sends no lines", self._path)
                return

    def _observe(self, line: bytes) -> None:
        try:
            self._on_observation(decode_observation(line))
        except ObserverError as error:
            _log.error("observer %s: %s", self._path, error)
        except Exception:
            _log.exception("callback of the observer's client")

    def _tell(self, connected: bool) -> None:
        try:
            self._on_connection(connected)
        except Exception:
            _log.exception("callback of the observer's client")
