"""Servo boards as bytes. A board is a codec (pure functions, value to bytes and back) plus its quirks.

No board reports where an actuator is; what some call a position is the pulse that was commanded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True)
class Quirks:
    """What a caller must know about a board beside its bytes.

    Attributes:
        pulse_us: Shortest and longest pulse that it accepts, in [us].
        channels: First and last channel.
        max_servos: Most servos in one move frame.
        duration_ms: Shortest and longest duration of a move, in [ms].
        first_move_ignores_duration: The first move of a channel after power-up goes at full speed.
        acknowledges: The board answers moves.
        reports_liveness: The board answers ``encode_liveness``.
        resynchronises: The board finds the start of the next frame by itself after a cut one.
        stops_by_holding: There is no command that stops a servo; the present pulses are sent again instead.
    """

    pulse_us: tuple[int, int]
    channels: tuple[int, int]
    max_servos: int
    duration_ms: tuple[int, int]
    first_move_ignores_duration: bool
    acknowledges: bool
    reports_liveness: bool
    resynchronises: bool
    stops_by_holding: bool


class ReplyDecoder(Protocol):
    """Collects a board's replies from pieces of any size."""

    def feed(self, data: bytes) -> list[int]:
        """Battery voltages, in [mV], of the replies completed by ``data``; anything else is skipped."""
        ...


class Codec(Protocol):
    """The seam between the bridge and a board."""

    @property
    def name(self) -> str:
        """The board, as configuration names it."""
        ...

    @property
    def quirks(self) -> Quirks:
        """What the bytes do not say."""
        ...

    def encode_move(self, pulses_us: Sequence[int], channels: Sequence[int], duration_ms: int) -> bytes:
        """One frame that moves ``channels[i]`` to ``pulses_us[i]``, all arriving together after ``duration_ms``.

        Raises:
            CodecError: A value that the board does not accept.
        """
        ...

    def encode_unload(self, channels: Sequence[int]) -> bytes:
        """One frame that takes the power off ``channels``: they let go."""
        ...

    def encode_liveness(self) -> bytes:
        """A query that moves nothing and that a living board answers."""
        ...

    def reply_decoder(self) -> ReplyDecoder:
        """A fresh decoder of the board's replies."""
        ...
