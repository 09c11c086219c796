# SPDX-License-Identifier: Apache-2.0
"""A session's folder: what it tries and on which robot, written once; the ledger; the bags. One process at a time."""

import fcntl
import hashlib
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, TextIO, get_type_hints

from hardware_bridge.recording.bag_on_disk import is_bag
from hardware_bridge.recording.session_bag import bag_folder
from sim_core.errors import FileError, brief
from sim_core.files.bounded_reader import read_text
from sim_core.files.yaml_reader import read_yaml, sealed, yaml_text
from sim_core.gaits.library import Library, library_text, load_library
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.ledger import NEW, write_durably
from tensegrity_lab.session_data.plan import Slot, plan_of, plan_text

SCHEMA = 1
SETTINGS, PLAN, LIBRARY, LOCK, BAGS, LOGS = "session.yaml", "plan.csv", "library.yaml", "lock", "bags", "logs"
MOUNTING = "mounting.yaml"
"""Of the inertial sensor, in a session that is judged by a virtual one."""
LOCK_LIMIT_S = 60.0
"""The processes of a session that was killed finish their bag first."""


@dataclass(frozen=True)
class Settings:
    """What makes two trials comparable. It never changes once the session has begun.

    Attributes:
        name: of the session.
        created: UTC, ISO 8601.
        library, library_hash: of the gaits.
        primitives, gaits, repeats: as asked for.
        order_seed: drew the order.
        robot: which prototype.
        virtual_robot: it is simulated; then perturbation, seed and actuators say which.
        computed: by what, if no stack ran: such trials are virtual, and each begins as the model places the robot; empty: they ran.
        plan_hash: of what is tried; empty: the session is older than that.
        judge: of the trials: observer, hand or imu; empty: the session is older than that.
    """

    name: str
    created: str
    library: str
    library_hash: str
    primitives: str
    gaits: str
    repeats: int
    order_seed: int
    robot: str
    virtual_robot: bool
    perturbation: float = 0.0
    seed: int = 0
    actuators: str = ""
    computed: str = ""
    plan_hash: str = ""
    judge: str = ""


def virtual_robot_text(seed: int, perturbation: float, actuators: str) -> str:
    """Which virtual prototype it is: a session's `robot`."""
    return f"virtual prototype, seed {seed}, ±{100 * perturbation:g} %, actuators {actuators}"


def now_text() -> str:
    """A session's `created`."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


@dataclass(frozen=True)
class SessionFolder:
    """A session that has begun.

    Attributes:
        path: its folder.
        settings, plan, library: what was written at its beginning.
    """

    path: Path
    settings: Settings
    plan: list[Slot]
    library: Library

    @property
    def bags(self) -> Path:
        """Where its bags go."""
        return self.path / BAGS


def is_session(path: Path) -> bool:
    """Whether a session has begun in a folder."""
    return (path / SETTINGS).is_file()


def begin_session(path: Path, settings: Settings, plan: list[Slot], library: Library) -> SessionFolder:
    """Write a new session; all of it or nothing: its settings come last.

    Raises:
        SessionError: the folder holds something else. OSError.
    """
    path.mkdir(parents=True, exist_ok=True)
    require_free(path)
    settings = replace(settings, plan_hash=_hash_of(plan))
    write_durably(path / LIBRARY, library_text(library))
    write_durably(path / PLAN, plan_text(plan))
    write_durably(path / SETTINGS, sealed(yaml_text({"schema": SCHEMA, **asdict(settings)})))
    return SessionFolder(path, settings, plan, library)


def require_free(path: Path) -> None:
    """Raises SessionError: the folder holds something that is no session's. It need not exist."""
    if path.exists() and not path.is_dir():
        raise SessionError(f"{path} is a file: give a folder, or a name that does not exist yet")
    here = path.iterdir() if path.exists() else ()
    others = sorted(p.name for p in here if p.name.removesuffix(NEW) not in (PLAN, LIBRARY, LOCK) and p.name != SETTINGS + NEW)
    if others:
        raise SessionError(f"{path} holds {others[0]} and no session: give another folder, or one that does not exist yet")


def newest_session() -> Path:
    """The session that was begun last, of those where sessions go. Raises SessionError: there is none."""
    folder = bag_folder("")
    found = [(path.stat().st_mtime_ns, path.parent) for path in folder.glob(f"*/{SETTINGS}")]
    if not found:
        raise SessionError(f"there is no session in {folder}: give one's folder, or make one with: sixstrut trial --virtual")
    return max(found)[1]


def open_session(path: Path) -> SessionFolder:
    """Read a session. Raises SessionError: it is none, or something of it was changed."""
    try:
        document: Any = read_yaml(path / SETTINGS)
        plan_table = read_text(path / PLAN)
    except (OSError, FileError) as error:
        why = f"{Path(error.filename).name}: {error.strerror}" if isinstance(error, OSError) else str(error)
        if is_bag(path):
            why = "it is a bag: `report`, `odds`, `fit`, `replay` and `play` take it"
        raise SessionError(
            f"{path} is not a session of trials ({why}); valid is a folder that `sixstrut trial` made, with {SETTINGS} in it"
        ) from error
    if not isinstance(document, Mapping) or document.get("schema") != SCHEMA:
        raise SessionError(f"{path / SETTINGS} is not of this version: valid is a mapping with schema: {SCHEMA}")
    known = {field.name for field in fields(Settings)}
    try:
        settings = Settings(**{key: value for key, value in document.items() if key in known})
    except TypeError as error:
        raise SessionError(f"{path / SETTINGS}: {error}") from error
    _require_types(path / SETTINGS, settings)
    library = load_library(path / LIBRARY)
    if library.hash != settings.library_hash:
        raise SessionError(
            f"{path / LIBRARY} is not the session's library any more: hash {library.hash}, not {settings.library_hash}"
        )
    plan = plan_of(plan_table, str(path / PLAN))
    if settings.plan_hash not in ("", _hash_of(plan)):
        raise SessionError(f"{path / PLAN} is not the session's plan any more: put it back as it was, or begin a new session")
    return SessionFolder(path, settings, plan, library)


def _hash_of(plan: list[Slot]) -> str:
    return hashlib.sha256(plan_text(plan).encode()).hexdigest()[:16]


def _require_types(file: Path, settings: Settings) -> None:
    """Raises SessionError: a setting is of another type than it should be."""
    for name, kind in get_type_hints(Settings).items():
        value = getattr(settings, name)
        if not isinstance(value, (int, float) if kind is float else kind) or (kind is not bool and isinstance(value, bool)):
            raise SessionError(f"{file}: {name} is {brief(value)}; valid is a value of type {kind.__name__}")


def require_same(settings: Settings, asked: Mapping[str, object]) -> None:
    """Whether what is asked for is what the session has. Raises SessionError naming all that differs."""
    differ = [
        f"{name} {getattr(settings, name)!r}, not {value!r}" for name, value in asked.items() if getattr(settings, name) != value
    ]
    if differ:
        raise SessionError(
            f"session {settings.name} has {'; '.join(differ)}: leave these options out to go on, or begin a new session"
        )


@contextmanager
def locked(path: Path, say: Callable[[str], None]) -> Iterator[int]:
    """Holds a session's lock; its descriptor, for the stack's processes to hold too.

    Args:
        path: the session's folder.
        say: told for people why it waits: a session that was killed leaves processes that are closing its bag.

    Raises:
        SessionError: somebody else holds it for longer than that can take.
    """
    with (path / LOCK).open("a+", errors="replace") as file:
        _wait_for(file, path, say)
        file.truncate(0)
        print(os.getpid(), file=file, flush=True)
        yield file.fileno()


def _wait_for(file: TextIO, path: Path, say: Callable[[str], None]) -> None:
    end, told = time.monotonic() + LOCK_LIMIT_S, False
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            file.seek(0)
            owner = file.read(32).strip()
            if owner.isdigit() and Path(f"/proc/{owner}").exists():
                problem = f"session {path} is being run by process {owner}: end that first (Ctrl-C in its terminal)"
                raise SessionError(problem) from None
            if time.monotonic() > end:
                raise SessionError(
                    f"processes of session {path} still run after {LOCK_LIMIT_S:g} s, though its program has ended; find them with "
                    f"`fuser {path / LOCK}` and end them"
                ) from None
            if not told:
                say("the session was killed; waiting for its processes to close the bag")
                told = True
            time.sleep(0.05)
