# SPDX-License-Identifier: Apache-2.0
"""A million byte sequences through everything that decodes bytes, and through the transport on a real pty."""

import os
import random
import time
from collections.abc import Callable, Iterator

import pytest

from hardware_bridge.boards.lsc import FrameDecoder, decode_move, decode_unload
from hardware_bridge.boards.registry import parse_board
from hardware_bridge.boards.ssc32 import LineDecoder
from hardware_bridge.errors import BridgeError, LinkLost, ObserverError
from hardware_bridge.link.board_link import Link
from hardware_bridge.link.transport import SerialTransport
from hardware_bridge.prototype_client.fault_client import check_fault
from hardware_bridge.prototype_client.observation import decode_observation
from hardware_bridge.virtual_prototype.boards.registry import emulate
from tests.hardware_bridge.helpers import Wire

pytestmark = [pytest.mark.soak, pytest.mark.timeout(1800)]

EACH = 100_000
OVER_THE_PTY = 20_000
SLOWEST_S = 1.0
CHANNELS = (1, 2, 3, 4, 5, 6)
SPECS = ("lsc", "ssc32", "maestro", "maestro:device=12:crc")


def sequences(seed: int, count: int) -> Iterator[bytes]:
    """Noise, and frames of every board with some bytes changed, lost, doubled or put in."""
    rng = random.Random(seed)
    codecs = [parse_board(spec) for spec in SPECS]
    whole = [codec.encode_move([rng.randrange(1000, 2000) for _ in CHANNELS], CHANNELS, 55, [1500.0] * 6) for codec in codecs]
    whole += [codec.encode_query(CHANNELS).data for codec in codecs]
    whole += [
        b"\x55\x55\x04\x0f\xe8\x1c",
        b"#1P1500S100T200\r",
        b'{"fault": "drop", "direction": "to_board"}\n',
        b'{"nodes_m": []}\n',
    ]
    for number in range(count):
        if number % 2:
            yield rng.randbytes(rng.randrange(64))
            continue
        data = bytearray(rng.choice(whole))
        for _ in range(rng.randrange(4)):
            at = rng.randrange(len(data) + 1)
            match rng.randrange(4):
                case 0:
                    data[at : at + 1] = rng.randbytes(1)
                case 1:
                    del data[at : at + rng.randrange(4)]
                case 2:
                    data[at:at] = data[: rng.randrange(8)]
                case 3:
                    data[at:at] = rng.randbytes(rng.randrange(4))
        yield bytes(data)


def lsc_frames() -> Callable[[bytes], object]:
    decoder = FrameDecoder()
    return lambda data: [(decode_move(frame), decode_unload(frame)) for frame in decoder.feed(data)]


def ssc32_lines() -> Callable[[bytes], object]:
    decoder = LineDecoder()
    return lambda data: list(decoder.feed(data))


def replies(spec: str) -> Callable[[], Callable[[bytes], object]]:
    codec = parse_board(spec)
    return lambda: lambda data: codec.parse_reply(data, 6)


def emulated(spec: str) -> Callable[[], Callable[[bytes], object]]:
    def make() -> Callable[[bytes], object]:
        board = emulate(spec, 115200)
        now_s = [0.0]

        def feed(data: bytes) -> None:
            board.receive(data, now_s[0])
            now_s[0] += 0.02
            board.process(now_s[0])
            board.orders.clear()

        return feed

    return make


def refusing(decode: Callable[[bytes], object], error: type[Exception]) -> Callable[[bytes], object]:
    def feed(data: bytes) -> None:
        try:
            decode(data)
        except error:
            return

    return feed


def fault_requests() -> Callable[[bytes], object]:
    import json

    return refusing(lambda data: check_fault(json.loads(data)), ValueError)


DECODERS: dict[str, Callable[[], Callable[[bytes], object]]] = {
    "LSC frames": lsc_frames,
    "SSC-32 lines": ssc32_lines,
    **{f"replies of {spec}": replies(spec) for spec in SPECS},
    **{f"emulated {spec}": emulated(spec) for spec in ("lsc", "ssc32", "maestro:device=12:crc")},
    "observations": lambda: refusing(decode_observation, ObserverError),
    "orders to fail": fault_requests,
}


@pytest.mark.parametrize("name", DECODERS)
def test_no_bytes_crash_or_hang_a_decoder(name, figure):
    feed, slowest_s, count = DECODERS[name](), 0.0, 0
    for data in sequences(len(name), EACH):
        began = time.perf_counter()
        feed(data)
        slowest_s = max(slowest_s, time.perf_counter() - began)
        count += 1
    assert slowest_s < SLOWEST_S
    figure(f"sequences through {name}, slowest [ms]", f"{count}, {slowest_s * 1e3:.1f}")


@pytest.mark.parametrize("spec", SPECS)
def test_no_answers_crash_or_hang_the_link(spec, figure):
    wire = Wire()
    link = Link(SerialTransport(wire.port, write_timeout_s=0.04), parse_board(spec), CHANNELS, 1.0, 4.0)
    link.open()
    slowest_s, lost, now_s = 0.0, 0, 0.0
    try:
        for data in sequences(len(spec), OVER_THE_PTY):
            if data:
                os.write(wire._near, data)
            now_s += 0.6
            began = time.perf_counter()
            try:
                link.attend(now_s, (True,) * 6)
            except LinkLost:
                lost += 1
                link.open()
            except BridgeError as error:
                pytest.fail(f"{error!r}")
            slowest_s = max(slowest_s, time.perf_counter() - began)
            wire.listen()
            wire.frames.clear()
    finally:
        link.close()
        wire.cut()
    assert slowest_s < SLOWEST_S
    figure(f"answers over the pty to {spec}, times lost, slowest [ms]", f"{OVER_THE_PTY}, {lost}, {slowest_s * 1e3:.1f}")
