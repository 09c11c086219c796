# SPDX-License-Identifier: Apache-2.0
"""The service `rehearse`: probabilities of rolls before anybody decides for one. Nothing moves."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.callback_groups import ReentrantCallbackGroup

from sim_core.errors import RollRefused, SimError
from sim_core.gaits.library import Gait, gait_of
from sim_core.planning.face_graph import FaceGraph
from sim_core.structure.topology import NEIGHBOURS, require_adjacent
from tensegrity_interfaces.srv import Rehearse
from tensegrity_robot.planner.rehearsal_worker import Rehearser
from tensegrity_robot.ros.background import elsewhere

if TYPE_CHECKING:
    from tensegrity_robot.planner.gait_planner_node import GaitPlannerNode


def wanted_gait(graph: FaceGraph, source: str, target: str, primitive: str) -> Gait:
    """The gait of a roll. `primitive`: its name; empty: the most reliable one. Raises SimError, naming what is valid."""
    require_adjacent(source, target)
    if primitive:
        return gait_of(graph.library.primitive(primitive), source, target)
    return graph.best(source, target).gait


def serve_rehearse(node: GaitPlannerNode, graph: FaceGraph, rehearser: Rehearser | None) -> None:
    """Offer it. `rehearser`: None: the planner rehearses nothing."""

    def likelihood(source: str, target: str) -> float:
        return max((choice.odds for choice in graph.choices(source, target)[:1]), default=0.0)

    async def answer(request: Rehearse.Request, response: Rehearse.Response) -> Rehearse.Response:
        try:
            if rehearser is None:
                raise RollRefused("this planner rehearses nothing: start it with rehearse_members above 0")
            source = node.face_at_rest()
            target = request.target_face or max(NEIGHBOURS[source], key=lambda face: likelihood(source, face))
            gait = wanted_gait(graph, source, target, request.primitive)
            found = await elsewhere(node, rehearser.rehearse(gait, graph).result, "rehearse")
        except SimError as error:
            response.message = str(error)
            return response
        response.success, response.rehearsal = True, node.tell_rehearsal(found)
        rate = found.wanted.rate
        response.message = f"{gait.name}: {rate.successes} of {rate.trials} rehearsals succeeded"
        return response

    node.create_service(Rehearse, "rehearse", answer, callback_group=ReentrantCallbackGroup())
