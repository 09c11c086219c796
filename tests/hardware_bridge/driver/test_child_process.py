# SPDX-License-Identifier: Apache-2.0
"""No process outlives the one that started it."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil

from hardware_bridge.driver.child_process import bound
from tests.hardware_bridge.helpers import wait_for

CHILD = """
import signal, sys, time
signal.signal(signal.SIGINT, lambda *_: sys.exit(open(sys.argv[1] + ".end", "w").write("a clean end") and 0))
open(sys.argv[1], "w").write("ready")
while True:
    time.sleep(0.05)  # a signal just before signal.pause() would be slept over
"""
PARENT = """
import subprocess, sys
from hardware_bridge.driver.child_process import bound
child = subprocess.Popen(bound([sys.executable, "-c", sys.argv[1], sys.argv[2]]), start_new_session=True)
print(child.pid, flush=True)
child.wait()
"""


def test_a_child_of_a_killed_parent_is_interrupted_and_ends_as_it_wants_to(tmp_path: Path) -> None:
    ready, end = tmp_path / "child", tmp_path / "child.end"
    words = [sys.executable, "-c", PARENT, CHILD, str(ready)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = psutil.Process(int(parent.stdout.readline()))
        wait_for(ready.exists, "the child")
        parent.send_signal(signal.SIGKILL)
    psutil.wait_procs([child], 20.0)
    assert not child.is_running()
    assert end.read_text() == "a clean end"


def test_a_child_whose_parent_is_dead_already_does_not_begin(tmp_path: Path) -> None:
    words = bound([sys.executable, "-c", CHILD, str(tmp_path / "child")])
    words[words.index(str(os.getpid()))] = "1"  # as if this process had died before
    assert subprocess.run(words, check=False).returncode == 1
    assert not (tmp_path / "child").exists()
