# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.errors import ModelError
from sim_core.gaits.library import load_library
from sim_core.rolling.batch import Batch, Job, roll_many
from sim_core.rolling.roll import roll
from sim_core.uncertainty.perturbation_law import perturb


@pytest.fixture(scope="module")
def robots(model):
    return [model, perturb(model, 0.1, 1), perturb(model, 0.1, 2)]


@pytest.fixture(scope="module")
def jobs(model):
    """Good rolls, bad rolls and a wild one, in an order in which lanes end at different times."""
    library, rng = load_library("robust"), np.random.default_rng(5)
    good = [
        Job(i % 3, s, library.gaits(s, t)[0].policy, t) for i, (s, t) in enumerate([("TC6", "TO5"), ("TO1", "TC2"), ("TC8", "TO7")])
    ]
    wild = [Job(i % 3, ("TC6", "TO5")[i % 2], tuple(rng.integers(-45, 46, 6).tolist())) for i in range(7)]
    staged = Job(1, "TC6", good[0].policy + tuple(stroke // 2 for stroke in good[0].policy), "TO5")
    return [*good, *wild, staged, Job(0, "TC1", (0,) * 6, "TO1")]


def test_a_roll_in_a_lane_is_the_roll_alone_to_the_last_bit(robots, jobs):
    for job, result in zip(jobs, roll_many(robots, jobs), strict=True):
        alone = roll(robots[job.model], job.source, job.target, job.policy)
        assert repr(result) == repr(alone)


def test_results_do_not_depend_on_threads_order_or_neighbours(robots, jobs):
    reference = roll_many(robots, jobs, threads=1)
    assert repr(roll_many(robots, jobs * 3, threads=2)) == repr(reference * 3)
    assert repr(roll_many(robots, jobs[::-1], threads=1)[::-1]) == repr(reference)
    assert repr(roll_many(robots, jobs[:1])) == repr(reference[:1])


def test_a_robot_that_diverges_is_reported_and_spoils_no_neighbour(model, jobs):
    """A model with a spring far beyond the step's limit, past the guard on purpose: its lane must blow up alone."""
    e = model.elements
    wild = replace(model, par=broken_rows(model), elements=e)
    fine = roll_many([model], [Job(0, "TC6", jobs[0].policy, "TO5")])
    batch = Batch([model, wild])
    batch._starts[1, "TC6"] = np.concatenate(Robot.resting_on(model, "TC6").rows())
    mixed = batch.run([Job(0, "TC6", jobs[0].policy, "TO5"), Job(1, "TC6", jobs[0].policy, "TO5")] * 3)
    assert [r.reason for r in mixed[1::2]] == ["the simulation diverged"] * 3
    assert repr(mixed[::2]) == repr(fine * 3)


def broken_rows(model):
    par = model.par.copy()
    par[model.layout.par_cables] *= 1e8
    return par


def test_robots_that_do_not_fit_together_are_refused(model):
    other = build_model(replace(model.prototype, steps_per_second=4000))
    with pytest.raises(ModelError, match="model 1 of the batch differs from model 0"):
        Batch([model, other])
    with pytest.raises(ModelError, match="at least one"):
        Batch([])


def test_progress_is_reported_to_the_end(robots, jobs):
    seen = []
    Batch(robots).run(jobs * 4, lambda done, total: seen.append((done, total)))
    assert seen[-1] == (len(jobs) * 4, len(jobs) * 4)
