# SPDX-License-Identifier: Apache-2.0
"""Finishes the journal of a dead session in a process of its own, with limits: whatever is in it, only that process can die of it.

`python -m hardware_bridge.recording.journal_repair JOURNAL LOG` prints one line for people; exit code 0 if the log is made.
"""

import os
import resource
import subprocess
import sys
import threading
from pathlib import Path

from hardware_bridge.errors import BridgeError, RecorderError
from hardware_bridge.recording.journal import Recording, finish_journal
from sim_core.printable import printable

MEMORY = 1 << 30
"""Address space beside the journal itself, which is mapped, in bytes."""
TOLD = 2
"""Exit code of a child that says itself why it could not; Python's own is 1."""


def mend(journal: Path, path: Path) -> str:
    """Finish a journal in a child process; what came of it, for people.

    Raises:
        RecorderError: it could not be finished; the journal stays.
        OSError: it is not there any more.
    """
    words = [sys.executable, "-m", "hardware_bridge.recording.journal_repair", str(journal), str(path)]
    limit_s = 5.0 * _cpu_s(journal.stat().st_size)
    # its standard input is held open by us alone: it ends when we do
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        try:
            code = child.wait(limit_s)
        except subprocess.TimeoutExpired:
            child.kill()
            raise RecorderError(str(path), _given_up(journal, f"it took more than {limit_s:.0f} s")) from None
        assert child.stdout is not None
        assert child.stderr is not None
        told, complaint = (stream.read(10_000).decode(errors="replace") for stream in (child.stdout, child.stderr))
    if code == 0:
        return printable(told, 1000)
    if code == TOLD:
        raise RecorderError(str(path), printable(told, 1000))
    last = complaint.strip().splitlines()[-1:] or [f"it ended with {code}"]
    raise RecorderError(str(path), _given_up(journal, printable(last[0])))


def _cpu_s(size: int) -> int:
    """Processor time for a journal of that size: many times what an honest one takes."""
    return 120 + size // 500_000


def _given_up(journal: Path, why: str) -> str:
    return f"mending was given up ({why}); the journal {journal} is kept, move it elsewhere if it is none of yours"


def told_of(recording: Recording) -> str:
    """A mended log for people."""
    text = f"mended {recording.path}: {recording.messages} messages of a session that was cut short"
    if recording.kept is None:
        return text
    return (
        f"{text}; {recording.unread_bytes} bytes in {recording.unread_places} place(s) are damaged and could not be read, "
        f"{recording.missing} messages are missing by their numbers; the journal is kept as {recording.kept}"
    )


def main(words: list[str]) -> int:
    """The child."""
    journal, path = (Path(word) for word in words)
    threading.Thread(target=_end_with_our_parent, daemon=True).start()
    os.nice(10)
    try:
        size = journal.stat().st_size
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY + size, MEMORY + size))
        resource.setrlimit(resource.RLIMIT_CPU, (_cpu_s(size), _cpu_s(size)))
        resource.setrlimit(resource.RLIMIT_FSIZE, (2 * size + (64 << 20),) * 2)
        print(told_of(finish_journal(journal, path)))
        return 0
    except (BridgeError, OSError) as error:
        print(getattr(error, "problem", error))
    except MemoryError:
        print(_given_up(journal, f"it needs more than {MEMORY >> 20} MB of memory"))
    return TOLD


def _end_with_our_parent() -> None:
    while os.read(0, 1024):  # not through a buffered stream: its lock would be held at the end
        pass
    os._exit(3)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
