# SPDX-License-Identifier: Apache-2.0
"""The demo: starts the virtual prototype and the nodes, arms, rolls, reports, and leaves a bag and a picture."""

from __future__ import annotations

import random
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from hardware_bridge.recording.bag_reader import read_session
from hardware_bridge.recording.bag_types import TOPICS
from sim_core.structure.parameters import load_prototype
from sim_core.structure.policy import neutral_lengths
from sim_core.structure.symmetry import GROUP, carrier
from sim_core.uncertainty.distribution import Law
from tensegrity_lab.bags.replay import replay
from tensegrity_lab.reports.figure import session_picture
from tensegrity_lab.stack.processes import Stack, Uninterrupted
from tensegrity_lab.stack.ros_domain import Domain, private_domain
from tensegrity_lab.stack.virtual_stack import VirtualRobot
from tensegrity_lab.studies.demo_route import next_face, walk

ROLL_RUNS_S = 10.0
"""Robot time that a strut runs in a roll, at most: 45 mm there and back."""
LONGEST_REST_S = 700.0
"""Robot time after which the bridge's duty window is past."""
ROLL_LIMIT_S = 90.0
"""Robot time that one roll may take, both motions and both settlings."""
MISSES_ALLOWED = 3
CONSOLE_LIMIT_S = 60.0


@dataclass(frozen=True)
class Plan:
    """What the demo does. `console`: also in the browser. `domain`: of ROS; None: any that is free."""

    rolls: int
    robot: VirtualRobot
    console: bool = False
    domain: int | None = None


class Interrupted(KeyboardInterrupt):
    """SIGTERM, treated as Ctrl-C."""


def run(plan: Plan) -> int:
    """Run the demo. Returns 0 if every roll asked for succeeded, or if the user stopped it; 1 if not."""
    plan.robot.require()
    plan.robot.bags.mkdir(parents=True, exist_ok=True)

    def interrupt(_number: int, _frame: Any) -> None:
        raise Interrupted

    signal.signal(signal.SIGTERM, interrupt)
    console = Console(highlight=False, soft_wrap=True)
    with private_domain(plan.domain) as domain, tempfile.TemporaryDirectory(prefix="sixstrut-demo-") as folder:
        return _Demo(plan, Path(folder), domain, console).run()


class _Demo:
    def __init__(self, plan: Plan, folder: Path, domain: Domain, console: Console):
        self.plan, self.folder, self.domain, self.console = plan, folder, domain, console
        self.bag: Path | None = None
        self.mirrors = 0
        self.done = 0
        self.tries = 0

    def run(self) -> int:
        plan = self.plan
        self.console.print(plan.robot.words)
        self.console.print(self.domain.words)
        log_folder = plan.robot.bags / "logs" / time.strftime("%Y%m%d-%H%M%S")
        stopped = False
        stack = Stack(log_folder, *self.domain.locks)
        try:
            plan.robot.compile()
            with self.console.status("starting the virtual prototype, bridge, planner and twin"):
                prototype = plan.robot.start(stack, self.folder).instance
            if plan.console:
                self._open_console(stack)
            self._operate(stack, prototype)
        except KeyboardInterrupt:
            stopped = True
            self.console.print("\nstopping: the struts are held, the bag is being closed")
        finally:
            with Uninterrupted():
                codes = stack.stop()
        self._summary(codes, stopped, log_folder)
        bad = {name: code for name, code in codes.items() if code != 0}
        return 0 if not bad and (stopped or self.done >= plan.rolls) else 1

    def _open_console(self, stack: Stack) -> None:
        """Start a console before the stack, and say where it is."""
        console = stack.start("console", [sys.executable, "-m", "sixstrut_cli", "console", "--port", "0"])
        with self.console.status("starting the console"):
            console.says("console: ", CONSOLE_LIMIT_S)
        line = next(line for line in console.output.splitlines() if line.startswith("console: "))
        self.console.print(line.partition("   ")[0])

    def _operate(self, stack: Stack, prototype: str) -> None:
        from tensegrity_lab.stack.client import StackClient  # rclpy: only once the processes are on their way

        operator = StackClient(stack, prototype)
        try:
            with self.console.status("waiting for bridge, planner and twin to find each other"):
                operator.watch_joints()
                operator.wait_for_stack()
            with self.console.status("arming: the struts are energised one by one, then go to mid stroke"):
                operator.arm(neutral_lengths(load_prototype()).tolist())
            self.console.print(f"armed; standing on {operator.observed.face} ({operator.observed.source})\n")
            self._rolls(operator)
            operator.disarm()
        finally:
            if operator.bridge is not None and operator.bridge.bag:  # the bridge may begin it after it was first heard
                self.bag = Path(operator.bridge.bag)
            with Uninterrupted():
                operator.close()

    def _rolls(self, operator: Any) -> None:
        plan = self.plan
        header = f"{'roll':>4}  {'gait':<22} {'predicted':<10} {'observed':<10} {'robot time':>10}   twin to prototype (mean, max)"
        self.console.print(header)
        route, used = walk(plan.robot.face, plan.rolls, plan.robot.seed), set[int]()
        rng, before = random.Random(plan.robot.seed), None
        misses = 0
        while self.done < plan.rolls and misses < MISSES_ALLOWED:
            here = operator.observed.face
            on_route = here == route[self.done] and not misses
            target = route[self.done + 1] if on_route else next_face(here, before, used, self.mirrors == 0, rng)
            element = carrier(here, target)
            if operator.bridge.duty_left_s < ROLL_RUNS_S:
                with self.console.status("resting: the actuators have run as long as their duty cycle permits"):
                    operator.wait_for_duty(ROLL_RUNS_S, 30.0 + LONGEST_REST_S / plan.robot.time_scale)
            result = self._roll(operator, target)
            self.tries += 1
            used.add(GROUP.index(element))
            distance = operator.distance_m()
            apart = f"{1e3 * distance[0]:6.1f} mm {1e3 * distance[1]:6.1f} mm" if distance else "not observed"
            gait = f"{result.primitive} {here}→{target}{'' if element.proper else ' mirror'}"
            faces = f"{result.predicted_face or 'none':<10} {result.observed_face or 'none':<10}"
            row = f"{gait:<22} {faces} {result.duration_s:8.1f} s   {apart}"
            if result.success:
                self.done += 1
                misses = 0
                self.mirrors += not element.proper
                self.console.print(f"{self.done:>4}  {row}")
            else:
                misses += 1
                self.console.print(f"{'miss':>4}  {row}\n      {result.reason}")
                if not operator.observed.face:
                    self.console.print("      the prototype stands on no face: there is no gait from there")
                    return
            before = here

    def _roll(self, operator: Any, target: str) -> Any:
        with self.console.status(f"rolling to {target}") as status:

            def show(feedback: Any) -> None:
                status.update(
                    f"rolling to {target}: {feedback.phase}, on {feedback.face or 'no face'}, {100 * feedback.progress:.0f} %"
                )

            return operator.roll(target, tell=show, limit_s=30.0 + ROLL_LIMIT_S / self.plan.robot.time_scale)

    def _summary(self, codes: dict[str, int], stopped: bool, log_folder: Path) -> None:
        plan, show = self.plan, self.console.print
        show("")
        for name, code in codes.items():
            if code != 0:
                show(f"warning: {name} ended with exit code {code} (log: {log_folder / name}.log)")
        kind = f"{self.done} of {plan.rolls} rolls succeeded in {self.tries} tries, {self.mirrors} of them by mirrored gaits"
        show("stopped by you: struts held, bag closed" if stopped else kind)
        show(f"perturbation: seed {plan.robot.seed}; {Law(plan.robot.perturbation).text}")
        if self.bag is None or not self.bag.exists():
            show("no bag was recorded" if self.bag is None else f"the bag {self.bag} is missing")
            return
        show(f"bag: {self.bag.resolve()}")
        session = read_session(self.bag, topics=TOPICS)
        if not any(True for _ in session.of("bridge/struts_sent")):
            return
        result = replay(session)
        picture = self.bag.with_suffix(".png")
        session_picture(session, result, picture)
        show(f"picture: {picture.resolve()}")
        show(f"replay it: ./sixstrut replay {_short(self.bag)}   (twin's final state {result.digest[:16]}…)")


def _short(path: Path) -> Path:
    """Relative to where the user is, if below it."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
