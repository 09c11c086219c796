# SPDX-License-Identifier: Apache-2.0
"""What keeps a test's stack from everybody else's: a ROS domain, state, bags and logs of its own."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from tensegrity_lab.stack.processes import Process, Stack
from tensegrity_lab.stack.ros_domain import free_lock


@contextmanager
def free_domain() -> Iterator[int]:
    """A domain that nobody else uses, ours while the block lasts; the environment stays as it is. Raises StackError."""
    lock, number = free_lock()
    with closing(lock):
        yield number


class IsolatedStack(Stack):
    """A stack whose logs, state, bags and ROS domain are its own. Attributes: bags: folder of its bags."""

    def __init__(self, folder: Path, domain: int, locks: Sequence[int] = ()):
        self.bags = folder / "bags"
        environ = {
            "SIXSTRUT_STATE_DIR": str(folder / "state"),
            "SIXSTRUT_BAGS": str(self.bags),
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        super().__init__(folder, *locks, environ=environ, work_folder=folder)

    def command(self, *words: str) -> Process:
        """Start a `sixstrut` command beside them."""
        return self.start(words[0], [sys.executable, "-m", "sixstrut_cli", *words])
