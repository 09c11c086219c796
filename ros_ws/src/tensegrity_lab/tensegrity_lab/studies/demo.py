# SPDX-License-Identifier: Apache-2.0
"""The demo: starts the virtual prototype and the nodes, arms, rolls, reports, and leaves a bag and a picture."""

import random
import signal
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rich.console import Console

from hardware_bridge.recording.bag_on_disk import file_of
from hardware_bridge.recording.bag_reader import read_session
from hardware_bridge.recording.bag_types import TOPICS
from sim_core.files.places import seen_from_here
from sim_core.structure.parameters import load_prototype
from sim_core.structure.policy import neutral_lengths
from sim_core.structure.symmetry import GROUP, carrier
from tensegrity_lab.bags.replay import replay
from tensegrity_lab.errors import StackError
from tensegrity_lab.reports.figure import session_picture
from tensegrity_lab.stack.processes import Stack
from tensegrity_lab.stack.simulation_lag import busy_text
from tensegrity_lab.stack.virtual_stack import VirtualRobot, recorded_bag, running
from tensegrity_lab.studies.demo_route import next_face, walk
from tensegrity_lab.terminal.leaving import uninterrupted

ROLL_RUNS_S = 10.0
"""Robot time that a strut runs in a roll, at most: 45 mm there and back."""
LONGEST_REST_S = 700.0
"""Robot time after which the bridge's duty window is past."""
ROLL_LIMIT_S = 90.0
"""Robot time that one roll may take, both motions and both settlings."""
MISSES_ALLOWED = 3
CONSOLE_LIMIT_S = 60.0


class Demo:
    """A number of rolls of a virtual robot."""

    def __init__(self, rolls: int, robot: VirtualRobot, console: bool = False, domain: int | None = None):
        """Args: console: also in the browser. domain: of ROS; None: any that is free."""
        self._wanted, self._robot, self._browser, self._domain = rolls, robot, console, domain
        self._console = Console(highlight=False, soft_wrap=not sys.stdout.isatty())  # at a terminal lines break between words
        self._done = self._tries = self._mirrors = 0

    def run(self) -> int:
        """Returns 0 if every roll asked for succeeded, or if the user stopped it; 1 if not. Raises StackError at the end."""
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        show, stopped, stack = self._console.print, False, None
        trouble: StackError | None = None
        try:
            with ExitStack() as ending:
                self._robot.require()
                self._robot.compile()
                with self._console.status("starting the virtual prototype, bridge, planner and twin"):
                    stack, handshake = ending.enter_context(running(self._robot, "demo", show, self._domain, None))
                if self._browser:
                    self._open_console(stack)
                self._operate(stack, handshake.instance)
        except KeyboardInterrupt:
            stopped = True
        except StackError as error:
            if stack is None:
                raise
            trouble = error
        failed = {} if stack is None else {name: code for name, code in stack.codes.items() if code != 0}
        show("")
        for name, code in failed.items():
            show(f"warning: {name} ended with exit code {code}; its log is in {self._robot.bags / 'logs'}")
        self._summary(stopped, None if stack is None else recorded_bag(stack))
        if trouble is not None:
            raise trouble
        return 0 if not failed and (stopped or self._done >= self._wanted) else 1

    def _open_console(self, stack: Stack) -> None:
        """Start a console before the stack, and say where it is."""
        console = stack.start("console", [sys.executable, "-m", "sixstrut_cli", "console", "--port", "0"])
        with self._console.status("starting the console"):
            console.says("console: ", CONSOLE_LIMIT_S)
        line = next(line for line in console.output.splitlines() if line.startswith("console: "))
        self._console.print(line.partition("   ")[0])

    def _operate(self, stack: Stack, prototype: str) -> None:
        from tensegrity_lab.stack.client import StackClient  # rclpy: only once the processes are on their way

        operator = StackClient(stack, prototype, events=True)
        try:
            with self._console.status("waiting for bridge, planner and twin to find each other"):
                operator.watch_joints()
                operator.wait_for_stack()
            self._arm(operator, neutral_lengths(load_prototype()).tolist())
            self._console.print(f"armed; standing on {operator.observed.face} ({operator.observed.source})\n")
            self._rolls(operator)
            operator.disarm()
        finally:
            with uninterrupted():
                operator.close()

    def _arm(self, operator: Any, lengths_m: list[float]) -> None:
        with self._console.status("arming: the struts are energised one by one, then go to mid stroke"):
            operator.arm(lengths_m)

    def _standing(self, operator: Any) -> str:
        """The face that the robot rests on, armed; empty: none. Where it was seen before it was last moved says nothing."""
        if operator.bridge.state != operator.bridge.ARMED:
            self._console.print(f"      arming again: {operator.bridge.reason}")
            self._arm(operator, [])
        with self._console.status("waiting for rest"):
            operator.wait(operator.rests, "rest, as the observer sees it,", 30.0 + ROLL_LIMIT_S / self._robot.time_scale)
        operator.sent.clear()  # what was needed of it is known
        return str(operator.observed.face)

    def _rolls(self, operator: Any) -> None:
        header = f"{'roll':>4}  {'gait':<22} {'predicted':<10} {'observed':<10} {'robot time':>10}   twin to prototype (mean, max)"
        self._console.print(header)
        route, used = walk(self._robot.face, self._wanted, self._robot.seed), set[int]()
        rng, before = random.Random(self._robot.seed), None
        misses = 0
        while self._done < self._wanted and misses < MISSES_ALLOWED:
            here = self._standing(operator)
            if not here:
                self._console.print("      the prototype stands on no face: there is no gait from there")
                return
            on_route = here == route[self._done] and not misses
            target = route[self._done + 1] if on_route else next_face(here, before, used, self._mirrors == 0, rng)
            element = carrier(here, target)
            if operator.bridge.duty_left_s < ROLL_RUNS_S:
                with self._console.status("resting: the actuators have run as long as their duty cycle permits"):
                    operator.wait_for_duty(ROLL_RUNS_S, 30.0 + LONGEST_REST_S / self._robot.time_scale)
            result = self._roll(operator, target)
            self._tries += 1
            used.add(GROUP.index(element))
            distance = operator.distance_m()
            apart = f"{1e3 * distance[0]:6.1f} mm {1e3 * distance[1]:6.1f} mm" if distance else "not observed"
            gait = f"{result.primitive} {here}→{target}{'' if element.proper else ' mirror'}"
            faces = f"{result.predicted_face or 'none':<10} {result.observed_face or 'none':<10}"
            row = f"{gait:<22} {faces} {result.duration_s:8.1f} s   {apart}"
            if result.success:
                self._done += 1
                misses = 0
                self._mirrors += not element.proper
                self._console.print(f"{self._done:>4}  {row}")
            else:
                misses += 1
                self._console.print(f"{'miss':>4}  {row}\n      {result.reason}")
                if busy := busy_text():
                    self._console.print(f"      {busy}: that may be why, and not the robot; --real-time needs less of it")
                missed = time.monotonic()
                operator.wait(lambda missed=missed: operator.heard > missed, "the bridge's state")
            before = here

    def _roll(self, operator: Any, target: str) -> Any:
        with self._console.status(f"rolling to {target}") as status:

            def show(feedback: Any) -> None:
                status.update(
                    f"rolling to {target}: {feedback.phase}, on {feedback.face or 'no face'}, {100 * feedback.progress:.0f} %"
                )

            return operator.roll(target, tell=show, limit_s=30.0 + ROLL_LIMIT_S / self._robot.time_scale)

    def _summary(self, stopped: bool, bag: Path | None) -> None:
        show, robot = self._console.print, self._robot
        kind = f"{self._done} of {self._wanted} rolls succeeded in {self._tries} tries, {self._mirrors} of them by mirrored gaits"
        show("stopped by you: struts held, bag closed" if stopped else kind)
        off = f"off by ±{100 * robot.perturbation:g} % (docs/model.md, Perturbed prototypes), seed {robot.seed}"
        show(f"virtual prototype: {off}")
        if bag is None or not file_of(bag).is_file():
            show("no bag was recorded" if bag is None else f"the bag {bag} is missing")
            return
        show(f"bag: {bag.resolve()}")
        session = read_session(bag, topics=TOPICS)
        if not any(True for _ in session.of("bridge/struts_sent")):
            return
        result = replay(session)
        show(f"replay it: ./sixstrut replay {seen_from_here(bag)}   (twin's final state {result.digest[:16]}…)")
        if picture := session_picture(session, result, bag.with_suffix(".png")):
            show(f"picture: {picture.resolve()}")
