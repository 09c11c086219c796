# SPDX-License-Identifier: Apache-2.0
"""Every module of these tests gets a ROS domain, state folder and bag folder of its own, and leaves no process behind."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.isolated_stack import free_domain


@pytest.fixture(scope="module")
def domain() -> Iterator[int]:
    """A ROS domain that no other tests on this machine use now."""
    with free_domain() as number:
        yield number


@pytest.fixture(scope="session")
def compiled() -> None:
    """The solver is compiled: no process compiles it beside a running stack, while others wait for its answers."""
    from sim_core.rolling.warm_up import Stage, is_warm, warm_up

    stages = (Stage.ROBOT, Stage.BATCH)
    if not is_warm(stages):
        warm_up(stages)


@pytest.fixture(scope="module")
def module_processes(tmp_path_factory: pytest.TempPathFactory, domain: int, compiled: None):
    """Processes that live as long as the module's tests."""
    from tests.isolated_stack import IsolatedStack

    processes = IsolatedStack(tmp_path_factory.mktemp("stack"), domain)
    yield processes
    processes.kill()


@pytest.fixture
def processes(tmp_path: Path, domain: int, compiled: None):
    """Processes of one test."""
    from tests.isolated_stack import IsolatedStack

    processes = IsolatedStack(tmp_path, domain)
    yield processes
    processes.kill()


@pytest.fixture
def operator(domain: int):
    """An operator of one test."""
    from tests.stack_operator import Operator

    operator = Operator(domain=domain)
    yield operator
    operator.close()
