# SPDX-License-Identifier: Apache-2.0
"""Other people on the same machine, for tests that only root can make: processes of a user who is not us."""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

NOBODY = 65534
# imported first: the interpreter's own library need not be readable for the other user
_BECOME = f"""
import fcntl, json, os, pty, select, socket, stat, sys, termios, time, tty
os.setgroups([])
os.setgid({NOBODY})
os.setuid({NOBODY})
os.umask(0)
"""
_LIVE = """
print(flush=True)
sys.stdin.read()
"""
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user for a while")


@contextmanager
def shared_folder() -> Iterator[Path]:
    """A folder like /tmp: everybody may put things into it. Its path is short, because sockets are in it."""
    folder = Path(tempfile.mkdtemp(prefix="s6-"))
    folder.chmod(0o1777)
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


@contextmanager
def stranger(script: str, *words: str) -> Iterator[str]:
    """Python code that another user runs: what it printed first. It lives until the end of the block."""
    child = subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", f"{_BECOME}\n{script}\n{_LIVE}", *words],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd="/",
    )  # fmt: skip
    assert child.stdin is not None
    assert child.stdout is not None
    try:
        yield child.stdout.readline().strip()
    finally:
        child.stdin.close()
        child.wait()
        child.stdout.close()
