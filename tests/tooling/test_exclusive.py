# SPDX-License-Identifier: Apache-2.0
import subprocess
import sys
from pathlib import Path

import pytest

from tooling.exclusive import exclusive

ROOT = Path(__file__).resolve().parents[2]
SECOND = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from pathlib import Path
from tooling.exclusive import exclusive
with exclusive(Path(sys.argv[1])):
    print("has it", flush=True)
"""


def start_second(path: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-S", "-c", SECOND, str(path)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("removed", [False, True], ids=["kept", "removed by clean"])
def test_the_second_one_says_for_whom_it_waits_and_goes_on_after(tmp_path: Path, removed: bool):
    path = tmp_path / "state" / "lock"
    with exclusive(path):
        second = start_second(path)
        assert second.stderr is not None
        message = second.stderr.readline()
        assert "is setting up; waiting" in message
        assert second.poll() is None
        if removed:
            path.unlink()
            path.parent.rmdir()
    assert second.communicate(timeout=30)[0] == "has it\n"
    assert path.exists()


def test_the_message_names_the_process(tmp_path: Path):
    import os

    with exclusive(tmp_path / "lock"):
        second = start_second(tmp_path / "lock")
        assert second.stderr is not None
        assert f"(process {os.getpid()})" in second.stderr.readline()
    second.communicate(timeout=30)
