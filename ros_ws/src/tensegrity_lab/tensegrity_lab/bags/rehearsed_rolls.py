# SPDX-License-Identifier: Apache-2.0
"""What rehearsals foretold, and what then happened: read from any bags."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from hardware_bridge.errors import BagError
from hardware_bridge.recording.bag_on_disk import bags_in, is_bag_folder, whole_bag
from hardware_bridge.recording.bag_reader import Session, read_session, seconds_of
from hardware_bridge.recording.bag_types import TOPICS
from hardware_bridge.recording.session_bag import bag_folder
from tensegrity_lab.bags.replay import model_of
from tensegrity_lab.bags.roll_attempts import Attempt, attempts_of
from tensegrity_lab.session_data.bag_messages import lines_in_bag
from tensegrity_lab.session_data.ledger_line import Event, Line, Outcome, utc_ns


class Foretold(NamedTuple):
    """One roll.

    Attributes:
        bag: its name.
        source, target: faces.
        primitive: name.
        odds: share of rehearsals that succeeded.
        members: of these.
        likely: where most of them ended.
        won: the robot was seen on the target after actuation and after the return.
        ended: face it was seen on in the end; None: on none, or nobody looked.
    """

    bag: str
    source: str
    target: str
    primitive: str
    odds: float
    members: int
    likely: str
    won: bool
    ended: str | None

    @property
    def is_chain(self) -> bool:
        """A chain goes from TC to TC: what is seen after its first motion does not tell how it ended."""
        return self.source[:2] == self.target[:2]


def bags_of(paths: Sequence[Path]) -> list[Path]:
    """The bags among, and below, what was given. Raises BagError: there is none."""
    found: list[Path] = []
    for path in paths:
        below = {file.parent if is_bag_folder(file.parent) else file for file in path.rglob("*.mcap")}
        own = (sorted(below) or sorted(path.rglob("*.db3"))) if path.is_dir() and not is_bag_folder(path) else [path]
        if not own:
            raise BagError(f"{path} holds no bag (*.mcap): give a bag, or the folder of a session that the stack ran")
        found += map(whole_bag, own)
    return list(dict.fromkeys(found))


def newest() -> Path:
    """The session or bag that was begun last, of those where they go. Raises BagError: there is none."""
    folder = bag_folder("")
    found = [*bags_in(folder), *(path.parent for path in folder.glob("*/session.yaml") if any(path.parent.rglob("*.mcap")))]
    if not found:
        raise BagError(f"there is no bag in {folder}: give one, or make one with: sixstrut demo")
    return max(found, key=lambda path: path.stat().st_mtime_ns)


def foretold_in(path: Path) -> list[Foretold]:
    """The rehearsed rolls of a bag, in order. Trials that an operator called void, or revoked, are left out. Raises BagError."""
    session = read_session(path, topics=TOPICS)
    session.require("bridge/asked", "bridge/face", "rehearsal")
    tries = attempts_of(session, model_of(session).prototype.strut_length_m)
    rehearsals = sorted(session.of("rehearsal"), key=lambda m: seconds_of(m.header.stamp))
    unsure = _unsure(lines_in_bag(path), tries)
    found = []
    for number, tried in enumerate(tries):
        since = tries[number - 1].began_s if number else float("-inf")
        own = [m for m in rehearsals if since < seconds_of(m.header.stamp) <= tried.began_s]
        if own and own[-1].gaits and tried not in unsure and own[-1].source_face == tried.source and _looked(session, tried):
            found.append(_foretold(path.name, own[-1], tried))
    return found


def _foretold(bag: str, rehearsal: Any, tried: Attempt) -> Foretold:
    wanted = rehearsal.gaits[0]
    gait = rehearsal.source_face, wanted.target_face, wanted.primitive
    likely = wanted.faces[0] if wanted.faces else ""
    return Foretold(
        bag, *gait, float(wanted.odds), int(wanted.members), likely, tried.succeeded(wanted.target_face), tried.returned
    )


def _looked(session: Session, tried: Attempt) -> bool:
    """Somebody saw where the robot stood after this roll was asked for: else nobody knows how it ended."""
    return any(m.settled and seconds_of(m.header.stamp) > tried.began_s for m in session.of("bridge/face"))


def _unsure(lines: Sequence[Line], tries: Sequence[Attempt]) -> set[Attempt]:
    """Tries of trials that are void or were revoked: the first one after each of them began."""
    revoked = {line.number for line in lines if line.event is Event.REVOKE}
    void = [line for line in lines if line.event is Event.TRIAL and (line.outcome is Outcome.VOID or line.number in revoked)]
    after = [[one for one in tries if one.began_s >= 1e-9 * utc_ns(line.began)] for line in void]
    return {rest[0] for rest in after if rest}
