# SPDX-License-Identifier: Apache-2.0
"""The serial side that all emulated boards share: bytes in at the baud rate, replies and orders for the outputs out.

All times are robot time. Bytes take ten bits each, and a command acts when its last byte is in. Nothing is acknowledged.
"""

import math
from abc import ABC, abstractmethod
from collections import deque

from hardware_bridge.virtual_prototype.boards.pulse_outputs import Order, Outputs

BITS_PER_BYTE = 10


class EmulatedBoard(ABC):
    """A board as its makers describe it; each kind adds its own bytes and quirks.

    Attributes:
        spec: the board, as `boards.registry` names it.
        orders: what the outputs must do, with the robot time of each; whoever drives the outputs takes from the left.
        battery_mv: supply voltage in [mV], set by whoever models the supply.
    """

    spec: str

    def __init__(self, baud: int) -> None:
        self._byte_s = BITS_PER_BYTE / baud
        self._inbox: deque[tuple[float, int]] = deque()
        self._line_free_s = 0.0
        self._outputs = Outputs()
        self.orders: deque[tuple[float, Order]] = deque()
        self.battery_mv = 7400
        self.forget()

    @property
    def waiting_bytes(self) -> int:
        """Bytes received that are not yet in at the baud rate."""
        return len(self._inbox)

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes put on the line at robot time `now_s`, behind those already on it."""
        for byte in data:
            self._line_free_s = max(self._line_free_s, now_s) + self._byte_s
            self._inbox.append((self._line_free_s, byte))

    def process(self, now_s: float) -> bytes:
        """Takes in what has arrived until robot time `now_s`; the reply to it, often empty."""
        reply = b""
        while self._inbox and self._inbox[0][0] <= now_s:
            time_s, byte = self._inbox.popleft()
            self.pass_time(time_s)
            reply += self.take(byte, time_s)
        self.pass_time(now_s)
        return reply

    def reset(self, time_s: float) -> None:
        """The power fails for a moment: outputs off, half-received frames, bytes on the line and settings forgotten."""
        self._inbox.clear()
        self.forget()
        self.order(Order(dict.fromkeys(self._outputs.channels)), time_s)

    def order(self, order: Order, time_s: float) -> None:
        """Gives the outputs an order."""
        self._outputs.follow(order, time_s)
        self.orders.append((time_s, order))

    def commanded_us(self, channel: int, time_s: float) -> float | None:
        """What the board says of a channel: the pulse that it gives, not where the actuator is; None: no pulse."""
        pulse_us = self._outputs.pulse_us(channel, time_s)
        return None if math.isnan(pulse_us) else pulse_us

    @abstractmethod
    def take(self, byte: int, time_s: float) -> bytes:
        """One byte is in; the reply to it."""

    @abstractmethod
    def forget(self) -> None:
        """As after power-up: no half-received frame, no settings."""

    def pass_time(self, now_s: float) -> None:  # noqa: B027 - most boards do nothing by themselves
        """Whatever the board does by itself until `now_s`."""
