# SPDX-License-Identifier: Apache-2.0
"""The trials of sessions and bags, as a fit wants them: one robot, known gaits, successes and failures."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hardware_bridge.recording.bag_on_disk import is_bag, whole_bag
from hardware_bridge.recording.bag_reader import read_session
from hardware_bridge.recording.bag_types import TOPICS
from sim_core.dynamics.model import Model, build_model
from sim_core.gaits.library import Gait, Library, load_library
from sim_core.structure.elements import PREVIOUS
from sim_core.structure.policy import MOST_STAGES, checked_policy, in_stages
from sim_core.structure.topology import NEIGHBOURS
from sim_core.studies.ensemble_fit import Roll, Seen
from tensegrity_lab.bags.replay import model_of
from tensegrity_lab.bags.roll_attempts import attempts_of
from tensegrity_lab.errors import SessionError
from tensegrity_lab.reports.trial_analysis import read_told
from tensegrity_lab.session_data.bag_messages import lines_in_bag
from tensegrity_lab.session_data.ledger_line import Event, Line, Outcome

UNNAMED = "a bag's robot"


@dataclass(frozen=True)
class Tries:
    """What was tried on one robot.

    Attributes:
        sources: names of the sessions and bags.
        robot: its name.
        virtual: virtual trials.
        library: of all gaits.
        seen: the trials.
        names: the primitive of each.
        chains: trials that are left out: a fit takes single rolls.
    """

    sources: tuple[str, ...]
    robot: str
    virtual: bool
    library: Library
    seen: tuple[Seen, ...]
    names: tuple[str, ...]
    chains: int = 0

    @property
    def facts(self) -> dict[str, Any]:
        """For scripts and for the record."""
        counts = {"trials": len(self.seen), "successes": sum(one.won for one in self.seen)}
        facts = {"sessions": list(self.sources), "robot": self.robot, "virtual": self.virtual, **counts}
        return facts | ({"chains_left_out": self.chains} if self.chains else {})

    @property
    def counts(self) -> dict[tuple[str, str, str], tuple[int, int]]:
        """(primitive, source, target) -> (successes, trials)."""
        keys = [(name, one.roll.source, one.roll.target) for name, one in zip(self.names, self.seen, strict=True)]
        tried = Counter(keys)
        won = Counter(key for key, one in zip(keys, self.seen, strict=True) if one.won)
        return {key: (won[key], count) for key, count in tried.items()}


def read_tries(paths: Sequence[Path], model: Model, library: str | None = None) -> Tries:
    """Read sessions' folders and bags.

    Args:
        paths: sessions' folders and bags.
        model: that is to be fitted.
        library: of bags; default: the shipped one that their records name, or `robust`.

    Raises:
        SessionError: nothing to fit to, several robots or libraries, virtual and real trials mixed, or gaits of another model.
        LibraryError, BagError.
    """
    doubles = [path for path, count in Counter(whole_bag(path.resolve()) for path in paths).items() if count > 1]
    if doubles:
        raise SessionError(f"{doubles[0]} is given twice: its trials would count twice")
    parts = [_bag(path, model, library) if is_bag(path) or path.is_file() else _session(path) for path in paths]
    for what, values in (
        ("robots", {part.robot for part in parts}),
        ("libraries", {part.library.hash for part in parts}),
        ("kinds, virtual and real", {str(part.virtual) for part in parts}),
    ):
        if len(values) > 1:
            raise SessionError(
                f"the trials are of several {what}: {', '.join(sorted(values))}; fit one robot and library at a time"
            )
    first = parts[0]
    _require_model(first, model)
    seen = tuple(one for part in parts for one in part.seen)
    if not seen:
        raise SessionError(
            f"no trial of {', '.join(map(str, paths))} has an outcome (void and revoked ones and chains do not count): run "
            "`sixstrut trial`"
        )
    sources = tuple(source for part in parts for source in part.sources)
    names, chains = tuple(name for part in parts for name in part.names), sum(part.chains for part in parts)
    return Tries(sources, first.robot, first.virtual, first.library, seen, names, chains)


def _require_model(tries: Tries, model: Model) -> None:
    known = {model.hash, build_model(model.prototype, kind=PREVIOUS).hash}
    if tries.library.model_hash not in known:
        raise SessionError(
            f"the gaits of {', '.join(tries.sources)} (library {tries.library.name}) are of model {tries.library.model_hash}, "
            f"not of {model.hash}: give the --prototype that they were made for"
        )


def _session(path: Path) -> Tries:
    told = read_told(path)
    assert told.folder is not None
    settings = told.folder.settings
    return _of_lines(path.name, settings.robot, settings.virtual_robot, told.folder.library, told.valid, bool(settings.computed))


def _bag(path: Path, model: Model, library: str | None) -> Tries:
    lines = lines_in_bag(path)
    if lines:
        shelf = load_library(library or lines[0].library)
        revoked = {line.number for line in lines if line.event is Event.REVOKE}
        valid = [line for line in lines if line.event is Event.TRIAL and line.number not in revoked]
        foreign = [line for line in valid if line.library_hash != shelf.hash]
        if foreign:
            raise SessionError(
                f"{path.name} has trials of library {foreign[0].library} ({foreign[0].library_hash}), not of {shelf.name} "
                f"({shelf.hash}): give that file with --library"
            )
        valid = [line for line in valid if line.outcome in (Outcome.SUCCESS, Outcome.FAILURE)]
        robots = {line.robot for line in valid} or {UNNAMED}
        return _of_lines(path.name, ", ".join(sorted(robots)), all(line.virtual_robot for line in valid), shelf, valid, False)
    return _unplanned(path, model, load_library(library or "robust"))


def _of_lines(source: str, robot: str, virtual: bool, library: Library, lines: Sequence[Line], placed: bool) -> Tries:
    chains = sum(bool(line.chain) for line in lines)
    lines = [line for line in lines if not line.chain]
    rolls = (Roll(line.source, line.target, checked_policy(line.policy_mm, 10_000, MOST_STAGES)) for line in lines)
    seen = tuple(Seen(roll, line.outcome is Outcome.SUCCESS, placed) for roll, line in zip(rolls, lines, strict=True))
    return Tries((source,), robot, virtual, library, seen, tuple(line.primitive for line in lines), chains)


def _unplanned(path: Path, model: Model, library: Library) -> Tries:
    """A bag without records of trials: rolls that somebody asked for, with the faces that were seen."""
    session = read_session(path, topics=TOPICS)
    session.require("bridge/asked", "bridge/face")
    recorded = model_of(session).hash
    if recorded != model.hash:
        raise SessionError(f"{path.name} was recorded with model {recorded}, not {model.hash}: give its --prototype")
    seen, names = [], []
    for attempt in attempts_of(session, model.prototype.strut_length_m):
        gait = _gait(library, attempt.source, attempt.policy)
        if gait is not None:
            roll = Roll(gait.source, gait.target, gait.policy)
            seen.append(Seen(roll, attempt.succeeded(gait.target), False))
            names.append(gait.primitive.name)
    virtual = any(m.source == "prototype" for m in session.of("bridge/face"))
    return Tries((path.name,), UNNAMED, virtual, library, tuple(seen), tuple(names))


def _gait(library: Library, source: str | None, policy: tuple[int, ...]) -> Gait | None:
    """The library's gait from there that rests at that policy; None: there is none."""
    gaits = (gait for target in NEIGHBOURS.get(source or "", ()) for gait in library.gaits(source or "", target))
    return next((gait for gait in gaits if in_stages(gait.policy)[-1] == policy), None)
