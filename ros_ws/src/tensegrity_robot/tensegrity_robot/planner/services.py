# SPDX-License-Identifier: Apache-2.0
"""The planner's services `face_graph` and `rehearse`: what can be rolled, and how likely. Nothing moves."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from sim_core.errors import RollRefused, SimError
from sim_core.gaits.library import Gait, gait_of
from sim_core.planning.face_graph import Choice
from sim_core.planning.face_graph import FaceGraph as Graph
from sim_core.structure.policy import in_stages
from sim_core.structure.topology import NEIGHBOURS, require_adjacent, require_face
from tensegrity_interfaces.msg import GaitOdds
from tensegrity_interfaces.srv import FaceGraph, Rehearse
from tensegrity_robot.planner.rehearsal_worker import Rehearser
from tensegrity_robot.ros.background import elsewhere

if TYPE_CHECKING:
    from tensegrity_robot.planner.gait_planner_node import GaitPlannerNode


def wanted_gait(graph: Graph, source: str, target: str, primitive: str) -> Gait:
    """The gait of a roll. `primitive`: its name; empty: the most reliable one. Raises SimError, naming what is valid."""
    require_adjacent(source, target)
    if primitive:
        return gait_of(graph.library.primitive(primitive), source, target)
    return graph.best(source, target).gait


def serve_face_graph(node: Node, graph: Graph) -> None:
    """Offer rolls, gaits, their probabilities, and routes, for people and for other nodes."""

    def answer(request: FaceGraph.Request, response: FaceGraph.Response) -> FaceGraph.Response:
        response.library_hash = graph.library.hash
        try:
            choices, response.odds, response.message = _asked(graph, request)
        except SimError as error:
            response.message = str(error)
            return response
        response.gaits = [_message(choice) for choice in choices]
        response.success = True
        return response

    node.create_service(FaceGraph, "face_graph", answer)


def _asked(graph: Graph, request: FaceGraph.Request) -> tuple[Iterable[Choice], float, str]:
    """Choices, probability of a route, what it is. Raises SimError."""
    source, target = request.source_face, request.target_face
    for face in (source, target):
        if face:
            require_face(face)
    if source and target and target not in NEIGHBOURS[source]:
        route = graph.route(source, target)
        return route.choices, route.probability, f"route {' → '.join(route.faces)}"
    rolls = [
        (a, b) for a, targets in NEIGHBOURS.items() for b in targets if (not source or a == source) and (not target or b == target)
    ]
    found = [choice for a, b in rolls for choice in (graph.choices(a, b) if request.all_gaits else graph.choices(a, b)[:1])]
    return found, 0.0, f"{len(found)} gaits of {len(rolls)} rolls"


def _message(choice: Choice) -> GaitOdds:
    gait = choice.gait
    *via, last = in_stages(gait.policy)
    return GaitOdds(
        source_face=gait.source,
        target_face=gait.target,
        primitive=gait.primitive.name,
        proper=gait.proper,
        policy_mm=list(last),
        via_mm=list(via[0]) if via else [0] * 6,
        odds=choice.probability,
        inside_mm=float(gait.primitive.margins.get("inside_mm", math.nan)),
    )


def serve_rehearse(node: GaitPlannerNode, graph: Graph, rehearser: Rehearser | None) -> None:
    """Offer to try a roll on perturbed twins before anybody decides for it. `rehearser`: None: the planner rehearses nothing."""

    def likelihood(source: str, target: str) -> float:
        return max((choice.probability for choice in graph.choices(source, target)[:1]), default=0.0)

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
