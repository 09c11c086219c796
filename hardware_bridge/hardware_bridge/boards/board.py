# SPDX-License-Identifier: Apache-2.0
"""Servo boards as bytes. A board is a codec (pure functions, value to bytes and back) plus its quirks.

No board reports where an actuator is; what some call a position is the pulse that was commanded. No board acknowledges
a move, and on each of them the first move of a channel after power-up or release ignores its duration.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from hardware_bridge.errors import CodecError

MAX_SERVOS = 6
"""Servos of one robot, and so the most in one frame."""


@dataclass(frozen=True)
class Quirks:
    """What a caller must know about a board beside its bytes.

    Attributes:
        pulse_us: shortest and longest pulse that it accepts, in [us].
        channels: first and last channel.
        duration_ms: shortest and longest duration of a move, in [ms].
        longest_frame_bytes: of a move of six servos.
        usual_baud: a rate that the board offers and at which its frames fit the usual period.
        cancel: bytes that end a half-received frame without moving anything; empty: there are none.
        resync_queries: liveness queries that at most are needed until a cut frame is over. Read as the rest of a move, they give
            nothing that the board accepts.
        error_moves: a cut frame or other error may move the channels (to their "home"): where they are is then unknown.
        tells_pulses: the answer to a liveness query holds the commanded pulses, so a reset is noticed.
        has_timeout: the board has a serial time-out of its own; see its codec for what must be set.
        always_answers: every board of the family answers a liveness query: one that does not is not there, or set wrongly.
    """

    pulse_us: tuple[int, int]
    channels: tuple[int, int]
    duration_ms: tuple[int, int]
    longest_frame_bytes: int
    usual_baud: int
    cancel: bytes
    resync_queries: int
    error_moves: bool
    tells_pulses: bool
    has_timeout: bool
    always_answers: bool


class Query(NamedTuple):
    """A question that moves nothing: its bytes, and the exact length of the answer."""

    data: bytes
    reply_bytes: int


@dataclass(frozen=True)
class Health:
    """A board's answer to a liveness query.

    Attributes:
        battery_mv: supply voltage in [mV]; None: the board does not say.
        errors: names of the errors that it has latched since the last query.
        pulses_us: commanded pulse in [us] of each channel asked; None where it gives none (never moved, released, or forgotten by a
            reset). Empty: the board does not say.
    """

    battery_mv: int | None = None
    errors: tuple[str, ...] = ()
    pulses_us: tuple[float | None, ...] = ()


def check_range(field: str, value: int, valid: tuple[int, int]) -> None:
    """Raises CodecError unless `value` is an integer within `valid`, both ends included."""
    if isinstance(value, bool) or not isinstance(value, int) or not valid[0] <= value <= valid[1]:
        raise CodecError(field, value, f"an integer from {valid[0]} to {valid[1]}")


def check_channels(channels: Sequence[int], quirks: Quirks) -> None:
    """Raises CodecError unless there are one to six channels of the board, each once."""
    if not 1 <= len(channels) <= MAX_SERVOS:
        raise CodecError("number of servos", len(channels), f"1 to {MAX_SERVOS}")
    for channel in channels:
        check_range("channel", channel, quirks.channels)
    if len(set(channels)) != len(channels):
        raise CodecError("channels", list(channels), "each channel once")


def check_pulses(pulses_us: Sequence[int], channels: Sequence[int], quirks: Quirks) -> None:
    """Raises CodecError unless there is one pulse that the board accepts for each of one to six channels."""
    if len(channels) != len(pulses_us):
        raise CodecError("number of servos", f"{len(channels)} with {len(pulses_us)} pulses", f"1 to {MAX_SERVOS}")
    check_channels(channels, quirks)
    for channel, pulse_us in zip(channels, pulses_us, strict=True):
        check_range(f"pulse_us of channel {channel}", pulse_us, quirks.pulse_us)


class Board(ABC):
    """The seam between the bridge and a board. All methods are pure.

    What stands here is of a board that is told how long a move lasts and knows itself where its outputs are.

    Attributes:
        name: the board, as calibration files name it.
    """

    name: str

    @property
    @abstractmethod
    def quirks(self) -> Quirks:
        """What the bytes do not say."""

    @property
    def spec(self) -> str:
        """The board with its variant, as the parameter `board` names it (see `registry`)."""
        return self.name

    def encode_move(
        self, pulses_us: Sequence[int], channels: Sequence[int], duration_ms: int, from_us: Sequence[float] = ()
    ) -> bytes:
        """One frame that moves `channels[i]` to `pulses_us[i]`, all arriving together after `duration_ms`.

        Args:
            pulses_us: target of each output, in [us].
            channels: the board's outputs, in the same order.
            duration_ms: how long the whole move takes, in [ms].
            from_us: where each output is believed to be, in [us]; needed by a board that knows speeds only.

        Raises:
            CodecError: a value that the board does not accept.
        """
        check_pulses(pulses_us, channels, self.quirks)
        check_range("duration_ms", duration_ms, self.quirks.duration_ms)
        return self.frame(dict(zip(channels, pulses_us, strict=True)), duration_ms, from_us)

    @abstractmethod
    def frame(self, pulses_us: Mapping[int, int], duration_ms: int, from_us: Sequence[float]) -> bytes:
        """The bytes of a move whose values have been checked: channel -> pulse in [us]."""

    def encode_hold(self, pulses_us: Sequence[int], channels: Sequence[int], duration_ms: int) -> bytes:
        """One frame that sends `channels` to where they are by now, so that nothing goes on.

        This is how every board is stopped. LSC and Maestro have no command that stops a servo; the SSC-32 has one, but
        it leaves the servo at a pulse that nobody has recorded. It lasts as long as a move: were the board not where it is
        believed to be, it would not be made good in a jump.

        Raises:
            CodecError: as `encode_move`.
        """
        return self.encode_move(pulses_us, channels, duration_ms)

    def move_time_s(self, way_us: float, duration_ms: int) -> float:
        """How long in [s] a channel really takes for a way in [us] of a move that is told to last `duration_ms`."""
        return duration_ms * 1e-3

    @abstractmethod
    def encode_query(self, channels: Sequence[int]) -> Query:
        """The liveness query: a living board answers it, and it moves nothing."""

    @abstractmethod
    def parse_reply(self, reply: bytes, count: int) -> Health | None:
        """What the bytes that came since a query about `count` channels say; None if they are no sound answer."""
