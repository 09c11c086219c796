# SPDX-License-Identifier: Apache-2.0
"""A virtual prototype to practise on, in a process of its own."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType

from hardware_bridge.driver.child_process import bound
from hardware_bridge.errors import PrototypeError
from hardware_bridge.prototype_client.handshake import read_handshake
from sim_core.files.places import temporary_parent

START_LIMIT_S = 180.0
"""The first time on a machine its kernels are compiled."""


@contextmanager
def practice_prototype(
    time_scale: float = 1.0, board: str = "lsc", more: Mapping[str, object] = MappingProxyType({})
) -> Iterator[Path]:
    """A virtual prototype of its own, until the end of the block.

    Args:
        time_scale: robot seconds per second.
        board: the servo board it emulates, as `parse_board` takes it.
        more: of its options, without dashes.

    Yields:
        its port, alone in a folder that goes with it: a good place for the records of a robot that will be gone as well.

    Raises:
        PrototypeError: it does not start.
    """
    with tempfile.TemporaryDirectory(prefix="sixstrut-practice-", dir=temporary_parent()) as folder:
        link = Path(folder) / "prototype"
        words = ["-m", "hardware_bridge.virtual_prototype", "--link", str(link), "--board", board]
        words += ["--time-scale", f"{time_scale:g}"]
        words += [word for name, value in more.items() for word in (f"--{name}", str(value))]
        complaint = Path(folder) / "stderr"
        with complaint.open("wb") as errors:
            child = subprocess.Popen(
                bound([sys.executable, *words]), stdout=subprocess.DEVNULL, stderr=errors, start_new_session=True
            )
        try:
            end = time.monotonic() + START_LIMIT_S
            while (shake := read_handshake(str(link))) is None or shake.pid != child.pid:
                if child.poll() is not None or time.monotonic() > end:
                    said = complaint.read_text(errors="replace").strip() or "run ./sixstrut setup, then try again"
                    raise PrototypeError(str(link), f"it does not start: {said.splitlines()[-1]}")
                time.sleep(0.02)
            yield link
        finally:
            child.terminate()
            child.wait()
