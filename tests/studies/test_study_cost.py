# SPDX-License-Identifier: Apache-2.0
import pytest

from sim_core.studies.local_runner import Cost
from tests.studies.study_cost import Figures, table_of

FIGURES = Figures(40, Cost(robot_s=13_000.0, core_s=36.0, build_s=0.36, trials=1000), 960, 40_000, 20_000, 0.002)


def cells(table):
    return dict(line.strip("| ").split(" | ") for line in table.splitlines()[2:])


def test_a_millions_cost_follows_from_the_figures():
    said = cells(table_of(FIGURES))
    assert said["robot-seconds a trial, settling included"] == "13.0"
    assert said["core-milliseconds a robot-second"] == "2.77"
    assert said["core-hours"] == f"{960e6 * 0.036 / 3600:,.0f}" == "9,600"
    assert said["the scheduler is saturated at, cores"] == f"{960 * 0.036 / 0.002:,.0f}"
    assert float(said["hours then, which more cores do not shorten"]) == pytest.approx(1e6 * 0.002 / 3600, rel=0.01)


def test_no_time_is_promised_for_more_cores_than_the_scheduler_feeds():
    assert "hours on 1,024 cores" in table_of(FIGURES)
    assert "hours on 1,024 cores" not in table_of(FIGURES._replace(task_s=0.1))
