# SPDX-License-Identifier: Apache-2.0
"""A Foxglove app as the protocol sees it: JSON texts and little-endian binary messages on a WebSocket."""

import json
import struct
import time
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

PROTOCOL = Subprotocol("foxglove.sdk.v1")
LIMIT_S = 30.0
_MESSAGE, _RESPONSE = 1, 3
_PUBLISH, _CALL = 1, 2


class App:
    """Keeps what the server told; every wait has a limit. It reads only while it waits for something.

    Attributes:
        channels: topic -> channel. services: name -> service. statuses: texts of warnings.
    """

    def __init__(self, url: str, origin: str | None = None):
        self._socket = connect(url, subprotocols=[PROTOCOL], max_size=None, origin=Origin(origin) if origin else None)
        self.channels: dict[str, dict[str, Any]] = {}
        self.services: dict[str, dict[str, Any]] = {}
        self.statuses: list[str] = []
        self.info: dict[str, Any] = {}
        self._messages: dict[int, list[bytes]] = {}
        self._answers: dict[int, bytes | str] = {}
        self._calls = 0

    def close(self) -> None:
        self._socket.close()

    def say_raw(self, data: str | bytes) -> None:
        """Whatever it is."""
        self._socket.send(data)

    def until(self, condition: Any, what: str, limit_s: float = LIMIT_S) -> None:
        """Read until something is so."""
        end = time.monotonic() + limit_s
        while not condition():
            left_s = end - time.monotonic()
            assert left_s > 0.0, (
                f"{what} did not come within {limit_s:g} s; known: {sorted(self.channels)}, {list(self.services)}, {self.statuses}"
            )
            try:
                self._take(self._socket.recv(timeout=min(left_s, 0.5)))
            except TimeoutError:
                continue
            except ConnectionClosed as error:
                raise AssertionError(f"the server closed the connection while {what} was awaited") from error

    def _take(self, data: str | bytes) -> None:
        if isinstance(data, bytes):
            if data[0] == _MESSAGE:
                self._messages.setdefault(struct.unpack_from("<I", data, 1)[0], []).append(data[13:])
            elif data[0] == _RESPONSE:
                _, call, length = struct.unpack_from("<III", data, 1)
                self._answers[call] = data[13 + length :]
            return
        told = json.loads(data)
        if told["op"] == "serverInfo":
            self.info = told
        elif told["op"] == "advertise":
            self.channels |= {channel["topic"]: channel for channel in told["channels"]}
        elif told["op"] == "advertiseServices":
            self.services |= {service["name"]: service for service in told["services"]}
        elif told["op"] == "status":
            self.statuses.append(told["message"])
        elif told["op"] == "serviceCallFailure":
            self._answers[told["callId"]] = told["message"]

    # ---- topics -----------------------------------------------------------------------------------------------------

    def subscribe(self, topic: str) -> int:
        """Look at a topic, once it is offered."""
        self.until(lambda: topic in self.channels, topic)
        number = self.channels[topic]["id"]
        self._subscribe(number)
        return number

    def _subscribe(self, number: int) -> None:
        self._say({"op": "subscribe", "subscriptions": [{"id": number, "channelId": number}]})

    def unsubscribe(self, number: int) -> None:
        self._say({"op": "unsubscribe", "subscriptionIds": [number]})

    def newest(self, topic: str) -> Any:
        """The next message of a topic, decoded by a reader that is not ours, by the definition that the server gave."""
        number = self.channels[topic]["id"]
        self._messages[number] = []
        self.until(lambda: self._messages[number], f"a message on {topic}")
        return self.decoded(topic, self._messages[number][-1])

    def first(self, topic: str) -> Any:
        """The first message that came since `subscribe`."""
        number = self.channels[topic]["id"]
        self.until(lambda: self._messages.get(number), f"a message on {topic}")
        return self.decoded(topic, self._messages[number][0])

    def decoded(self, topic: str, data: bytes) -> Any:
        channel = self.channels[topic]
        assert channel["schemaEncoding"] == "ros2msg"
        assert channel["encoding"] == "cdr"
        store = get_typestore(Stores.ROS2_JAZZY)
        types = get_types_from_msg(channel["schema"], channel["schemaName"])
        store.register({name: fields for name, fields in types.items() if name not in store.fielddefs})
        return store.deserialize_cdr(data, channel["schemaName"])

    def publish(self, topic: str, schema: str, data: bytes, encoding: str = "cdr") -> None:
        self._say({"op": "advertise", "channels": [{"id": 1, "topic": topic, "encoding": encoding, "schemaName": schema}]})
        self._socket.send(struct.pack("<BI", _PUBLISH, 1) + data)

    # ---- services ---------------------------------------------------------------------------------------------------

    def call(self, service: str, payload: bytes) -> bytes | str:
        """The answer's bytes, or the words of a failure."""
        self.until(lambda: service in self.services, service)
        self._calls += 1
        call, encoding = self._calls, b"cdr"
        head = struct.pack("<BIII", _CALL, self.services[service]["id"], call, len(encoding))
        self._socket.send(head + encoding + payload)
        self.until(lambda: call in self._answers, f"the answer of {service}", 60.0)
        return self._answers[call]

    def _say(self, document: dict[str, Any]) -> None:
        self._socket.send(json.dumps(document))
