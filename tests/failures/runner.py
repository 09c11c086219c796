# SPDX-License-Identifier: Apache-2.0
"""Runs scenarios one after the other in one lab."""

import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from tensegrity_lab.stack.ros_domain import private_domain
from tensegrity_robot.ros.discovery import set_discovery
from tests.failures.rig import Rig, scratch
from tests.failures.scenario import Evidence, Scenario
from tests.failures.table import RUNNING_ORDER, scenario


@dataclass(frozen=True)
class Outcome:
    """What came of a scenario.

    Attributes:
        scenario: which.
        evidence: what was seen; empty if it failed.
        problem: why it failed; empty if the failure was survived.
        seconds: wall time that it took.
    """

    scenario: Scenario
    evidence: Evidence
    problem: str
    seconds: float


def run(
    numbers: Collection[int],
    began: Callable[[Scenario], None] = lambda row: None,
    domain: int | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> Iterator[Outcome]:
    """Runs rows, in the order that shares most; yields what came of each.

    Args:
        numbers: of the rows to run.
        began: told each row before it runs.
        domain: of ROS; None: any that is free.
        say: told a line for people.
    """
    with private_domain(domain) as own, scratch() as folder:
        say(own.describe)
        set_discovery()  # the operator is a node of this process
        lab = Rig(Path(folder), own.number, own.locks)
        try:
            for number in RUNNING_ORDER:
                if number in numbers:
                    row = scenario(number)
                    began(row)
                    yield _run_one(lab, row)
        finally:
            lab.close()


def _run_one(lab: Rig, row: Scenario) -> Outcome:
    began_s = time.monotonic()
    evidence, problem = Evidence(), ""
    try:
        evidence = row.run(lab)
    except Exception as error:
        problem = str(error) or type(error).__name__
        lab.spoil()
    return Outcome(row, evidence, problem, time.monotonic() - began_s)
