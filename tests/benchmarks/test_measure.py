# SPDX-License-Identifier: Apache-2.0
"""What the benchmark compares, and what it prints, without MuJoCo and without a clock."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from sim_core.dynamics.robot import Robot
from sim_core.structure.parameters import load_prototype
from sim_core.structure.policy import lengths_of
from sim_core.structure.topology import FACES
from tests.benchmarks.solver import measure, report
from tests.benchmarks.solver.engines import Moment, SixStrut
from tests.benchmarks.solver.equilibrium import Rest


@pytest.fixture(scope="module")
def prototype():
    return load_prototype()


def test_the_same_seed_gives_the_same_policies(prototype):
    first, again, other = (measure.tasks_of(prototype, 20, seed) for seed in (1, 1, 2))
    assert first == again != other
    assert all(task.source in FACES for task in first)


def test_a_crowd_steps_the_same_robots_as_one_alone(prototype):
    engine = SixStrut(prototype)
    tasks = measure.tasks_of(prototype, 3, 1)
    moments = [Moment(task, 0.05) for task in tasks]
    crowd = engine.crowd(moments, 11, 0.02, 2)
    crowd.reset()
    crowd.run()
    for number in (0, 1, 2, 9, 10):
        task = moments[number % 3].task
        robot = Robot.resting_on(engine.model, task.source)
        robot.set_targets(lengths_of(prototype, task.policy))
        robot.advance(round(0.07 / engine.step_s))
        assert crowd._state[number // 8, :, number % 8].tobytes() == robot.rows()[0].tobytes()


def roll(face, travel, reason=""):
    return SimpleNamespace(source="TC1", returned=None, actuated=SimpleNamespace(face=face), travel_m=travel, reason=reason)


def test_rolls_are_compared_by_final_face_and_end_position():
    engine = SimpleNamespace(name="a", step_s=0.001)
    late = "not settled within 15 s after actuation"
    rolls = [roll("TC1", (0.0, 0.0)), roll("TC1", (0.0, 0.001)), roll(None, (0.0, 0.0), late), roll("TO1", (0.003, 0.0))]
    others = [roll("TC1", (0.0, 0.0))] * 4
    found = measure.compared(engine, rolls, engine, others)
    assert (found.same_face, found.settled, found.policies, found.rolled) == (0.5, 0.75, 4, 2)
    assert found.median_mm == pytest.approx(0.5)


def test_the_report_holds_every_figure_and_draws(tmp_path):
    speeds = [
        measure.Speed(engine, step, robots, threads, cost)
        for threads in (1, 2)
        for robots in (1, 8)
        for engine, step, cost in (("sixstrut", 1 / 3000, 0.5), ("MuJoCo", 0.002, 30.0))
        if robots >= threads
    ]
    accuracies = [measure.Accuracy(s.engine, s.step_s, s.engine, s.step_s / 4, 8, 5, 1.0, 0.25, 0.5, 1.0) for s in speeds[:2]]
    machine = report.Machine("a processor", 2, "3.12", "0.6", "4.0", (0.1, 1.0))
    memory = measure.Memory("sixstrut", 4, 100.0, 110.0, 110.0, 10.2, 0.0)
    judged = measure.Judged(64, 2, 50.0, 500.0)
    plan = measure.Plan(counts=(1, 8))
    rehearsal = measure.Rehearsal(24, 2, 4, 0.123)
    rests = [Rest("TC6", (0.1, 0.101), (8.0, 8.0), (31.0, 31.31), 0.02, 0.01)]
    result = report.Report(machine, plan, "abc", speeds, judged, rehearsal, rests, accuracies, [memory])
    text = report.as_markdown(result, "images/x.png")
    assert "| MuJoCo, 2 ms | 8 | 30.00 | 67 | 10.0 |" in text
    assert "| sixstrut, 0.333 ms | sixstrut, 0.0833 ms | 8 | 5 | 100 % | 0.25 | 0.50 | 100 % |" in text
    assert "24 perturbed robots, settled before, on 2 threads: 0.12 s" in text
    assert "| TC6 | 0.1 / 0.101 (1.00 %) | 8 / 8 (0.00 %) | 31 / 31.31 (1.00 %) | 2.0 % | 1.0 % |" in text
    assert json.loads(report.as_json(result))["speeds"][0]["robot_seconds_per_s"] == pytest.approx(667, abs=1)
    report.draw(result, tmp_path / "images" / "x.png")
    assert (tmp_path / "images" / "x.png").stat().st_size > 10_000


def test_the_fastest_of_the_rounds_counts_and_engines_take_turns(prototype):
    order = []

    class Fake:
        def __init__(self, name):
            self.name, self.step_s = name, 0.01

        def crowd(self, moments, count, span_s, threads):
            return SimpleNamespace(reset=lambda: None, run=lambda: order.append((self.name, count, threads)))

    plan = measure.Plan(threads=(1, 2), counts=(8,), rounds=3)
    found = measure.speeds(
        [Fake("a"), Fake("b")], [Moment(t, 0.0) for t in measure.tasks_of(prototype, 8, 1)], plan, lambda _: None
    )
    assert [(s.engine, s.robots, s.threads) for s in found] == [("a", 8, 1), ("b", 8, 1), ("a", 8, 2), ("b", 8, 2)]
    assert [entry[0] for entry in order if entry[2] == 2] == ["a", "b"] * 3
    assert np.isfinite([s.us_per_robot_step for s in found]).all()
