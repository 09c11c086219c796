"""A ROS domain that nobody else on this machine tests in now."""

from __future__ import annotations

import fcntl
import os
import random
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def free_domain() -> Iterator[int]:
    """A domain from 1 to 100, ours while the block lasts. Raises RuntimeError: every one is in use."""
    for number in random.SystemRandom().sample(range(1, 101), 100):
        lock = Path(tempfile.gettempdir()) / f"sixstrut-test-domain-{os.getuid()}-{number}.lock"
        with lock.open("w") as handle:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield number
            return
    raise RuntimeError("every ROS domain from 1 to 100 is in use by tests")
