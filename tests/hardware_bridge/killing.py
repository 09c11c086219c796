# SPDX-License-Identifier: Apache-2.0
"""A recorder in a process of its own, killed at some moment, and what is left of its log."""

import os
import random
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from hardware_bridge.recording.journal import finish_journal

_WRITER = """
import sys, threading
from pathlib import Path
from hardware_bridge.recording.recorder import Recorder
log = Recorder(Path(sys.argv[1]), lambda name: "string data\\n")
number = 0
pause = threading.Event()
while True:
    for _ in range(20):
        log.write("x", "std_msgs/msg/String", b"\\0\\1\\0\\0\\2\\0\\0\\0a\\0", number)
        number += 1
    pause.wait(0.0005)
    print(log.messages_written, flush=True)
"""


class Left(NamedTuple):
    """What is left: messages told as written before the kill, and log times as two readers give them."""

    acknowledged: int
    by_mcap: list[int]
    by_rosbags: list[int]


def kill_while_writing(folder: Path, seed: int) -> Left:
    """Starts a recorder, kills it with SIGKILL after a number of acknowledged messages that `seed` draws, recovers its log."""
    path = folder / f"{seed}.mcap"
    enough = random.Random(seed).randrange(1, 4000)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(each for each in sys.path if each)}
    with subprocess.Popen([sys.executable, "-c", _WRITER, str(path)], stdout=subprocess.PIPE, env=environment) as process:
        assert process.stdout is not None
        acknowledged = 0
        for number in _numbers(process.stdout.fileno()):
            acknowledged = number
            if acknowledged >= enough and process.poll() is None:
                process.send_signal(signal.SIGKILL)
    finish_journal(path.with_name(path.name + ".journal"), path)
    with path.open("rb") as stream:
        by_mcap = [message.log_time for _, _, message in make_reader(stream).iter_messages()]
    with Reader(path) as reader:
        by_rosbags = [time_ns for _, time_ns, _ in reader.messages()]
    return Left(acknowledged, by_mcap, by_rosbags)


def _numbers(descriptor: int) -> Iterator[int]:
    """Whole lines of a pipe as they come, the newest only, until its end."""
    rest = b""
    while True:
        assert select.select([descriptor], [], [], 30.0)[0], "the recorder says nothing"
        data = os.read(descriptor, 65536)
        if not data:
            return
        *lines, rest = (rest + data).split(b"\n")
        if lines:
            yield int(lines[-1])
