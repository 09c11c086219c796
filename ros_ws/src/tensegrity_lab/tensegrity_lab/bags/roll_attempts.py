# SPDX-License-Identifier: Apache-2.0
"""What gaits a bag's robot tried, and how they ended, from what was asked and what was seen."""

from typing import NamedTuple

from hardware_bridge.errors import BagError
from hardware_bridge.recording.bag_reader import Session, seconds_of


class Attempt(NamedTuple):
    """One try of a gait.

    The face before, the policy in mm, the faces seen at rest after actuation and after the return; when it was asked for (s, ROS
    time).
    """

    source: str | None
    policy: tuple[int, ...]
    actuated: str | None
    returned: str | None
    began_s: float = 0.0

    def succeeded(self, target: str) -> bool:
        """Whether the robot was seen on the target after actuation and after the return."""
        return self.actuated == self.returned == target


def attempts_of(session: Session, mid_stroke_m: float) -> list[Attempt]:
    """Every try of a bag, in order. A try is an accepted goal away from mid stroke; the next goal ends its actuation.

    Raises:
        BagError: a goal is none.
    """
    moves: list[tuple[float, tuple[int, ...]]] = []
    for message in session.of("bridge/asked"):
        lengths = dict(zip(message.joint_names, message.points[-1].positions if message.points else (), strict=False))
        try:
            policy = tuple(round(1e3 * (lengths[f"S{s}"] - mid_stroke_m)) for s in range(1, 7))
        except (KeyError, ValueError, OverflowError) as error:
            when = seconds_of(message.header.stamp)
            raise BagError(f"{session.path}: what was asked at {when:.3f} s is no lengths of S1 to S6") from error
        moves.append((seconds_of(message.header.stamp), policy))
    seen = [(seconds_of(m.header.stamp), m.face or None) for m in session.of("bridge/face") if m.settled]
    moves.sort()

    def last_before(time_s: float, since_s: float = float("-inf")) -> str | None:
        faces = [face for at, face in seen if since_s < at <= time_s]
        return faces[-1] if faces else None

    tries = []
    for number, (began, policy) in enumerate(moves):
        if not any(policy):
            continue
        returned = moves[number + 1][0] if number + 1 < len(moves) else float("inf")
        ended = moves[number + 2][0] if number + 2 < len(moves) else float("inf")
        tries.append(Attempt(last_before(began), policy, last_before(returned, began), last_before(ended, returned), began))
    return tries
