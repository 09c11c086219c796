# SPDX-License-Identifier: Apache-2.0
import subprocess
import sys
from pathlib import Path

import pytest

from tooling.exclusive import exclusive
from tooling.layout import SetupError

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


def test_another_users_checkout_that_is_not_ready_is_told(tmp_path: Path):
    (tmp_path / "file").touch()  # stands for a folder that is another's: to root, no folder is
    with (
        pytest.raises(SetupError, match=r"is not set up for this, .* clone it for yourself"),
        exclusive(tmp_path / "file" / "s" / "lock"),
    ):
        pass


def test_a_file_system_without_locks_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def none(*_: object) -> None:  # as a network file system without a lock daemon; to mount one needs root
        raise OSError(37, "No locks available")

    monkeypatch.setattr("fcntl.flock", none)
    with pytest.raises(SetupError, match=r"No locks available\): move the checkout"), exclusive(tmp_path / "lock"):
        pass
