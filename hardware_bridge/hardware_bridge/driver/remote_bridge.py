# SPDX-License-Identifier: Apache-2.0
"""The bridge as seen from another process: the same calls and callbacks; port and frame timer are in a process of their own."""

from __future__ import annotations

import os
import pickle
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from dataclasses import replace
from functools import wraps
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, Concatenate, ParamSpec, TypeVar

from hardware_bridge.boards.board import Board
from hardware_bridge.driver.bridge import Bridge
from hardware_bridge.driver.bridge_host import MOST_BYTES, Call, Happened, Judge, Judged, Opened, Refreshed, Reply
from hardware_bridge.driver.events import Callbacks, FaceEvent, SentEvent, Snapshot
from hardware_bridge.driver.motion_handle import MotionHandle, MotionResult, Progress
from hardware_bridge.errors import StateError
from hardware_bridge.safety.limit_checks import Rules, any_shape
from hardware_bridge.safety.trajectory import Trajectory

END_LIMIT_S = 5.0
"""Wall time in which a host whose connection is closed holds the struts and ends."""


class HostProcess:
    """A process with a `BridgeHost`, and the connection to it. Methods may be called from any thread.

    Events come in a thread of this object's, in order; they must not call the host.
    """

    def __init__(self, command: Sequence[str], on_end: Callable[[str], None]) -> None:
        """Starts a program; the number of its end of the connection is added as the last word.

        `on_end` is told once, from another thread, if the process ends by itself, and how.
        """
        here, there = socket.socketpair()
        with there:
            self._child = subprocess.Popen(
                [*command, str(there.fileno())], pass_fds=[there.fileno()], stdin=subprocess.DEVNULL, start_new_session=True
            )
        self._socket = here
        self._connection = Connection(os.dup(here.fileno()))
        self._on_end = on_end
        self._sending = threading.Lock()
        self._asked: dict[int, Future[Any]] = {}
        self._count = 0
        self._ended = ""
        self._closing = False
        self._bridge: RemoteBridge | None = None
        self._judging: SimpleQueue[Judge | None] = SimpleQueue()
        threading.Thread(target=self._listen, name="bridge events", daemon=True).start()
        threading.Thread(target=self._judge, name="bridge shapes", daemon=True).start()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._child.pid

    def tell(self, message: Any) -> None:
        """Sends the program something, whether or not it answers."""
        data = pickle.dumps(message)
        try:
            with self._sending:
                self._connection.send_bytes(data)
        except OSError:
            self._release()

    def open(
        self,
        port: str,
        rules: Rules,
        *,
        board: Board,
        on_sent: Callable[[SentEvent], None] | None = None,
        on_face: Callable[[FaceEvent], None] | None = None,
        on_state: Callable[[Snapshot], None] | None = None,
        **options: Any,
    ) -> RemoteBridge:
        """Makes a bridge there and opens it; arguments, callbacks and errors as `Bridge`'s. An older one is closed."""
        bridge = RemoteBridge(self, port, rules, board, Callbacks(on_sent, on_face, on_state))
        self._bridge = bridge
        # The judge of shapes stays here: it is slow, and needs what the host must not load.
        opened: Opened = self.call("open", port, replace(rules, shape_check=any_shape), board=board, **options)
        bridge.observer, bridge.board_timeout_s = opened.observer, opened.board_timeout_s
        bridge.refreshed(Refreshed(opened.snapshot, {}))
        return bridge

    def call(self, name: str, *arguments: Any, **options: Any) -> Any:
        """Calls a method there and waits for its end.

        Raises:
            BridgeError: what it raised; `StateError` if the process is gone.
        """
        asked: Future[Any] = Future()
        with self._sending:
            self._count += 1
            number = self._count
            self._asked[number] = asked
        self.tell(Call(number, name, arguments, options))
        try:
            return asked.result()
        except CancelledError:
            problem = f"the bridge's process has ended ({self._ended}); start the bridge again"
            raise StateError(name, "gone", problem) from None
        finally:
            del self._asked[number]

    def close(self) -> int:
        """Lets go of the process, which holds the struts and ends; its exit code."""
        self._closing = True
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        try:
            return self._child.wait(END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            return self._child.wait()

    # ---- the connection -----------------------------------------------------------------------------------------------

    def _listen(self) -> None:
        try:
            while True:
                message = pickle.loads(self._connection.recv_bytes(MOST_BYTES))
                if isinstance(message, Reply):
                    asked = self._asked.get(message.number)
                    if asked is None or not asked.set_running_or_notify_cancel():
                        continue
                    if message.error is None:
                        asked.set_result(message.value)
                    else:
                        asked.set_exception(message.error)
                elif isinstance(message, Judge):
                    self._judging.put(message)
                elif isinstance(message, Refreshed) and self._bridge is not None:
                    self._bridge.refreshed(message)
                elif isinstance(message, Happened) and self._bridge is not None:
                    self._bridge.happened(message.event)
        except (EOFError, OSError):
            pass
        self._judging.put(None)
        if not self._closing:
            code = self._child.wait()
            self._ended = f"exit code {code}" if code >= 0 else f"signal {-code}"
            self._release()
            self._on_end(self._ended)
        self._release()

    def _release(self) -> None:
        """Nobody will answer any more."""
        self._ended = self._ended or "its connection is closed"
        for asked in list(self._asked.values()):
            asked.cancel()

    def _judge(self) -> None:
        while (question := self._judging.get()) is not None:
            bridge = self._bridge
            try:
                verdict = "no bridge is open" if bridge is None else bridge.rules.shape_check(question.lengths_m)
            except Exception as failure:  # whatever it is: what was not judged does not move
                verdict = f"cannot be judged, internal error: {failure!r}"
            self.tell(Judged(question.number, verdict))


_P = ParamSpec("_P")
_R = TypeVar("_R")


def _remote(method: Callable[Concatenate[Bridge, _P], _R]) -> Callable[Concatenate[RemoteBridge, _P], _R]:
    """The same method of the bridge in the host's process."""

    @wraps(method)
    def call(bridge: RemoteBridge, /, *arguments: _P.args, **options: _P.kwargs) -> _R:
        value: _R = bridge.host.call(method.__name__, *arguments, **options)
        return value

    return call


class RemoteBridge:
    """As `Bridge`, in a host's process. After `close` only `snapshot` is of use.

    Attributes:
        host: where it is.
        port, rules, board: as `Bridge`'s.
        observer: path of the virtual prototype's observer socket; None on a real port.
        board_timeout_s: as `Bridge`'s.
    """

    def __init__(self, host: HostProcess, port: str, rules: Rules, board: Board, callbacks: Callbacks) -> None:
        self.port, self.rules, self.board = port, rules, board
        self.observer: str | None = None
        self.board_timeout_s: float | None = None
        self.host = host
        self._callbacks = callbacks
        self._motions: dict[int, MotionHandle] = {}
        self._ends: dict[int, MotionResult] = {}
        self._lock = threading.Lock()
        self._snapshot: Snapshot | None = None
        self._progresses: dict[int, Progress] = {}

    close = _remote(Bridge.close)
    judge_homing = _remote(Bridge.judge_homing)
    judge_motion = _remote(Bridge.judge_motion)
    returns = _remote(Bridge.returns)
    arm = _remote(Bridge.arm)
    disarm = _remote(Bridge.disarm)
    hold = _remote(Bridge.hold)
    stop = _remote(Bridge.stop)
    reset = _remote(Bridge.reset)
    observe_face = _remote(Bridge.observe_face)

    def prove(self, lease: str) -> None:
        """As `Bridge.prove`, but waits for no answer: a proof that is refused is as good as none."""
        self.host.tell(Call(0, "prove", (lease,)))

    def execute(self, trajectory: Trajectory, lease: str, stamp_age_s: float = 0.0, overtake: bool = False) -> MotionHandle:
        """As `Bridge.execute`."""
        number, duration_s = self.host.call("execute", trajectory, lease, stamp_age_s, time.monotonic(), overtake)
        handle = MotionHandle(number, duration_s, self._progress, lambda number, reason: self.host.call("cancel", number, reason))
        with self._lock:
            if number in self._ends:
                handle.finish(self._ends.pop(number))
            else:
                self._motions[number] = handle
        return handle

    def snapshot(self) -> Snapshot:
        """As `Bridge.snapshot`, at most `REFRESH_S` old; every change of state is in it at once. Waits for nothing."""
        assert self._snapshot is not None
        return self._snapshot

    def happened(self, event: Any) -> None:
        """For the host: something happened."""
        if isinstance(event, SentEvent | FaceEvent | Snapshot):
            if isinstance(event, Snapshot):
                self._keep(event)
            self._callbacks.tell(event)
        else:
            number, result = event
            with self._lock:
                handle = self._motions.pop(number, None)
                if handle is None:
                    self._ends[number] = result  # it was shorter than the answer to `execute`
                else:
                    handle.finish(result)

    def refreshed(self, news: Refreshed) -> None:
        """For the host: how things are."""
        self._progresses = news.motions
        self._keep(news.snapshot)

    def _keep(self, snapshot: Snapshot) -> None:
        """The newest by the robot's clock: one may have been made before another, and come after it."""
        with self._lock:
            before = self._snapshot
            if before is None or before.session != snapshot.session or snapshot.robot_time_ns >= before.robot_time_ns:
                self._snapshot = snapshot

    def _progress(self, handle: MotionHandle) -> Progress:
        newest = self._progresses.get(handle.number)
        if newest is None:
            return handle.progress_at(None, self.snapshot().lengths_m)
        return handle.progress_at(newest.elapsed_s, newest.lengths_m)
