# SPDX-License-Identifier: Apache-2.0
"""A recorded session as numpy arrays: which lengths were sent, which faces were seen, where the robot went."""

import sys
from pathlib import Path

import numpy as np

from hardware_bridge import read_session

EXAMPLE = Path(__file__).parents[1] / "bags" / "example"


def main(bag: str = str(EXAMPLE)) -> None:
    session = read_session(bag)
    sent = list(session.of("bridge/struts_sent"))
    time_s = 1e-9 * np.array([message.robot_time_ns for message in sent])
    lengths_m = np.array([message.length_m for message in sent])  # (n, 6): commanded, never measured
    print(f"{len(sent)} frames in {time_s[-1] - time_s[0]:.0f} s of robot time")
    print("each strut went from", 1e3 * lengths_m.min(axis=0), "to", 1e3 * lengths_m.max(axis=0), "mm")

    joints_m = np.array(
        [[(p.position.x, p.position.y, p.position.z) for p in message.poses] for message in session.of("bridge/observed_joints")]
    )  # (n, 13, 3): twelve joints and the box, as the virtual prototype's observer saw them
    middle_m = joints_m[:, :12].mean(axis=1)
    print(f"the robot moved by {1e3 * np.linalg.norm((middle_m[-1] - middle_m[0])[:2]):.0f} mm")
    faces = [message.face for message in session.of("bridge/face") if message.settled]
    print("it stood on", " → ".join(dict.fromkeys(faces)))


if __name__ == "__main__":
    main(*sys.argv[1:])
