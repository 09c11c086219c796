# SPDX-License-Identifier: Apache-2.0
"""The console before a robot that only stands there: its real server, viser and page; what would be asked of a stack is printed.

python standing.py PORT TOKEN
"""

import sys
import threading
import time

import numpy as np

from sim_core.dynamics.model import build_model
from sim_core.dynamics.robot import Robot
from sim_core.structure.parameters import load_prototype
from tensegrity_console.web import main
from tensegrity_console.web.state import Facts

BEAT_S = 0.2
KEYS = [["y", "yes"], ["n", "no"]]
NEIGHBOURS = ("TO5", "TO7", "TO9")


def told():
    """Facts of an armed robot on TC6."""
    robot = Robot.resting_on(build_model(load_prototype()), "TC6")
    gaits = [{"target": face, "primitive": "p", "successes": 20, "members": 24, "ends": [[face, 20]]} for face in NEIGHBOURS]
    return Facts(
        joints_m=np.vstack([robot.joints_m(), robot.box_m()]),
        predicted="TC6",
        state="ARMED",
        link_ok=True,
        lengths_m=np.full(6, 0.234),
        rehearsal={"source": "TC6", "gaits": gaits},
        trial={"question": "Does it stand?", "keys": KEYS, "panel": "the-newest", "done": 0, "total": 2, "phase": ""},
    )


class Ros:
    """Knows the facts, and prints every call."""

    def __init__(self):
        self.facts = told()
        threading.Thread(target=self._live, daemon=True).start()

    def _live(self):
        while True:
            self.facts.heard = self.facts.twin_heard = time.monotonic()
            time.sleep(BEAT_S)

    def close(self):
        """See RosSide."""

    def __getattr__(self, name):
        def call(*words):
            print("ASKED", name, *[word for word in words if not callable(word)], flush=True)
            for word in words:
                if callable(word):
                    word(True, f"{name} done")

        return call


if __name__ == "__main__":
    main.RosSide = Ros
    main.serve("127.0.0.1", int(sys.argv[1]), sys.argv[2], lambda url: print("console:", url, flush=True))
