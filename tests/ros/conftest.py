"""Every module of these tests gets a ROS domain, state folder and bag folder of its own, and leaves no process behind."""

from __future__ import annotations

import fcntl
import os
import random
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def domain() -> Iterator[int]:
    """A ROS domain that no other tests on this machine use now."""
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


@pytest.fixture(scope="module")
def module_processes(tmp_path_factory: pytest.TempPathFactory, domain: int):
    """Processes that live as long as the module's tests."""
    from tests.ros.processes import Processes

    processes = Processes(tmp_path_factory.mktemp("stack"), domain)
    yield processes
    processes.kill()


@pytest.fixture
def processes(tmp_path: Path, domain: int):
    """Processes of one test."""
    from tests.ros.processes import Processes

    processes = Processes(tmp_path, domain)
    yield processes
    processes.kill()


@pytest.fixture
def operator(domain: int):
    """An operator of one test."""
    from tests.ros.client import Operator

    operator = Operator(domain)
    yield operator
    operator.close()
