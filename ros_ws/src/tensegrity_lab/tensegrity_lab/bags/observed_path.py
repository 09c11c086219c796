# SPDX-License-Identifier: Apache-2.0
"""Where the robot was, as an observer saw it."""

from __future__ import annotations

import numpy as np

from hardware_bridge.recording.bag_reader import Session, seconds_of


def observed_path(session: Session, origin_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Robot times (s, from `origin_s`) and joints (n, 12, 3) as the observer saw them."""
    sent = list(session.of("bridge/struts_sent"))
    stamps = np.array([seconds_of(m.header.stamp) for m in sent])
    robot_s = np.array([m.robot_time_ns / 1e9 for m in sent])
    seen = [m for m in session.of("bridge/observed_joints") if len(m.poses) >= 12]
    times = np.interp([seconds_of(m.header.stamp) for m in seen], stamps, robot_s) - origin_s if sent and seen else np.zeros(0)
    joints = [[(p.position.x, p.position.y, p.position.z) for p in m.poses[:12]] for m in seen]
    return times, np.array(joints).reshape(-1, 12, 3)
