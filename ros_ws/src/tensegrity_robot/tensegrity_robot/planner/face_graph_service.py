# SPDX-License-Identifier: Apache-2.0
"""The service `face_graph`: the planner's rolls, gaits, odds and routes, for people and for other nodes."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rclpy.node import Node

from sim_core.errors import SimError
from sim_core.planning.face_graph import Choice
from sim_core.planning.face_graph import FaceGraph as Graph
from sim_core.structure.topology import NEIGHBOURS, require_face
from tensegrity_interfaces.msg import GaitOdds
from tensegrity_interfaces.srv import FaceGraph


def serve_face_graph(node: Node, graph: Graph) -> None:
    """Offer the graph under `face_graph`."""

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
    """Choices, odds of a route, what it is. Raises SimError."""
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
    return GaitOdds(
        source_face=gait.source,
        target_face=gait.target,
        primitive=gait.primitive.name,
        proper=gait.proper,
        policy_mm=list(gait.policy),
        odds=choice.probability,
        inside_mm=float(gait.primitive.margins.get("inside_mm", math.nan)),
    )
