# SPDX-License-Identifier: Apache-2.0
"""A real cluster of worker processes on this machine."""

import os
import signal
import subprocess
import sys
from dataclasses import replace

import pytest

from sim_core.errors import ClusterError
from sim_core.gaits.library import load_library
from sim_core.structure.parameters import load_prototype
from sim_core.studies import dask_runner
from sim_core.studies.local_runner import run_here
from sim_core.studies.robustness import StudyPlan, chunks_of
from sim_core.uncertainty.perturbation_law import Law

SMALL = 8


@pytest.fixture(scope="module")
def chunks():
    """Six small chunks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sim_core.studies.robustness.CHUNK_JOBS", SMALL)
        return chunks_of(load_prototype(), load_library("robust").primitives[:1], StudyPlan(Law(0.2), 5, 2, one_gait=True))


@pytest.fixture(scope="module")
def here(chunks):
    return run_here(chunks)


@pytest.fixture(scope="module")
def cluster(here):
    """Two worker processes; `here` comes first so that they find everything compiled."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50) as cluster:
        yield cluster


def bits(trials):
    return [
        (t.feasible.tobytes(), t.margin_m.tobytes(), t.duration_s.tobytes(), t.peak_force_n.tobytes(), t.reason) for t in trials
    ]


def test_without_a_scheduler_work_is_done_here_and_dask_is_not_imported():
    code = (
        "import sys; from sim_core.studies.dask_runner import runner_of; from sim_core.studies.local_runner import run_here\n"
        "with runner_of(None) as run: assert run is run_here\n"
        "assert not {'dask', 'distributed'} & set(sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.slow
def test_a_lost_worker_loses_nothing_and_changes_no_bit(cluster, chunks, here):
    seen = []
    with dask_runner.connected(cluster.scheduler_address) as client:
        workers = client.run(os.getpid)

        def report(done, total):
            if not seen:  # one chunk is done; end a worker that holds others
                busy = next(address for address, keys in client.processing().items() if keys)
                os.kill(workers[busy], signal.SIGKILL)
            seen.append((done, total))

        there = dask_runner.run_on(client, chunks, report)
    assert bits(there) == bits(here)
    assert sorted(seen)[-1] == (48, 48)
    assert len(seen) == len(chunks)


def test_more_chunks_than_are_kept_ahead_come_back_in_order(cluster, chunks, here, monkeypatch):
    monkeypatch.setattr(dask_runner, "LEAST_AHEAD", 1)
    monkeypatch.setattr(dask_runner, "AHEAD", 1)
    with dask_runner.runner_of(cluster.scheduler_address) as run:
        assert bits(run(chunks)) == bits(here)


def test_a_worker_with_other_sources_is_refused(cluster, chunks, monkeypatch):
    monkeypatch.setattr(dask_runner, "sources_hash", lambda: "others")
    with dask_runner.connected(cluster.scheduler_address) as client, pytest.raises(ClusterError, match="other sources of sim_core"):
        dask_runner.run_on(client, chunks[:1])


def test_an_error_on_a_worker_comes_back_as_one_line(cluster, chunks):
    bad = replace(chunks[0], prototype=replace(chunks[0].prototype, steps_per_second=500))
    with dask_runner.connected(cluster.scheduler_address) as client, pytest.raises(ClusterError, match="is not stable"):
        dask_runner.run_on(client, [bad])


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    monkeypatch.setattr(dask_runner, "ANSWER_S", 0.2)
    with (
        pytest.raises(ClusterError, match=r"no Dask scheduler answers at 'tcp://127.0.0.1:1': start one"),
        dask_runner.runner_of("tcp://127.0.0.1:1"),
    ):
        pass
