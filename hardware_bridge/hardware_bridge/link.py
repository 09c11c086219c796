"""The open port with its board: writes frames, listens to replies, and says when either is gone."""

from __future__ import annotations

import time

from hardware_bridge.codecs import Codec
from hardware_bridge.errors import LinkLost
from hardware_bridge.transport import SerialTransport

_LONGEST_FRAME_BYTES = 25
_RESYNCHRONISE_TRIES = 26
"""Queries that fill the longest frame of any length that a stray byte can announce (0x65 + 2 bytes)."""
_REPLY_LIMIT_S = 0.1


class Link:
    """Not for several threads at once; the bridge's lock sees to that.

    A failed link stays down until it is opened again. After a cut frame the stream is dirty: see ``resynchronise``.

    Attributes:
        battery_mv: Last supply voltage that the board told, in [mV].
        write_errors: Failed or partial writes.
    """

    def __init__(
        self,
        transport: SerialTransport,
        codec: Codec,
        liveness_period_s: float | None,
        liveness_limit_s: float,
    ) -> None:
        self._transport = transport
        self._codec = codec
        self._liveness_period_s = liveness_period_s if codec.quirks.reports_liveness else None
        self._liveness_limit_s = liveness_limit_s
        self._up = False
        self._decoder = codec.reply_decoder()
        self._asked_s = -float("inf")
        self._answered_s: float | None = None
        self._answers = False
        self._dirty = False
        self.battery_mv: int | None = None
        self.write_errors = 0

    @property
    def is_up(self) -> bool:
        """Whether the port is open and nothing has failed since."""
        return self._up

    def open(self) -> None:
        """Opens the port afresh. Raises what the transport raises."""
        self.close()
        self._transport.open()
        self._decoder = self._codec.reply_decoder()
        self._asked_s = -float("inf")
        self._answered_s = None
        self.battery_mv = None
        self._up = True

    def resynchronise(self) -> None:
        """Makes a board that may hold half a frame ready for the next one; does nothing on a clean stream.

        Sends queries, which move nothing, until the board answers or the longest frame must be complete. Read as the rest
        of a move, a query's bytes give pulses and channels that no board accepts.

        Raises:
            LinkLost: A board that used to answer does not; the link is down.
        """
        if not self._dirty:
            return
        for _ in range(_RESYNCHRONISE_TRIES):
            self.write(self._codec.encode_liveness())
            if self._answers and self._wait_for_reply():
                self._dirty = False
                return
        if self._answers:
            remedy = "switch the servo supply off and on, then reset"
            self._up = False
            raise LinkLost(self._transport.port, "does not answer after a cut frame", remedy, dirty=True)
        self._dirty = False

    def _wait_for_reply(self) -> bool:
        deadline = time.monotonic() + _REPLY_LIMIT_S
        while time.monotonic() < deadline:
            if self._decoder.feed(self._transport.read_available()):
                return True
            time.sleep(0.005)
        return False

    def close(self) -> None:
        """Closes the port."""
        self._up = False
        self._transport.close()

    def down(self) -> None:
        """Nothing more is written or read."""
        self._up = False

    def lost(self, problem: str) -> LinkLost:
        """Takes the link down and makes the error that says so."""
        self._up = False
        return LinkLost(self._transport.port, problem, "check power and link, then reset")

    def write(self, data: bytes) -> None:
        """Writes all, or takes the link down and raises :class:`LinkLost`."""
        try:
            self._transport.write_all(data)
        except LinkLost as error:
            self._up = False
            self._dirty |= error.dirty
            self.write_errors += 1
            raise

    def is_congested(self) -> bool:
        """Whether more than a frame is still waiting in the port."""
        return self._transport.pending_bytes() > _LONGEST_FRAME_BYTES

    def attend(self, now_s: float) -> None:
        """Reads replies, asks for a sign of life when it is time, and judges silence. ``now_s`` is wall time.

        A board that has never answered is not missed: not every one of the family does.
        """
        try:
            replies = self._decoder.feed(self._transport.read_available())
        except LinkLost:
            self._up = False
            raise
        if replies:
            self.battery_mv = replies[-1]
            self._answered_s, self._answers = now_s, True
        if self._liveness_period_s is None:
            return
        if self._answered_s is not None and now_s - self._answered_s > self._liveness_limit_s:
            raise self.lost(f"the board has not answered for {self._liveness_limit_s:g} s")
        if now_s - self._asked_s >= self._liveness_period_s:
            self._asked_s = now_s
            self.write(self._codec.encode_liveness())
