# SPDX-License-Identifier: Apache-2.0
"""Foxglove's WebSocket protocol, as much of it as a live stack needs: topics, services, and what apps publish.

It takes the place of foxglove-sdk's server, which asks nobody for a secret, looks at no Origin, and can listen only at a port that
every user and every page of this machine reaches.
"""

from __future__ import annotations

import asyncio
import json
import struct
import threading
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from typing import Any, NamedTuple

import tornado.httpserver

from hardware_bridge.recording.bag_quota import RateLimit
from sim_core.printable import printable
from tensegrity_console.access import LOOPBACK, MOST_UNSENT, Gate, GuardedSocket, listening
from tensegrity_lab.errors import ConsoleError

ENCODING = "cdr"
SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
"""The same thing under its new and its old name."""
_MESSAGE, _ANSWER = 1, 3
_PUBLISH, _CALL = 1, 2
WARNING = 1
LONGEST = 64 * 1024
"""Bytes that an app may send at once."""
MOST_DATA = MOST_UNSENT // 2
"""Bytes that wait for an app, beyond which messages of topics are left out; answers are not."""
MOST_WATCHED, MOST_CALLS = 500, 8
SAID_AT_ONCE, SAID_PER_S = 200, 50


class Service(NamedTuple):
    """A service that apps may call.

    Attributes:
        document: as apps are told, but for its number.
        call: bytes of the request -> bytes of the response; raises RuntimeError with words for a person.
        urgent: it is called whatever else an app has asked for.
    """

    document: dict[str, Any]
    call: Callable[[bytes], Awaitable[bytes]]
    urgent: bool


def schema(name: str, text: str) -> dict[str, str]:
    """A type as apps are told. Args: text: its definition."""
    return {"encoding": ENCODING, "schemaName": name, "schemaEncoding": "ros2msg", "schema": text}


class _App(GuardedSocket):
    """One app."""

    def initialize(self, hub: Hub) -> None:
        self.hub = hub
        self.watched: dict[int, int] = {}
        self._own: dict[int, tuple[str, str, str]] = {}
        self._calls: set[asyncio.Task[None]] = set()
        self._pace = RateLimit(SAID_AT_ONCE, SAID_PER_S)

    @property
    def max_message_size(self) -> int:
        return LONGEST

    def select_subprotocol(self, subprotocols: list[str]) -> str | None:
        return next((one for one in SUBPROTOCOLS if one in subprotocols), None)

    def open(self, *_: str, **__: str) -> None:
        if self.selected_subprotocol is None:
            self.close(1002, f"it speaks {SUBPROTOCOLS[0]}")
            return
        self.set_nodelay(True)
        self.hub.apps.add(self)
        for document in (*self.hub.greeting, {"op": "advertise", "channels": list(self.hub.channels.values())}):
            self.say(document)

    def on_close(self) -> None:
        self.hub.apps.discard(self)
        self.hub.looked_at()

    def say(self, document: dict[str, Any]) -> None:
        self.send(json.dumps(document))

    def complain(self, words: str) -> None:
        self.say({"op": "status", "level": WARNING, "message": printable(words)})

    def on_message(self, message: str | bytes) -> None:
        try:
            if isinstance(message, bytes):
                self._take(message)
            elif self._pace.allows():
                self._heed(json.loads(message))
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError, struct.error):
            self.complain("this is not Foxglove's protocol; nothing was done")

    def _heed(self, told: dict[str, Any]) -> None:
        if told["op"] == "subscribe":
            for one in told["subscriptions"][:MOST_WATCHED]:
                self._watch(_number(one["id"]), _number(one["channelId"]))
        elif told["op"] == "unsubscribe":
            for number in told["subscriptionIds"][:MOST_WATCHED]:
                self.watched.pop(_number(number), None)
            self.hub.looked_at()
        elif told["op"] == "advertise":
            for one in told["channels"][:MOST_WATCHED]:
                if len(self._own) < MOST_WATCHED:
                    self._own[_number(one["id"])] = (str(one["topic"]), str(one["schemaName"]), str(one["encoding"]))
        elif told["op"] == "unadvertise":
            for number in told["channelIds"][:MOST_WATCHED]:
                self._own.pop(_number(number), None)

    def _watch(self, number: int, channel: int) -> None:
        if channel not in self.hub.channels:
            self.complain(f"Unknown channel ID: {channel}")
        elif len(self.watched) < MOST_WATCHED:
            self.watched[number] = channel
            self.hub.looked_at()
            self.hub.looks(self.hub.channels[channel]["topic"])

    def _take(self, data: bytes) -> None:
        if data[0] == _PUBLISH:
            (number,) = struct.unpack_from("<I", data, 1)
            if self._pace.allows() and (why_not := self.hub.published(*self._own.get(number, ("", "", "")), data[5:])):
                self.complain(why_not)
        elif data[0] == _CALL:
            service, call, length = struct.unpack_from("<III", data, 1)
            self._call(service, call, data[13 + length :])

    def _call(self, number: int, call: int, payload: bytes) -> None:
        service = self.hub.services.get(number)
        if service is None:
            self._failed(number, call, "there is no such service here")
        elif not service.urgent and (len(self._calls) >= MOST_CALLS or not self._pace.allows()):
            self._failed(number, call, f"{len(self._calls)} calls of this app wait already; nothing was done")
        else:
            task = asyncio.ensure_future(self._answer(service, number, call, payload))
            self._calls.add(task)
            task.add_done_callback(self._calls.discard)

    async def _answer(self, service: Service, number: int, call: int, payload: bytes) -> None:
        try:
            response = await service.call(payload)
        except Exception as error:  # whatever a type support says of bytes that are no request
            self._failed(number, call, str(error))
            return
        head = struct.pack("<BIII", _ANSWER, number, call, len(ENCODING))
        self.send(head + ENCODING.encode() + response)

    def _failed(self, number: int, call: int, words: str) -> None:
        self.say({"op": "serviceCallFailure", "serviceId": number, "callId": call, "message": printable(words)})


def _number(value: Any) -> int:
    if type(value) is not int:
        raise TypeError(value)
    return value


class Hub:
    """The server, in a thread of its own. Methods may be called from any thread.

    Args:
        port: TCP, of this machine; 0: any free one.
        gate: who may connect.
        services: that apps may call.
        publish: apps may publish.
        looks: told a topic that an app begins to look at, in the server's thread.
        published: (topic, type, encoding, bytes) -> why it was not taken, or ""; in the server's thread.

    Raises ConsoleError: the port is taken.
    """

    def __init__(
        self,
        port: int,
        gate: Gate,
        services: Sequence[Service],
        publish: bool,
        looks: Callable[[str], None],
        published: Callable[[str, str, str, bytes], str],
    ):
        self.looks, self.published = looks, published
        self.services = dict(enumerate(services, start=1))
        self.channels: dict[int, dict[str, Any]] = {}
        self.apps: set[_App] = set()
        self.greeting: tuple[dict[str, Any], ...] = (
            {
                "op": "serverInfo",
                "name": "sixstrut",
                "capabilities": ["services", *(["clientPublish"] if publish else [])],
                "supportedEncodings": [ENCODING],
                "metadata": {"ROS_DISTRO": "jazzy"},
            },
            {"op": "advertiseServices", "services": [{"id": n} | one.document for n, one in self.services.items()]},
        )
        self._watched: frozenset[int] = frozenset()
        self._waiting, self._lock = 0, threading.Lock()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="foxglove", daemon=True)
        self._thread.start()
        try:
            self._http, self.port = self._do(self._listen(gate, port))
        except ConsoleError:
            self._loop.call_soon_threadsafe(self._loop.stop)
            raise

    def _do(self, work: Coroutine[Any, Any, Any], limit_s: float | None = None) -> Any:
        """In the server's thread."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(limit_s)

    async def _listen(self, gate: Gate, port: int) -> tuple[tornado.httpserver.HTTPServer, int]:
        return listening([(r"/(?P<token>[^/]+)/?", _App, {"hub": self})], gate, LOOPBACK[0], port)

    async def _end(self) -> None:
        self._http.stop()
        for app in list(self.apps):
            app.close(1001, "the server ends")
        await self._http.close_all_connections()

    def close(self) -> None:
        """Let the apps go, and of the port."""
        self._do(self._end(), 5.0)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5.0)

    def offer(self, topic: str, of: dict[str, str]) -> int:
        """A topic that apps can look at, and its number. Args: of: its schema."""
        number = len(self.channels) + 1
        self.channels[number] = {"id": number, "topic": topic} | of
        self._loop.call_soon_threadsafe(self._advertise, number)
        return number

    def _advertise(self, number: int) -> None:
        for app in list(self.apps):
            app.say({"op": "advertise", "channels": [self.channels[number]]})

    def watched(self, number: int) -> bool:
        """Whether an app looks at a topic."""
        return number in self._watched

    def looked_at(self) -> None:
        """In the server's thread: what is watched has changed."""
        self._watched = frozenset(channel for app in self.apps for channel in app.watched.values())

    def tell(self, number: int, time_ns: int, data: bytes) -> None:
        """A message of a topic, for who looks. What is too large, or comes where too much waits already, is left out."""
        with self._lock:
            if self._waiting > MOST_DATA or len(data) > MOST_DATA:
                return
            self._waiting += len(data)
        self._loop.call_soon_threadsafe(self._send, number, time_ns, data)

    def _send(self, number: int, time_ns: int, data: bytes) -> None:
        with self._lock:
            self._waiting -= len(data)
        for app in list(self.apps):
            for subscription, channel in app.watched.items():
                if channel == number and app.unsent <= MOST_DATA:
                    app.send(struct.pack("<BIQ", _MESSAGE, subscription, time_ns) + data)
