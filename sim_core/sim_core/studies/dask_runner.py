# SPDX-License-Identifier: Apache-2.0
"""Chunks on any number of machines: the runner of a Dask cluster, beside the one of this machine.

A chunk's trials depend on the chunk alone, so they are the same on any number of workers. A chunk whose worker is lost runs again
elsewhere. `distributed` is imported only if a scheduler is named.
"""

import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from itertools import count, islice
from typing import Any

from sim_core.dynamics.jit_cache import PACKAGE, hash_of_sources
from sim_core.errors import ClusterError, SimError
from sim_core.studies.local_runner import Chunk, Reporter, Runner, Trials, jobs_in, run_chunk, run_here, silent

ANSWER_S = 10.0
WORKERS_S = 60.0
"""How long to wait for a scheduler's answer, and for its first worker."""
AHEAD = 3
"""Chunks kept at the scheduler for each thread of the cluster; more would only fill its memory."""
LEAST_AHEAD = 64
TRIES = 4
"""A chunk that the cluster gives up (Dask does when several workers in turn died with it) is sent so often in all."""
HOW = 'start workers with: eval "$(./sixstrut env)"; dask worker ADDRESS --nthreads 1 --nworkers auto'

_studies = count()


@contextmanager
def runner_of(scheduler: str | None) -> Iterator[Runner]:
    """The runner of a cluster by its scheduler's address, or, with None, of this machine.

    Raises:
        ClusterError: nothing answers there, or no worker joins.
    """
    if scheduler is None:
        yield run_here
        return
    with connected(scheduler) as client:
        yield partial(run_on, client)


@contextmanager
def connected(scheduler: str) -> Iterator[Any]:
    """A Dask client whose cluster has at least one worker. Raises ClusterError."""
    from distributed import Client
    from distributed.comm import get_address_host_port

    try:
        # a client that cannot connect leaves a traceback behind when it is collected, so see first that somebody listens
        socket.create_connection(get_address_host_port(scheduler), timeout=ANSWER_S).close()
        client = Client(scheduler, timeout=ANSWER_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise ClusterError(
            f"no Dask scheduler answers at {scheduler!r}: start one with `dask scheduler` and give the address that it prints, "
            f"tcp://HOST:8786 ({type(error).__name__})"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=WORKERS_S)
        except TimeoutError as error:
            raise ClusterError(f"the scheduler at {scheduler} has no workers after {WORKERS_S:.0f} s: {HOW}") from error
        yield client


def run_on(
    client: Any, chunks: Sequence[Chunk], report: Reporter = silent, work: Callable[[Chunk, str], Trials] | None = None
) -> list[Trials]:
    """Run chunks on a cluster by a `distributed.Client`; their trials in order. `work`: what a worker does, default `work_of`.

    Raises:
        ClusterError: a chunk that fails (naming why), or that is lost again and again.
    """
    from distributed import KilledWorker, as_completed

    study, sources, results = next(_studies), sources_hash(), dict[int, Trials]()
    total, rolls, tries = jobs_in(chunks), 0, dict.fromkeys(range(len(chunks)), 0)
    waiting, running, number_of = iter(range(len(chunks))), as_completed(loop=client.loop), dict[str, int]()

    def send(number: int) -> None:
        tries[number] += 1
        key = f"chunk-{client.id}-{study}-{number}-{tries[number]}"
        number_of[key] = number
        running.add(client.submit(work or work_of, chunks[number], sources, key=key, pure=False))

    def top_up() -> None:
        room = max(LEAST_AHEAD, AHEAD * sum(client.nthreads().values())) - len(number_of)
        for number in islice(waiting, max(room, 0)):
            send(number)

    top_up()
    for future in running:
        number = number_of.pop(future.key)
        try:
            results[number] = future.result()
        except KilledWorker as error:
            if tries[number] == TRIES:
                raise ClusterError(
                    f"chunk {number} was lost with its workers {TRIES} times over: do they have enough memory?"
                ) from error
            send(number)
            continue
        except ClusterError:
            raise
        except Exception as error:
            raise ClusterError(f"a worker cannot do chunk {number}: {type(error).__name__}: {error}; {HOW}") from error
        rolls += len(chunks[number].jobs)
        report(rolls, total)
        top_up()
    return [results[number] for number in range(len(chunks))]


def work_of(chunk: Chunk, sources: str) -> Trials:
    """What a worker does, on one of its threads. Errors become one kind, which can be sent back."""
    if sources != sources_hash():
        raise ClusterError(
            "a worker runs other sources of sim_core than this machine: bring all to the same commit and start them again"
        )
    try:
        return run_chunk(chunk, threads=1)
    except SimError as error:
        raise ClusterError(str(error)) from None


@cache
def sources_hash() -> str:
    """Identifies all of sim_core that is here, its data included: results are the same where it is."""
    return hash_of_sources(path for pattern in ("**/*.py", "**/*.yaml") for path in PACKAGE.glob(pattern))
