# SPDX-License-Identifier: Apache-2.0
"""Child processes that do not outlive their parent, however it dies."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

_LAUNCH = """
import ctypes, os, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGINT)
if os.getppid() != int(sys.argv[1]):
    sys.exit(1)
os.execvp(sys.argv[2], sys.argv[2:])
"""
"""Becomes the child's program, and has the kernel interrupt it when its parent dies, even by SIGKILL (PR_SET_PDEATHSIG)."""


def bound(command: Sequence[str | Path] = ()) -> list[str]:
    """A command that is interrupted when this process dies: the bridge then holds the struts and closes its bag.

    Start it in a thread that lives as long as the process: to the kernel, the thread is the parent.
    """
    return [sys.executable, "-I", "-S", "-c", _LAUNCH, str(os.getpid()), *(str(word) for word in command)]
