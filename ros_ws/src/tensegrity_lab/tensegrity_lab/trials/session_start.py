# SPDX-License-Identifier: Apache-2.0
"""From a command line to a running session: begun or gone on with, its plan shown first."""

from __future__ import annotations

import getpass
import random
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from hardware_bridge.boards.registry import parse_board
from hardware_bridge.calibration.pulse_map import load_calibration
from hardware_bridge.prototype_client.handshake import read_handshake
from sim_core.dynamics.actuators import require_actuators
from sim_core.dynamics.model import build_model
from sim_core.gaits.library import Library, load_library
from sim_core.gaits.success_probability import load_success_counts
from sim_core.planning.face_graph import FaceGraph
from sim_core.rolling.warm_up import Stage
from sim_core.structure.parameters import load_prototype
from sim_core.studies.model_agreement import NamedGait, verdicts
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.folder import (
    SessionFolder,
    Settings,
    begin_session,
    is_session,
    locked,
    open_session,
    require_free,
    require_same,
)
from tensegrity_lab.session_data.ledger import Ledger
from tensegrity_lab.session_data.plan import Slot, chosen_gaits, chosen_primitives, due_of, make_plan
from tensegrity_lab.session_data.record import Outcome
from tensegrity_lab.stack.processes import Uninterrupted
from tensegrity_lab.stack.ros_domain import Domain, private_domain, robot_domain
from tensegrity_lab.terminal.compile_notice import compile_first
from tensegrity_lab.terminal.keys import Keys, pressed, require_keyboard
from tensegrity_lab.trials.judge import Hands, Observer, Person
from tensegrity_lab.trials.panel import Lines, Live, Panel, duration_text
from tensegrity_lab.trials.remote_panel import Mirrored, Remote
from tensegrity_lab.trials.robot_access import Hardware, RobotAccess
from tensegrity_lab.trials.session import Session
from tensegrity_lab.trials.time_estimate import HANDS, PROGRAM, Estimate, Pace, estimate

DEFAULTS: dict[str, Any] = {"library": "robust", "primitives": "all", "gaits": "all", "repeats": 1}
VIRTUAL_DEFAULTS: dict[str, Any] = {"perturbation": 0.05, "seed": 1, "actuators": "stand-in"}
EXIT_LEFT = 130


@dataclass(frozen=True)
class Asked:
    """What the command line says; None: nothing was said.

    Attributes:
        session: folder; None: a new one. plan: what defines a session, by the names of `Settings`.
        virtual: a virtual prototype is started. port, board, baud, calibration, time_scale, rested_s, silent_board: see
        `Hardware`.
        by_hand: a person judges, though an observer could. plan_only: show the plan and leave.
        domain: of ROS; None: with a virtual prototype of its own any that is free, with a port the shell's.
    """

    session: Path | None
    plan: dict[str, Any]
    experimenter: str
    virtual: bool
    port: str
    board: str
    baud: int
    calibration: str
    time_scale: float
    by_hand: bool
    plan_only: bool
    rested_s: float = 0.0
    silent_board: bool = False
    domain: int | None = None

    @property
    def virtual_robot(self) -> bool:
        """Whether the robot is simulated, here or behind the port."""
        return self.virtual or (bool(self.port) and read_handshake(self.port) is not None)


def run(asked: Asked) -> int:
    """Begin a session, or go on with it. Returns 0: all is done; 130: left before. Raises SessionError, StackError."""
    console = Console(highlight=False, soft_wrap=True)
    parse_board(asked.board)
    if asked.calibration:
        load_calibration(asked.calibration)
    path = asked.session or _new_path(asked)
    begun = None if is_session(path) else _planned(asked, path, console)
    path.mkdir(parents=True, exist_ok=True)  # not before the plan is valid
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _interrupt)
    with locked(path, console.print) as lock:
        folder = _open(asked, path) if begun is None or is_session(path) else begin_session(path, *begun)
        ledger = Ledger(path)
        pace, forecast = _forecast(asked, folder, ledger)
        _show_plan(console, folder, ledger, pace, forecast)
        if asked.plan_only:
            return 0
        return _Run(asked, folder, ledger, forecast, console).run(lock)


def _new_path(asked: Asked) -> Path:
    from hardware_bridge.recording.session_bag import bag_folder

    name = Path(str(asked.plan.get("library") or DEFAULTS["library"])).stem
    return bag_folder("") / f"trials_{name}_{time.strftime('%Y%m%d_%H%M%S', time.gmtime())}"


def _given(asked: Asked) -> dict[str, Any]:
    return {name: value for name, value in asked.plan.items() if value is not None}


def _open(asked: Asked, path: Path) -> SessionFolder:
    """A session that was begun, if it is the one that is asked for. Raises SessionError."""
    given, folder = _given(asked), open_session(path)
    settings = folder.settings
    if "library" in given:
        require_same(settings, {"library_hash": load_library(given.pop("library")).hash})
    require_same(settings, given)
    if not (asked.virtual or asked.port or asked.plan_only) or asked.virtual_robot != settings.virtual_robot:
        wanted = "--virtual" if settings.virtual_robot else "--port PORT --calibration FILE"
        if asked.virtual or asked.port or not settings.virtual_robot:
            raise SessionError(f"session {settings.name} is of robot {settings.robot!r}: go on with {wanted}")
    return folder


def _planned(asked: Asked, path: Path, console: Console) -> tuple[Settings, list[Slot], Library]:
    """What a new session is to be; nothing is written. Raises SessionError, SimError."""
    if not (asked.virtual or asked.port):
        raise SessionError(f"{path} is no session yet: to begin one, give --virtual, or --port PORT --calibration FILE")
    require_free(path)
    given = _given(asked)
    chosen = {**DEFAULTS, "order_seed": random.SystemRandom().randrange(1_000_000), **given}
    virtual = asked.virtual_robot
    if asked.virtual:
        chosen = {**VIRTUAL_DEFAULTS, **chosen}
        require_actuators(chosen["actuators"])
        chosen.setdefault(
            "robot",
            f"virtual prototype, seed {chosen['seed']}, ±{100 * chosen['perturbation']:g} %, actuators {chosen['actuators']}",
        )
    else:
        wrong = [name for name in VIRTUAL_DEFAULTS if name in given]
        if wrong:
            raise SessionError(f"--{wrong[0]} is of a virtual prototype that the session starts: give --virtual and no --port")
        chosen.setdefault("robot", "virtual prototype at a port" if virtual else "prototype")
    if not (asked.plan_only or (virtual and not asked.by_hand)):
        require_keyboard()
    library = load_library(chosen.pop("library"))
    gaits = chosen_gaits(chosen_primitives(library, chosen["primitives"]), chosen["gaits"])
    compile_first(Stage.BATCH)
    with console.status(f"predicting {len(gaits)} gaits with the nominal model"):
        listed = [NamedGait(gait.name, gait.source, gait.target, gait.policy) for gait in gaits]
        predicted = verdicts(build_model(load_prototype()), listed)
    graph = FaceGraph(library, load_success_counts(library))
    plan = make_plan(gaits, predicted, graph, chosen["repeats"], chosen["order_seed"])
    settings = Settings(
        name=path.resolve().name,
        created=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        library=library.name,
        library_hash=library.hash,
        virtual_robot=virtual,
        **chosen,
    )
    return settings, plan, library


def _forecast(asked: Asked, folder: SessionFolder, ledger: Ledger) -> tuple[Pace, Estimate]:
    automatic = folder.settings.virtual_robot and not asked.by_hand
    scale = asked.time_scale if folder.settings.virtual_robot else 1.0
    pace = Pace(load_prototype().actuator_speed_m_s, scale, *(PROGRAM if automatic else HANDS))
    standing = ledger.standing()
    last = standing.trials.get(standing.last_number)
    due = due_of(folder.plan, standing.done())
    return pace, estimate(due, last.observed_face if last else "", pace)


def _show_plan(console: Console, folder: SessionFolder, ledger: Ledger, pace: Pace, forecast: Estimate) -> None:
    settings, standing = folder.settings, ledger.standing()
    valid = standing.valid
    voids = len(standing.trials) - len(valid)
    kind = "virtual trials" if settings.virtual_robot else "trials"
    show = console.print
    show(f"session {settings.name} of {settings.created}: {kind} on {settings.robot}")
    show(f"  library     {settings.library} ({settings.library_hash}), primitives {settings.primitives}, gaits {settings.gaits}")
    gaits = len({slot.gait[:3] for slot in folder.plan})
    show(f"  plan        {len(folder.plan)} trials: {gaits} gaits, {settings.repeats} of each; order by seed {settings.order_seed}")
    won = sum(line.outcome is Outcome.SUCCESS for line in valid)
    if standing.last_number:
        show(f"  done        {len(valid)}, of which {won} succeeded; {voids} void, {len(standing.revoked)} revoked")
    if forecast.trials:
        rest = f", {duration_text(forecast.rest_s)} of it resting" if forecast.rest_s >= 1.0 else ""
        speed = f" at {pace.time_scale:g} times real time" if pace.time_scale != 1.0 else ""
        busy, places = duration_text(forecast.busiest_s), forecast.placings
        show(f"  to go       {forecast.trials}, about {duration_text(forecast.wall_s)}{speed}{rest}")
        show(f"  pace        struts may run 20 % of the time; the busiest runs {busy} of robot time; {places} placings elsewhere")
    else:
        show("  to go       nothing: the session is complete")
    show(f"  folder      {folder.path.resolve()}")
    show("")


class _Run:
    """One start of the program on a session."""

    def __init__(self, asked: Asked, folder: SessionFolder, ledger: Ledger, forecast: Estimate, console: Console):
        self._asked, self._folder, self._ledger, self._console = asked, folder, ledger, console
        self._forecast = forecast
        self._automatic = folder.settings.virtual_robot and not asked.by_hand
        if not self._automatic:
            require_keyboard()

    def run(self, lock: int) -> int:
        asked = self._asked
        if not self._forecast.trials:
            return self._end(0)
        compile_first(Stage.ROBOT, Stage.BATCH)
        choose = private_domain if asked.virtual or not asked.port else robot_domain
        with choose(asked.domain) as domain:
            return self._rolled(domain, lock)

    def _rolled(self, domain: Domain, lock: int) -> int:
        asked, folder = self._asked, self._folder
        self._console.print(domain.words)
        hardware = Hardware(
            asked.port,
            asked.board,
            asked.baud,
            asked.calibration,
            asked.time_scale,
            self._automatic,
            asked.rested_s,
            asked.silent_board,
        )
        lab = RobotAccess(folder, hardware, lock, *domain.locks)
        kind = "virtual trials" if folder.settings.virtual_robot else "trials"
        panel: Panel = Live(kind) if sys.stdout.isatty() else Lines(kind)
        try:
            with ExitStack() as stack:
                keys = stack.enter_context(_keyboard())
                if keys is not None:
                    remote = stack.enter_context(closing(Remote()))
                    keys, panel = keys.and_from(remote.keys_from), Mirrored(panel, remote)
                    self._console.print(f"in the browser: ROS_DOMAIN_ID={domain.number} ./sixstrut console")
                stack.enter_context(panel)
                hands = self._hands(keys, panel)
                speed = load_prototype().actuator_speed_m_s
                session = Session(folder, self._ledger, lab, hands, panel, asked.experimenter, speed, keys, self._forecast.wall_s)
                if isinstance(hands, Person):
                    hands.undo = session.undo
                session.run()
        except (KeyboardInterrupt, EOFError):
            self._console.print("left by you: struts held, the bag is being closed")
        finally:
            with Uninterrupted():
                codes = lab.stop()
        for name, code in codes.items():
            if code != 0:
                self._console.print(f"warning: {name} ended with exit code {code}; its log is below {_short(folder.path)}")
        return self._end(EXIT_LEFT)

    def _hands(self, keys: Keys | None, panel: Panel) -> Hands:
        owns = not self._asked.port
        if self._automatic:
            library = self._folder.library
            return Observer(FaceGraph(library, load_success_counts(library)), owns, panel.line)
        assert keys is not None
        return Person(keys, panel, owns)

    def _end(self, code_if_left: int) -> int:
        standing = self._ledger.standing()
        valid, path = standing.valid, _short(self._folder.path)
        won = sum(line.outcome is Outcome.SUCCESS for line in valid)
        kind = "virtual trials" if self._folder.settings.virtual_robot else "trials"
        left = len(due_of(self._folder.plan, standing.done()))
        rate = f", {won} succeeded ({100 * won / len(valid):.1f} %)" if valid else ""
        self._console.print(f"{len(valid)} of {len(self._folder.plan)} {kind} are done{rate}")
        if valid:
            self._console.print(f"report: ./sixstrut report {path}")
        if left:
            how = "--virtual" if self._folder.settings.virtual_robot and not self._asked.port else f"--port {self._asked.port}"
            self._console.print(f"go on:  ./sixstrut trial {path} {how}")
        return code_if_left if left else 0


@contextmanager
def _keyboard() -> Iterator[Keys | None]:
    """Keys, if there is a terminal to press them at."""
    with ExitStack() as stack:
        yield stack.enter_context(pressed()) if sys.stdin.isatty() else None


def _interrupt(_number: int, _frame: Any) -> None:
    raise KeyboardInterrupt


def experimenter() -> str:
    """Who is logged in; "unknown" where nobody has a name."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "unknown"


def _short(path: Path) -> Path:
    """Relative to where the user is, if below it."""
    return path.relative_to(Path.cwd()) if path.is_absolute() and path.is_relative_to(Path.cwd()) else path
