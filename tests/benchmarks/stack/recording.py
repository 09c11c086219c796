# SPDX-License-Identifier: Apache-2.0
"""The recorder alone, fed with a real session's messages: what it takes, and what its queue does when that is exceeded."""

import time
from itertools import cycle, islice
from pathlib import Path
from typing import NamedTuple

from hardware_bridge.errors import RecorderError
from hardware_bridge.recording.bag_reader import read_bag
from hardware_bridge.recording.message_definitions import ShareSchemas
from hardware_bridge.recording.recorder import Recorder
from tensegrity_lab.stack.processes import wait_until
from tests.benchmarks.stack.metrics import Capacity, Plan

PACED = 500
"""So many messages may wait while the throughput is measured."""
WRITE_LIMIT_S = 300.0
MOST_OVERLOAD = 1_000_000


class _Raw(NamedTuple):
    topic: str
    type_name: str
    data: bytes


def measure(bag: Path, folder: Path, plan: Plan) -> Capacity:
    """Write the messages of `bag` over and over. Raises StackError, RecorderError."""
    messages = _messages(bag)
    endless = cycle(messages)
    log = _recorder(folder / "throughput.mcap")
    began, size = time.monotonic(), 0
    for number, message in enumerate(islice(endless, plan.messages)):
        size += len(message.data)
        log.write(*message, number)
        while log.waiting > PACED:
            time.sleep(0.0005)
    wait_until(lambda: log.messages_written == plan.messages, WRITE_LIMIT_S, "the recorder's last message")
    throughput_s = time.monotonic() - began
    began = time.monotonic()
    log.close()
    finish_s = time.monotonic() - began
    call_us, most_waiting, drained_s = _burst(folder / "burst.mcap", list(islice(endless, plan.burst)))
    queue, accepted, lost, recorded, fault = _overload(folder / "overload.mcap", endless)
    return Capacity(
        plan.messages,
        plan.messages / throughput_s,
        1e-6 * size / throughput_s,
        finish_s,
        plan.burst,
        call_us,
        most_waiting,
        drained_s,
        queue,
        accepted,
        lost,
        recorded,
        fault,
    )


def _messages(bag: Path) -> list[_Raw]:
    return [_Raw(message.topic, message.type_name, message.data) for message in read_bag(bag).messages]


def _recorder(path: Path) -> Recorder:
    schemas = ShareSchemas()
    return Recorder(path, schemas.schema_text, type_hash=schemas.type_hash)


def _burst(path: Path, messages: list[_Raw]) -> tuple[float, int, float]:
    """Microseconds a call took; most that waited; seconds until all were written."""
    log = _recorder(path)
    began = time.monotonic()
    for number, message in enumerate(messages):
        log.write(*message, number)
    given_s = time.monotonic() - began
    wait_until(lambda: log.messages_written == len(messages), WRITE_LIMIT_S, "the recorder's last message")
    drained_s = time.monotonic() - began
    most = log.most_waiting
    log.close()
    return 1e6 * given_s / len(messages), most, drained_s


def _overload(path: Path, endless: "cycle[_Raw]") -> tuple[int, int, int, int, str]:
    """Faster than it can write, until it says that it cannot, and ten more: size of the queue, accepted, lost, recorded, fault."""
    log = _recorder(path)
    accepted = refused = 0
    while refused < 10 and accepted < MOST_OVERLOAD:
        try:
            log.write(*next(endless), accepted)
            accepted += 1
        except RecorderError:
            refused += 1
    most, lost, fault = log.most_waiting, log.messages_lost, log.fault
    return most, accepted, lost, log.close().messages, fault
