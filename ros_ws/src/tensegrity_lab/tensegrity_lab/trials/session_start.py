# SPDX-License-Identifier: Apache-2.0
"""From a command line to a running session: begun or gone on with, its plan shown first."""

import getpass
import random
import signal
import sys
import time
from collections import Counter
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from hardware_bridge.boards.registry import parse_board
from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.prototype_client.handshake import read_handshake
from sim_core.dynamics.actuators import require_actuators
from sim_core.dynamics.model import build_model
from sim_core.files.places import folder_problem, seen_from_here
from sim_core.gaits.cycle import Chain
from sim_core.gaits.library import Library, load_library
from sim_core.gaits.success_counts import load_success_counts
from sim_core.planning.face_graph import FaceGraph
from sim_core.rolling.warm_up import Stage
from sim_core.structure.parameters import load_prototype
from tensegrity_lab.commissioning.imu_mounting import virtual_mounting
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.folder import (
    MOUNTING,
    SessionFolder,
    Settings,
    begin_session,
    is_session,
    locked,
    now_text,
    open_session,
    require_free,
    require_same,
    virtual_robot_text,
)
from tensegrity_lab.session_data.ledger import Ledger
from tensegrity_lab.session_data.plan import Slot, chosen_gaits, chosen_primitives, due_of, planned
from tensegrity_lab.stack.ros_domain import Domain, private_domain, robot_domain
from tensegrity_lab.terminal.compile_notice import compile_first
from tensegrity_lab.terminal.keys import Keys, pressed, require_keyboard
from tensegrity_lab.terminal.leaving import uninterrupted
from tensegrity_lab.terminal.progress import duration_text
from tensegrity_lab.trials.judge import Feeler, Hands, Observer, Person
from tensegrity_lab.trials.panel import Panel
from tensegrity_lab.trials.remote_panel import Remote
from tensegrity_lab.trials.robot_access import Hardware, RobotAccess
from tensegrity_lab.trials.session import Session
from tensegrity_lab.trials.time_estimate import HANDS, PROGRAM, Estimate, Pace, estimate

DEFAULTS: dict[str, Any] = {"library": "robust", "primitives": "all", "gaits": "all", "repeats": 1}
VIRTUAL_DEFAULTS: dict[str, Any] = {"perturbation": 0.05, "seed": 1, "actuators": "stand-in"}
OBSERVER, HAND, IMU = JUDGES = ("observer", "hand", "imu")
EXIT_LEFT = 130
CHAIN_TIME_SCALE = 2.0
"""A virtual prototype rolls chains no faster than this: what is late on the way from its observer to its struts fails them."""


@dataclass(frozen=True)
class TrialRequest:
    """What the command line says; None: nothing was said.

    Attributes:
        session: folder; None: a new one.
        plan: what defines a session, by the names of `Settings`.
        experimenter: who runs it.
        virtual: a virtual prototype is started.
        hardware: how the robot is reached.
        judge: observer, hand or imu; empty: as the session has it, or as is usual.
        plan_only: show the plan and leave.
        domain: of ROS; None: with a virtual prototype of its own any that is free, with a port the shell's.
    """

    session: Path | None
    plan: dict[str, Any]
    experimenter: str
    virtual: bool
    hardware: Hardware
    judge: str
    plan_only: bool
    domain: int | None = None

    @property
    def virtual_robot(self) -> bool:
        """Whether the robot is simulated, here or behind the port."""
        port = self.hardware.port
        return self.virtual or (bool(port) and read_handshake(port) is not None)

    @property
    def judged(self) -> str:
        """By whom: the prototype's observer, a person's hand, or an inertial sensor."""
        return self.judge or (OBSERVER if self.virtual_robot else HAND)

    @property
    def automatic(self) -> bool:
        """Whether nobody needs to be there: a virtual robot is put where it is needed."""
        return self.virtual_robot and self.judged != HAND

    @property
    def given(self) -> dict[str, Any]:
        """What was said of the plan."""
        return {name: value for name, value in self.plan.items() if value is not None}


def run(asked: TrialRequest) -> int:
    """Begin a session, or go on with it. Returns 0: all is done; 130: left before. Raises SessionError, StackError."""
    console = Console(highlight=False, soft_wrap=True)
    parse_board(asked.hardware.board)
    if asked.hardware.calibration:
        load_calibration(asked.hardware.calibration)
    path = asked.session or _new_path(asked)
    if not asked.plan_only and (problem := folder_problem(path, locks=True)):
        raise SessionError(f"{problem}: give another folder for the session")
    begun = None if is_session(path) else _planned(asked, path, console)
    path.mkdir(parents=True, exist_ok=True)  # not before the plan is valid
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    with locked(path, console.print) as lock:
        folder = _open(asked, path) if begun is None or is_session(path) else begin_session(path, *begun)
        return _Run(asked, folder, console).run(lock)


def _new_path(asked: TrialRequest) -> Path:
    from hardware_bridge.recording.session_bag import bag_folder

    name = Path(str(asked.plan.get("library") or DEFAULTS["library"])).stem
    return bag_folder("") / f"trials_{name}_{time.strftime('%Y%m%d_%H%M%S', time.gmtime())}"


def _open(asked: TrialRequest, path: Path) -> SessionFolder:
    """A session that was begun, if it is the one that is asked for. Raises SessionError."""
    given, folder = asked.given, open_session(path)
    settings = folder.settings
    if "library" in given:
        require_same(settings, {"library_hash": load_library(given.pop("library")).hash})
    if not settings.judge:  # the session is older than that
        given.pop("judge", None)
    require_same(settings, given)
    asked = _as_begun(asked, folder)
    if not asked.plan_only:
        _require_judge(asked, any(slot.chain for slot in folder.plan))
    if not (asked.virtual or asked.hardware.port or asked.plan_only) or asked.virtual_robot != settings.virtual_robot:
        wanted = "--virtual" if settings.virtual_robot else "--port PORT --calibration FILE"
        if asked.virtual or asked.hardware.port or not settings.virtual_robot:
            raise SessionError(f"session {settings.name} is of robot {settings.robot!r}: go on with {wanted}")
    return folder


def _as_begun(asked: TrialRequest, folder: SessionFolder) -> TrialRequest:
    """Judged as the session was from its beginning."""
    return replace(asked, judge=folder.settings.judge or asked.judge)


def _require_judge(asked: TrialRequest, has_chains: bool) -> None:
    """Raises SessionError: who is to judge cannot."""
    judge, hardware = asked.judged, asked.hardware
    if judge not in JUDGES:
        raise SessionError(f"judge {judge!r}: valid are {', '.join(JUDGES)}")
    if judge == OBSERVER and not asked.virtual_robot:
        raise SessionError("--judge observer: only a virtual prototype has one; judge by hand or imu")
    if judge == IMU and not asked.virtual and not hardware.mounting:
        raise SessionError(
            "--judge imu: give --mounting FILE, found with ./sixstrut calibrate imu, and --imu-port, if no driver runs"
        )
    if judge != IMU and (hardware.mounting or hardware.imu_port):
        raise SessionError("--mounting and --imu-port are of an inertial sensor: give --judge imu too")
    if has_chains and judge == HAND:
        raise SessionError(
            "chains are judged face by face while the robot rolls on; here a person judges: choose primitives, or give "
            "--judge imu, or --virtual alone"
        )


def _planned(asked: TrialRequest, path: Path, console: Console) -> tuple[Settings, list[Slot], Library]:
    """What a new session is to be; nothing is written. Raises SessionError, SimError."""
    if not (asked.virtual or asked.hardware.port):
        raise SessionError(f"{path} is no session yet: to begin one, give --virtual, or --port PORT --calibration FILE")
    require_free(path)
    given = asked.given
    chosen = {**DEFAULTS, "order_seed": random.SystemRandom().randrange(1_000_000), **given}
    virtual = asked.virtual_robot
    if asked.virtual:
        chosen = {**VIRTUAL_DEFAULTS, **chosen}
        require_actuators(chosen["actuators"])
        chosen.setdefault("robot", virtual_robot_text(chosen["seed"], chosen["perturbation"], chosen["actuators"]))
    else:
        wrong = [name for name in VIRTUAL_DEFAULTS if name in given]
        if wrong:
            raise SessionError(f"--{wrong[0]} is of a virtual prototype that the session starts: give --virtual and no --port")
        chosen.setdefault("robot", "virtual prototype at a port" if virtual else "prototype")
    chosen |= {"judge": asked.judged}
    library = load_library(chosen.pop("library"))
    gaits = chosen_gaits(chosen_primitives(library, chosen["primitives"]), chosen["gaits"])
    _require_judge(asked, any(isinstance(gait, Chain) for gait in gaits))
    if not (asked.plan_only or asked.automatic):
        require_keyboard()
    compile_first(Stage.BATCH)
    with console.status(f"predicting {len(gaits)} gaits with the nominal model"):
        plan = planned(gaits, library, build_model(load_prototype()), chosen["repeats"], chosen["order_seed"])
    settings = Settings(
        name=path.resolve().name,
        created=now_text(),
        library=library.name,
        library_hash=library.hash,
        virtual_robot=virtual,
        **chosen,
    )
    return settings, plan, library


class _Run:
    """One start of the program on a session."""

    def __init__(self, asked: TrialRequest, folder: SessionFolder, console: Console):
        if any(slot.chain for slot in folder.plan):
            asked = replace(asked, hardware=replace(asked.hardware, time_scale=min(asked.hardware.time_scale, CHAIN_TIME_SCALE)))
        asked = _as_begun(asked, folder)
        self._asked, self._folder, self._console = asked, folder, console
        self._ledger = Ledger(folder.path)
        self._virtual = folder.settings.virtual_robot
        self._automatic = asked.automatic
        self._kind = "virtual trials" if self._virtual else "trials"
        self._speed_m_s = load_prototype().actuator_speed_m_s

    def run(self, lock: int) -> int:
        asked = self._asked
        forecast = self._show_plan()
        if asked.plan_only:
            return 0
        if not self._automatic:
            require_keyboard()
        if not forecast.trials:
            return self._end()
        compile_first(Stage.ROBOT, Stage.BATCH)
        choose = private_domain if asked.virtual or not asked.hardware.port else robot_domain
        with choose(asked.domain) as domain:
            return self._rolled(domain, lock, forecast.wall_s)

    def _show_plan(self) -> Estimate:
        """Tell what is to be done, and how long it takes."""
        folder, standing, show = self._folder, self._ledger.standing(), self._console.print
        settings, valid = folder.settings, standing.valid
        scale = self._asked.hardware.time_scale if self._virtual else 1.0
        pace = Pace(self._speed_m_s, scale, *(PROGRAM if self._automatic else HANDS))
        last = standing.trials.get(standing.last_number)
        forecast = estimate(due_of(folder.plan, standing.done()), last.observed_face if last else "", pace, folder.library)
        show(f"session {settings.name} of {settings.created}: {self._kind} on {settings.robot}")
        chosen = f"primitives {settings.primitives}, gaits {settings.gaits}"
        show(f"  library     {settings.library} ({settings.library_hash}), {chosen}")
        kinds = Counter("chain" if slot.chain else "gait" for slot in folder.plan if slot.repeat == 1)
        gaits = (
            " and ".join(f"{count} {kind}{'s' * (count > 1)}" for kind, count in kinds.items()) + f", {settings.repeats} of each"
        )
        show(f"  plan        {len(folder.plan)} trials: {gaits}; order by seed {settings.order_seed}")
        if standing.last_number:
            voids = f"{len(standing.trials) - len(valid)} void, {len(standing.revoked)} revoked"
            show(f"  done        {len(valid)}, of which {standing.successes} succeeded; {voids}")
        if forecast.trials:
            rest = f", {duration_text(forecast.rest_s)} of it resting" if forecast.rest_s >= 1.0 else ""
            speed = f" at {scale:g} times real time" if scale != 1.0 else ""
            busy = f"the busiest runs {duration_text(forecast.busiest_s)} of robot time"
            show(f"  to go       {forecast.trials}, about {duration_text(forecast.wall_s)}{speed}{rest}")
            show(f"  pace        struts may run 20 % of the time; {busy}; {forecast.placings} placings elsewhere")
        else:
            show("  to go       nothing: the session is complete")
        show(f"  folder      {folder.path.resolve()}\n")
        return forecast

    def _rolled(self, domain: Domain, lock: int, forecast_s: float) -> int:
        asked, folder, show = self._asked, self._folder, self._console.print
        show(domain.describe)
        hardware = replace(asked.hardware, observed=asked.judged != HAND)
        if asked.judged == IMU and asked.virtual:
            hardware = replace(hardware, mounting=str(self._mounting()))
        lab = RobotAccess(folder, hardware, lock, *domain.locks)
        try:
            with ExitStack() as stack:
                terminal = self._console.is_terminal and not self._console.is_dumb_terminal
                keys, panel = None, Panel(self._kind, terminal)
                if sys.stdin.isatty():
                    remote = stack.enter_context(closing(Remote()))
                    keys = stack.enter_context(pressed()).and_from(remote.keys_from)
                    panel = Panel(self._kind, terminal, remote.show)
                    show(f"in the browser: ROS_DOMAIN_ID={domain.number} ./sixstrut console")
                stack.enter_context(panel)
                hands = self._hands(keys, panel)
                session = Session(folder, self._ledger, lab, hands, panel, asked.experimenter, self._speed_m_s, keys, forecast_s)
                if isinstance(hands, Person):
                    hands.undo = session.undo
                session.run()
        except (KeyboardInterrupt, EOFError):
            show("left by you: struts held, the bag is being closed")
        finally:
            with uninterrupted():
                codes = lab.stop()
        if lab.compared:
            show(f"the prototype's observer, whom nobody heard, agrees with the sensor on {lab.agreed} of {lab.compared} trials")
        for name, code in codes.items():
            if code != 0:
                show(f"warning: {name} ended with exit code {code}; its log is below {seen_from_here(folder.path)}")
        return self._end()

    def _hands(self, keys: Keys | None, panel: Panel) -> Hands:
        owns, library = not self._asked.hardware.port, self._folder.library
        graph = FaceGraph(library, load_success_counts(library))
        if self._automatic:
            return Observer(graph, owns, panel.line)
        assert keys is not None
        return Feeler(keys, panel, owns, graph) if self._asked.judged == IMU else Person(keys, panel, owns)

    def _mounting(self) -> Path:
        """How the inertial sensor of the session's virtual prototype sits, found at the first start."""
        file, settings = self._folder.path / MOUNTING, self._folder.settings
        if not file.exists():
            with self._console.status("feeling the inertial sensor of the virtual prototype") as status:
                virtual_mounting(file, settings.seed, settings.perturbation, status.update)
        return file

    def _end(self) -> int:
        """Tell what is done and what comes next; the exit code."""
        standing, show, path = self._ledger.standing(), self._console.print, seen_from_here(self._folder.path)
        left = due_of(self._folder.plan, standing.done())
        count = len(standing.valid)
        rate = f", {standing.successes} of {count} succeeded" if count else ""
        show(f"{count} of {len(self._folder.plan)} {self._kind} are done{rate}")
        if count:
            show(f"report: ./sixstrut report {path}")
        if left:
            port = self._asked.hardware.port
            show(f"go on:  ./sixstrut trial {path} {'--virtual' if self._virtual and not port else f'--port {port}'}")
        return EXIT_LEFT if left else 0


def experimenter() -> str:
    """Who is logged in; "unknown" where nobody has a name."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "unknown"
