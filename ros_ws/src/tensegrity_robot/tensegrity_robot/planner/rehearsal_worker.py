# SPDX-License-Identifier: Apache-2.0
"""Rehearsal beside a node: an ensemble of perturbed robots in a thread of its own, so that the node's callbacks never wait."""

import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from sim_core.dynamics.model import build_model
from sim_core.gaits.cycle import Chain
from sim_core.gaits.library import Gait
from sim_core.planning.face_graph import FaceGraph
from sim_core.rolling.warm_up import Stage, is_warm, warm_up
from sim_core.structure.parameters import Prototype
from sim_core.structure.topology import NEIGHBOURS
from sim_core.studies.rehearsal import Ensemble, Rehearsed
from sim_core.uncertainty.perturbation_law import Law
from tensegrity_interfaces.msg import Rehearsal, RehearsedGait


class Rehearsing(NamedTuple):
    """A rehearsal that is over."""

    gaits: tuple[Rehearsed, ...]  # the wanted one first, then the best one to each other neighbouring face
    seconds: float  # of wall-clock time

    @property
    def wanted(self) -> Rehearsed:
        """The gait that was asked for."""
        return self.gaits[0]


class Rehearser:
    """Rehearses rolls, one after the other, on an ensemble whose members differ by `law`."""

    def __init__(self, prototype: Prototype, law: Law, members: int, seed: int):
        """Args: members: robots of the ensemble. seed: draws them. Begins to build them; raises nothing."""
        self.law = law
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="rehearsal")
        self._ensemble = self._worker.submit(_built, prototype, law, members, seed)

    def prepare(self, face: str) -> None:
        """Settle the ensemble on a face, so that a rehearsal from there is quick."""
        self._worker.submit(lambda: self._ensemble.result().prepare(face))

    def rehearse(self, wanted: Gait | Chain, graph: FaceGraph) -> Future[Rehearsing]:
        """The wanted gait, and the best one to each other neighbour of its source; or a chain alone.

        The future raises SimError if the ensemble cannot be built.
        """
        if isinstance(wanted, Chain):
            return self._worker.submit(self._run, [wanted])
        others = [graph.choices(wanted.source, face)[:1] for face in NEIGHBOURS[wanted.source] if face != wanted.target]
        return self._worker.submit(self._run, [wanted, *(choice.gait for best in others for choice in best)])

    def close(self) -> None:
        """Begin nothing more; what runs ends by itself."""
        self._worker.shutdown(wait=False, cancel_futures=True)

    def _run(self, gaits: Sequence[Gait | Chain]) -> Rehearsing:
        ensemble = self._ensemble.result()
        began = time.perf_counter()
        return Rehearsing(tuple(ensemble.rehearse(gaits)), time.perf_counter() - began)


def _built(prototype: Prototype, law: Law, members: int, seed: int) -> Ensemble:
    if not is_warm([Stage.BATCH]):
        warm_up([Stage.BATCH])  # leaves word that it is compiled, for the next process
    return Ensemble(build_model(prototype), law, members, seed)


def rehearsal_message(found: Rehearsing, law: Law) -> Rehearsal:
    """As a message; its header is left to the node."""
    return Rehearsal(
        source_face=found.wanted.gait.source,
        gaits=[_gait_message(rehearsed) for rehearsed in found.gaits],
        ensemble=law.text,
        duration_s=found.seconds,
    )


def _gait_message(rehearsed: Rehearsed) -> RehearsedGait:
    gait, rate = rehearsed.gait, rehearsed.rate
    return RehearsedGait(
        target_face=gait.target,
        primitive=gait.cycle.name if isinstance(gait, Chain) else gait.primitive.name,
        proper=isinstance(gait, Chain) or gait.proper,
        successes=rate.successes,
        members=rate.trials,
        odds=rate.value,
        low=rate.low,
        high=rate.high,
        faces=list(rehearsed.outcomes),
        counts=list(rehearsed.outcomes.values()),
    )
