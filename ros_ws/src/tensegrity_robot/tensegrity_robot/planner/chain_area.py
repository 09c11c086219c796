# SPDX-License-Identifier: Apache-2.0
"""Chains stay in the planner's keep-in area: they are refused if they would lead out, and end at its edge."""

import numpy as np
from geometry_msgs.msg import Point32, PolygonStamped
from rclpy.node import Node
from std_msgs.msg import Header

from sim_core.dynamics.model import build_model
from sim_core.errors import RollRefused
from sim_core.gaits.cycle import Chain
from sim_core.gaits.roll_sequence import Move, RollSequence, View
from sim_core.planning.floor_planner import NO_SHIFT, Floor, chain_shifts
from sim_core.planning.keep_in import parsed_keep_in
from sim_core.structure.parameters import Prototype
from tensegrity_robot.planner.told_joints import ToldJoints
from tensegrity_robot.ros import topics
from tensegrity_robot.ros.conversions import frame_prefix


class ChainArea:
    """The area of a node, which it also tells whoever listens; without one everything is inside."""

    def __init__(self, node: Node, text: str, prototype: Prototype):
        """Args: text: see `parsed_keep_in`. Raises ParameterError."""
        self._area = parsed_keep_in(text)
        self._floor = Floor(build_model(prototype)) if self._area is not None else None
        self._rolling = NO_SHIFT
        self._joints = ToldJoints(node)
        topics.TWIN_JOINTS.subscribe(node, self._joints.predict)
        topics.OBSERVED_JOINTS.subscribe(node, self._joints.see)
        topics.FACE_ESTIMATE.subscribe(node, self._joints.feel)
        self._told = topics.KEEP_IN.publisher(node)
        message = PolygonStamped(header=Header(stamp=node.get_clock().now().to_msg(), frame_id=frame_prefix(node) + "odom"))
        corners = self._area.corners_m if self._area is not None else np.zeros((0, 2))
        message.polygon.points = [Point32(x=float(x), y=float(y)) for x, y in corners]
        self._told.publish(message)

    def require_inside(self, chain: Chain, watched: bool) -> None:
        """Raises RollRefused: the chain would leave the area, or nobody tells where the robot is. `watched`: somebody sees it."""
        if self._area is None or self._floor is None:
            return
        joints = self._joints.newest(watched)
        if joints is None:
            raise RollRefused(
                "keep_in is set and nobody tells where the robot is: start the twin or an observer, or roll face by face"
            )
        if self._area.outside_m(joints) > 0.0:
            raise RollRefused("the robot is not inside of the keep-in area (keep_in): roll it in face by face")
        shifts = chain_shifts(chain.cycle, chain.faces)
        self._rolling = shifts[-1]
        out = self._area.leads_out(self._floor, self._floor.stance(chain.source, joints), chain.faces[1:], shifts)
        if out:
            raise RollRefused(
                f"on {out} of these faces the robot would leave the keep-in area (keep_in): roll a shorter chain, or turn"
            )

    def watch(self, sequence: RollSequence, view: View) -> Move | None:
        """A chain that goes on ends on a TC whose next rolls lead out; at once where the robot is out: the move to make then."""
        coming = sequence.coming
        if self._area is None or self._floor is None or not coming:
            return None
        joints = self._joints.newest(view.observer)
        if joints is None or self._area.outside_m(joints) > 0.0:
            why = "nobody tells where the robot is" if joints is None else "the robot came out of the keep-in area (keep_in)"
            return sequence.give_up(f"ended on the way to {coming[0]}: {why}", missed=False)
        known = view.observed if view.observer else view.predicted
        if known is not None and known.face == coming[0] and coming[0].startswith("TC"):
            stance, on = self._floor.stance(coming[0], joints), coming[1:3]
            out = self._area.leads_out(self._floor, stance, on, [self._rolling for _ in on])
            if out:
                sequence.end_early(f"on {out} it would leave the keep-in area (keep_in)")
        return None
