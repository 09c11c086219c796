# SPDX-License-Identifier: Apache-2.0
"""A bridge in a process of its own: what owns the port and the frame timer shares its interpreter with nothing else.

The other end of a connection (see `remote_bridge`) opens it and calls it; what happens to the robot goes back over the same
connection, in order. Nobody at the other end can keep a frame or a stop waiting: calls that may wait have threads of their own, and
events go out through a queue. When the other end is gone, or reads nothing any more, the struts are held and the port is closed.
"""

import logging
import os
import pickle
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, NamedTuple

from hardware_bridge.driver.bridge import Bridge
from hardware_bridge.driver.events import Snapshot
from hardware_bridge.driver.motion_handle import MotionHandle, MotionResult, Progress
from hardware_bridge.errors import BridgeError, StateError
from hardware_bridge.safety.command_age import Age
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.shape_cache import Verdict
from hardware_bridge.safety.trajectory import Trajectory

_log = logging.getLogger(__name__)

MOST_BYTES = 8 * 1024 * 1024
"""Of one message in either direction: the longest trajectory has a few hundred kB."""

REFRESH_S = 0.1
"""Wall time between snapshots that nobody asks for: the other end looks at the newest, and never waits for one."""

_SLOW = frozenset({"open", "close", "reset", "arm", "judge_homing", "judge_motion", "execute"})
"""Calls that may wait for something: each has a thread of its own."""

MOST_WAITING = 20_000
"""Events that wait for the other end, a quarter of an hour of them: then it will never read them."""


class Opened(NamedTuple):
    """What the other end must know of a bridge that is open."""

    observer: str | None
    board_timeout_s: float | None
    snapshot: Snapshot


class Call(NamedTuple):
    """To the host: call a method of the bridge, or one of the host's own."""

    number: int
    name: str
    arguments: tuple[Any, ...] = ()
    options: Mapping[str, Any] = {}


class Judged(NamedTuple):
    """To the host: the answer to a `Judge`."""

    number: int
    verdict: Verdict


class Reply(NamedTuple):
    """From the host: how a `Call` ended. `error` None: well, with `value`."""

    number: int
    value: Any
    error: BridgeError | None


class Judge(NamedTuple):
    """From the host: what is wrong with this shape, six rest lengths in [m]?"""

    number: int
    lengths_m: tuple[float, ...]


class Happened(NamedTuple):
    """From the host: `SentEvent`, `FaceEvent`, `Snapshot`, or a motion's (number, `MotionResult`)."""

    event: Any


class Refreshed(NamedTuple):
    """From the host, every `REFRESH_S`: the bridge now, and how far its motions are, by number."""

    snapshot: Snapshot
    motions: dict[int, Progress]


class BridgeHost:
    """Serves one connection with one bridge at a time. `stop` may be called from any thread."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._bridge: Bridge | None = None
        self._is_open = False
        self._motions: dict[int, MotionHandle] = {}
        self._verdicts: dict[int, SimpleQueue[Verdict]] = {}
        self._judged = 0
        self._lock = threading.Lock()
        self._waiting: SimpleQueue[bytes] = SimpleQueue()
        self._writer = threading.Thread(target=self._write, name="events out", daemon=True)
        self._own: dict[str, Callable[..., Any]] = {
            "open": self._open,
            "close": self._close,
            "execute": self._execute,
            "cancel": self._cancel,
        }

    def serve(self) -> None:
        """Does what the other end asks until it is gone; then closes the bridge, struts held."""
        self._writer.start()
        threading.Thread(target=self._refresh, name="refresh", daemon=True).start()
        try:
            while True:
                message = pickle.loads(self._connection.recv_bytes(MOST_BYTES))
                if isinstance(message, Judged):
                    self._verdicts[message.number].put(message.verdict)
                elif message.name in _SLOW:
                    threading.Thread(target=self._answer, args=(message,), name=message.name, daemon=True).start()
                else:
                    self._answer(message)
        except (EOFError, OSError):
            pass
        finally:
            self.end()

    def end(self) -> None:
        """Holds the struts and closes the port, if it is open."""
        bridge = self._bridge
        if bridge is not None:
            try:
                bridge.close()
            except BridgeError as error:
                _log.error("%s", error)

    def stop(self) -> bool:
        """Stops the bridge at once; whether there is one with an open port. Never raises."""
        bridge = self._bridge
        if bridge is not None:
            bridge.stop()
        return self._is_open

    # ---- calls ------------------------------------------------------------------------------------------------------

    @property
    def _present(self) -> Bridge:
        if self._bridge is None:
            raise StateError("call", "closed", "the bridge was never opened; open it first")
        return self._bridge

    def _answer(self, call: Call) -> None:
        try:
            method = self._own.get(call.name) or getattr(self._present, call.name)
            value, error = method(*call.arguments, **call.options), None
        except BridgeError as refused:
            value, error = None, refused
        except Exception as failure:
            _log.exception(call.name)
            value, error = None, BridgeError(f"internal error in {call.name}: {failure!r}")
        self._tell(Reply(call.number, value, error))

    def _open(self, port: str, rules: Rules, **options: Any) -> Opened:
        """Arguments as `Bridge`'s, but for its callbacks. Shapes are judged at the other end."""
        self.end()
        self._motions.clear()
        self._bridge = bridge = Bridge(
            port,
            replace(rules, shape_check=self._ask),
            on_sent=lambda event: self._tell(Happened(event)),
            on_face=lambda event: self._tell(Happened(event)),
            on_state=self._on_state,
            **options,
        )
        self._is_open = True
        try:
            bridge.open()
        except BaseException:
            self._is_open = False
            raise
        return Opened(bridge.observer, bridge.board_timeout_s, bridge.snapshot())

    def _close(self) -> None:
        self._is_open = False
        try:
            self._present.close()
        finally:
            self._tell(Refreshed(self._present.snapshot(), {}))

    def _execute(self, trajectory: Trajectory, lease: str, stamp_age_s: float, asked_s: float, overtake: bool) -> tuple[int, float]:
        age = Age(stamp_age_s, received_s=asked_s)  # on its way here it grows older, too
        handle = self._present.execute(trajectory, lease, age.now_s(), overtake)
        with self._lock:
            self._motions[handle.number] = handle
        self._tell_ends()  # it may have ended already
        return handle.number, handle.duration_s

    def _cancel(self, number: int, reason: str) -> None:
        handle = self._motions.get(number)
        if handle is not None:
            handle.cancel(reason)

    # ---- what the other end is told -----------------------------------------------------------------------------------

    def _on_state(self, snapshot: Snapshot) -> None:
        self._tell_ends()
        self._tell(Happened(snapshot))

    def _tell_ends(self) -> None:
        with self._lock:
            ended = [(number, handle.result()) for number, handle in self._motions.items() if handle.result() is not None]
            for number, result in ended:
                del self._motions[number]
                assert isinstance(result, MotionResult)
                self._tell(Happened((number, result)))

    def _refresh(self) -> None:
        ended = threading.Event()
        while not ended.wait(REFRESH_S):
            bridge = self._bridge
            if bridge is not None and self._is_open:
                with self._lock:
                    handles = dict(self._motions)
                motions = {number: handle.progress() for number, handle in handles.items()}
                snapshot = bridge.snapshot()
                if snapshot.session:  # else it is just being opened, and knows nothing yet
                    self._tell(Refreshed(snapshot, motions))

    def _ask(self, lengths_m: tuple[float, ...]) -> Verdict:
        answer: SimpleQueue[Verdict] = SimpleQueue()
        with self._lock:
            self._judged += 1
            number = self._judged
            self._verdicts[number] = answer
        self._tell(Judge(number, lengths_m))
        verdict = answer.get()
        del self._verdicts[number]
        return verdict

    def _tell(self, message: Any) -> None:
        self._waiting.put(pickle.dumps(message))
        if self._waiting.qsize() == MOST_WAITING:
            threading.Thread(target=self._give_up, name="give up", daemon=True).start()

    def _give_up(self) -> None:
        _log.error("nobody reads any more what happens to the robot: the struts are held and the port is closed")
        self.end()
        os._exit(1)

    def _write(self) -> None:
        """Only this thread waits for the other end."""
        with suppress(OSError):  # `serve` notices, too
            while True:
                self._connection.send_bytes(self._waiting.get())
