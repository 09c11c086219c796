# SPDX-License-Identifier: Apache-2.0
"""The service `rehearse`: odds of rolls before anybody decides for one. Nothing moves."""

from __future__ import annotations

import concurrent.futures
from collections.abc import Callable

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from sim_core.errors import RollRefused, SimError
from sim_core.gaits.library import Gait, gait_of
from sim_core.planning.face_graph import FaceGraph
from sim_core.structure.topology import NEIGHBOURS, require_adjacent
from tensegrity_interfaces.srv import Rehearse
from tensegrity_robot.planner.rehearsal_worker import Rehearser, Rehearsing


def wanted_gait(graph: FaceGraph, source: str, target: str, primitive: str) -> Gait:
    """The gait of a roll. `primitive`: its name; empty: the most reliable one. Raises SimError, naming what is valid."""
    require_adjacent(source, target)
    if primitive:
        return gait_of(graph.library.primitive(primitive), source, target)
    return graph.best(source, target).gait


def serve_rehearse(
    node: Node,
    graph: FaceGraph,
    rehearser: Rehearser | None,
    where: Callable[[], str],
    busy: Callable[[], bool],
    tell: Callable[[Rehearsing], object],
) -> None:
    """Offer it.

    Args:
        node: the planner's.
        graph: the gaits' graph of faces.
        rehearser: None: the planner rehearses nothing.
        where: the face known now; raises RollRefused.
        busy: a roll is running.
        tell: publishes what was found; the message.
    """

    async def answer(request: Rehearse.Request, response: Rehearse.Response) -> Rehearse.Response:
        try:
            if rehearser is None:
                raise RollRefused("this planner rehearses nothing: start it with rehearse_members above 0")
            if busy():
                raise RollRefused("a roll is running: ask again when it is over")
            source = where()
            target = request.target_face or max(NEIGHBOURS[source], key=lambda face: _best(graph, source, face))
            gait = wanted_gait(graph, source, target, request.primitive)
            found = await _awaited(rehearser.rehearse(gait, graph))
        except SimError as error:
            response.message = str(error)
            return response
        response.success, response.rehearsal = True, tell(found)
        rate = found.wanted.rate
        response.message = f"{gait.name}: {rate.successes} of {rate.trials} rehearsals succeeded"
        return response

    node.create_service(Rehearse, "rehearse", answer, callback_group=ReentrantCallbackGroup())


def _best(graph: FaceGraph, source: str, target: str) -> float:
    return max((choice.probability for choice in graph.choices(source, target)[:1]), default=0.0)


async def _awaited(running: concurrent.futures.Future[Rehearsing]) -> Rehearsing:
    """Its result, without the executor waiting; the node's tick wakes it."""
    done: Future = Future()
    running.add_done_callback(lambda _: done.set_result(None))
    await done
    return running.result()
