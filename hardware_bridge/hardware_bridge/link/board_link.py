# SPDX-License-Identifier: Apache-2.0
"""The open port with its board: writes frames, asks how the board is, and says when either is gone."""

import math
import threading
import time
from collections import deque
from collections.abc import Sequence

from hardware_bridge.boards.board import MAX_SERVOS, Board, Health
from hardware_bridge.errors import BoardSilent, LinkLost
from hardware_bridge.link.board_health import Answer
from hardware_bridge.link.latency import Latency, Replies
from hardware_bridge.link.transport import SerialTransport

PORT_LIMIT_S = 0.5
"""Longest wall time for which the port may keep its bytes to itself before the link is lost."""

LATE_ANSWER_S = 0.5
"""Wall time after which a board that used to answer is late: what is sent to it may be queueing somewhere."""

FIRST_ANSWER_LIMIT_S = 2.5
"""Wall time after the opening within which a board has answered, if it ever will: two questions are lost at most."""

_REPLY_LIMIT_S = 0.1


class Link:
    """Not for several threads at once; the bridge's lock sees to that.

    A failed link stays down until it is opened again. After a cut frame the stream is dirty: see `resynchronise`.

    A question's answer is what comes between it and the next question, and must be sound by length and content. Anything
    else is a failed question: the next one begins with a flush, and after `liveness_limit_s` without an answer the link
    is lost.

    Attributes:
        transport: the port.
        is_up: the port is open and nothing has failed since.
        battery_mv: last supply voltage that the board told, in [mV].
        write_errors: failed or partial writes.
        congested_periods: how often `holds_back` said yes.
    """

    def __init__(
        self,
        transport: SerialTransport,
        board: Board,
        channels: Sequence[int],
        liveness_period_s: float | None,
        liveness_limit_s: float,
    ) -> None:
        self.transport = transport
        self._board = board
        self._channels = tuple(channels)
        self._liveness_period_s = liveness_period_s
        self._liveness_limit_s = liveness_limit_s
        self.is_up = False
        self._reply = bytearray()
        self._reply_bytes = 0
        asked = 1 if liveness_period_s is None else math.ceil(liveness_limit_s / liveness_period_s)
        self._energised: deque[tuple[bool, ...]] = deque(maxlen=1 + asked)
        self._asked_s = -float("inf")
        self._answered_s: float | None = None
        self._unanswered_since_s: float | None = None
        self._answers = False
        self._heard = threading.Event()
        self._opened_s = 0.0
        self._dirty = False
        self.battery_mv: int | None = None
        self.write_errors = self.congested_periods = 0
        self._holds_since_s: float | None = None
        self._questions = self._unanswered = self._bad = 0
        self._reply_latency = Latency()

    def open(self) -> None:
        """Opens the port afresh; after a cut frame the link stays down until `resynchronise`.

        Raises:
            TransportError: what the transport raises.
        """
        self.close()
        self.transport.open()
        self._reply_bytes = 0
        self._energised.clear()
        self._asked_s = -float("inf")
        self._answered_s = self._unanswered_since_s = None
        self.battery_mv = None
        self._heard.clear()
        self._opened_s = time.monotonic()
        self.is_up = not self._dirty

    @property
    def has_answered(self) -> bool:
        """Whether the board has given a sound answer since the port was opened."""
        return self._heard.is_set()

    def wait_for_first_answer(self) -> None:
        """Waits, while somebody calls `attend`, until `has_answered`; not beyond `FIRST_ANSWER_LIMIT_S` after the opening.

        May be called from any thread.
        """
        while self.is_up and not self._heard.is_set():
            left_s = self._opened_s + FIRST_ANSWER_LIMIT_S - time.monotonic()
            if left_s <= 0.0 or self._liveness_period_s is None:
                break
            self._heard.wait(min(left_s, 0.05))

    def require_answered(self) -> None:
        """Raises BoardSilent: the board has not answered since the port was opened."""
        if not self._heard.is_set():
            word = "start the bridge with silent_board:=true"
            raise silence(self.transport.port, self._board, self._liveness_period_s is not None, word)

    def begin_counting(self) -> None:
        """All counts from 0."""
        self.write_errors = self.congested_periods = self._questions = self._unanswered = self._bad = 0
        self._holds_since_s = None
        self._reply_latency = Latency()

    @property
    def replies(self) -> Replies:
        """How questions were answered since `begin_counting`."""
        return Replies(self._questions, self._unanswered, self._bad, self._reply_latency.percentiles())

    def resynchronise(self) -> bool:
        """Makes a board that may hold part of a frame ready for the next one; whether the stream was dirty.

        Sends the board's cancel, if it has one, then queries, which move nothing, until the board answers or the longest
        frame must be complete (see `Quirks`).

        Raises:
            LinkLost: a board that used to answer does not; the link is down.
        """
        if not self._dirty:
            return False
        self.write(self._board.quirks.cancel)
        for _ in range(self._board.quirks.resync_queries):
            self._ask(())
            if self._answers and self._wait_for_answer():
                break
        else:
            if self._answers:
                remedy = "switch the servo supply off and on, then reset"
                raise LinkLost(self.transport.port, "does not answer after a cut frame", remedy, dirty=True)
        self._dirty, self.is_up = False, True
        return True

    def close(self) -> None:
        """Closes the port."""
        self.is_up = False
        self.transport.close()

    def lost(self, problem: str, remedy: str = "check power and link, then reset") -> LinkLost:
        """Takes the link down and makes the error that says so."""
        self.is_up = False
        return LinkLost(self.transport.port, problem, remedy)

    def write(self, data: bytes) -> None:
        """Writes all, or takes the link down and raises `LinkLost`."""
        if not data:
            return
        try:
            self.transport.write_all(data)
        except LinkLost as error:
            self.is_up = False
            self._dirty |= error.dirty
            self.write_errors += 1
            raise

    def holds_back(self, now_s: float) -> bool:
        """Whether a frame would only queue behind others: then it is not sent, and the motion goes on later.

        The port still holds the frame before, or the board's answer is late: a slow radio link may hold back bytes where no port
        tells of them. To be asked before every frame; `now_s` is wall time.

        Raises:
            LinkLost: the port has sent nothing on for `PORT_LIMIT_S`. A late answer has a limit of its own, see `attend`.
        """
        if self.transport.pending_bytes() > 0:
            self._holds_since_s = now_s if self._holds_since_s is None else self._holds_since_s
            self.congested_periods += 1
            if now_s - self._holds_since_s > PORT_LIMIT_S:
                raise self.lost(f"has sent nothing on for {PORT_LIMIT_S:g} s")
            return True
        self._holds_since_s = None
        since_s = self._unanswered_since_s
        late = self._answers and since_s is not None and now_s - since_s > LATE_ANSWER_S
        self.congested_periods += late
        return late

    def attend(self, now_s: float, energised: Sequence[bool] = ()) -> Answer | None:
        """Reads what came, asks for a sign of life when it is time, and judges silence. `now_s` is wall time.

        Gives the board's answer, if it has become complete; `energised` are the channels that have been sent a pulse. A board
        that has never answered is not missed: it is not armed either, see `require_answered`.

        Raises:
            LinkLost: the port failed, or a board that used to answer has been silent for too long.
        """
        answer = self._listen()
        if answer is not None:
            self._answered_s, self._answers = now_s, True
            self._heard.set()
            self._reply_latency.add(now_s - self._asked_s)
            self._unanswered_since_s = None
            self.battery_mv = answer.health.battery_mv
        if self._liveness_period_s is None:
            return answer
        if self._answered_s is not None and now_s - self._answered_s > self._liveness_limit_s:
            raise self.lost(f"the board has not answered for {self._liveness_limit_s:g} s")
        if now_s - self._asked_s >= self._liveness_period_s:
            self._asked_s = now_s
            self._unanswered += self._unanswered_since_s is not None
            self._questions += 1
            if self._unanswered_since_s is None:
                self._unanswered_since_s = now_s
            self._ask(energised)
        return answer

    def _ask(self, energised: Sequence[bool]) -> None:
        self._read()  # what is left over belongs to no question of ours
        if self._reply_bytes and self._reply:
            self._bad += 1
        query = self._board.encode_query(self._channels)
        self._reply.clear()
        self._reply_bytes = query.reply_bytes
        self._energised.append(tuple(energised))
        self.write(query.data)

    def _listen(self) -> Answer | None:
        """The answer to the open question, once all of it has come."""
        self._reply += self._read()
        if not self._reply_bytes:
            self._reply.clear()
            return None
        if len(self._reply) < self._reply_bytes:
            return None
        health = self._board.parse_reply(bytes(self._reply), len(self._channels))
        if health is None:
            return None
        self._reply_bytes = 0
        self._reply.clear()
        return Answer(health, tuple(map(all, zip(*self._energised, strict=False))))

    def _read(self) -> bytes:
        try:
            return self.transport.read_available()
        except LinkLost:
            self.is_up = False
            raise

    def _wait_for_answer(self) -> bool:
        deadline = time.monotonic() + _REPLY_LIMIT_S
        while time.monotonic() < deadline:
            if self._listen() is not None:
                return True
            time.sleep(0.005)
        return False


def first_answer(transport: SerialTransport, board: Board, limit_s: float = FIRST_ANSWER_LIMIT_S) -> Health | None:
    """Asks a board on an open port how it is, until it answers; None: it does not within `limit_s`. Nothing moves.

    Raises:
        LinkLost: the port failed.
    """
    first = board.quirks.channels[0]
    query = board.encode_query(range(first, first + MAX_SERVOS))
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        transport.read_available()  # what is left over belongs to no question of ours
        transport.write_all(query.data)
        reply, patience = b"", min(end, time.monotonic() + 1.0)
        while time.monotonic() < patience:
            reply += transport.read_available()
            health = board.parse_reply(reply, MAX_SERVOS) if len(reply) >= query.reply_bytes else None
            if health is not None:
                return health
            time.sleep(0.01)
    return None


def silence(port: str, board: Board, asked: bool, word: str) -> BoardSilent:
    """The error for a board that has never answered; `word` says how a person lets it be used all the same."""
    rate = f"{board.quirks.usual_baud} baud"
    why = f"switch its supply on, check that this is its port, its rate (usually {rate}) and the wire that it answers on"
    if not asked:
        why = "it is asked nothing (liveness_period_s is None)"
    elif board.quirks.always_answers:
        why += "; each of its kind answers"
    return BoardSilent(port, board.spec, why, word)
