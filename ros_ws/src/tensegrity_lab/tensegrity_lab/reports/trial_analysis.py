# SPDX-License-Identifier: Apache-2.0
"""From the ledgers of sessions to the numbers of a report."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hardware_bridge.recording.bag_on_disk import is_bag, whole_bag
from sim_core.studies.binomial_intervals import Counts, Rate, counts_of, rate_of
from sim_core.studies.model_agreement import Agreement, compare
from tensegrity_lab.errors import SessionError
from tensegrity_lab.reports.success_statistics import (
    Calibration,
    Interval,
    ManyKinds,
    Normality,
    TwoKinds,
    bootstrap_by_prototype,
    calibration,
    lilliefors,
    many_kinds,
    two_kinds,
)
from tensegrity_lab.session_data.bag_messages import lines_in_bag
from tensegrity_lab.session_data.folder import SessionFolder, open_session
from tensegrity_lab.session_data.ledger import LEDGER, read_lines, standing_of
from tensegrity_lab.session_data.ledger_line import Event, Line, Outcome

PAPER = {
    "paper, improved model (real robot)": Counts(14, 31, 39, 40),
    "paper, previous model (real robot)": Counts(0, 0, 13, 40),
}
"""Of 24 trials each: at 100 %, above 80 %, at or above 50 %."""


@dataclass(frozen=True)
class Told:
    """One session's ledger, read, or the trials that a bag holds.

    Attributes:
        path: of the session, or of the bag.
        folder: the session; None of a bag.
        lines: every trial with its outcome, in order, revoked ones too.
        valid: successes and failures that stand.
        voids: how many that stand are void.
        revoked: numbers of those that do not.
    """

    path: Path
    folder: SessionFolder | None
    lines: list[Line]
    valid: list[Line]
    voids: int
    revoked: frozenset[int]


def read_told(path: Path) -> Told:
    """Read a session or a bag. Raises SessionError: it is none, or its ledger contradicts itself."""
    if is_bag(path):
        folder, lines = None, lines_in_bag(path)
        if not lines:
            raise SessionError(f"{path} holds no trials: no session ran while it was recorded; `odds`, `replay` and `play` take it")
    else:
        folder, ledger = open_session(path), path / LEDGER
        lines = read_lines(ledger)[0] if ledger.exists() else []
    standing = standing_of(lines)
    ended = [line for line in lines if line.event is Event.TRIAL]
    return Told(path, folder, ended, standing.valid, len(standing.trials) - len(standing.valid), standing.revoked)


class ChainRates(NamedTuple):
    """Of a cycle: chains that were made and ended as they should; rolls that came onto their face, of those begun."""

    cycle: str
    whole: Rate
    rolls: Rate


class Group:
    """Sessions that are reported together.

    Attributes:
        letter: "a", or "b" for what the others are set against.
        sessions: in the order given.
        lines: all their valid trials of one roll.
        chains: all their valid chains, which count nowhere else.
        names: of the primitives, in the libraries' order.
        virtual: whether these are virtual trials.
        label, title: for people, without and with the letter.
    """

    def __init__(self, paths: Sequence[Path], letter: str = "a"):
        """Read them. Raises SessionError: nothing was tried yet, one was given twice, or virtual and real trials are mixed."""
        self.letter = letter
        self.sessions = [read_told(path) for path in paths]
        names = [whole_bag(told.path.resolve()) for told in self.sessions]
        if len(set(names)) < len(names):
            raise SessionError(f"a session is given twice: {', '.join(map(str, paths))}")
        valid = [line for told in self.sessions for line in told.valid]
        self.lines = [line for line in valid if not line.chain]
        self.chains = [line for line in valid if line.chain]
        if not valid:
            raise SessionError(
                f"no trial of {', '.join(map(str, paths))} has an outcome yet: run `./sixstrut trial {paths[0]}` first; void and "
                "revoked trials do not count"
            )
        kinds = {line.virtual_robot for line in valid}
        if len(kinds) > 1:
            raise SessionError("virtual trials and trials on a real robot do not belong together: report them apart, or --against")
        self.virtual = kinds.pop()
        libraries = {line.library_hash: line.library for line in valid}
        self._several = len(libraries) > 1
        self.label = f"{' + '.join(dict.fromkeys(libraries.values()))}{', virtual' if self.virtual else ''}"
        self.title = f"({letter}) {self.label}"
        order = [
            self._name(told.folder.settings.library, told.folder.settings.library_hash, primitive.name)
            for told in self.sessions
            if told.folder is not None
            for primitive in told.folder.library.primitives
        ]
        tried = {self.name_of(line): (len(line.primitive), line.primitive) for line in self.lines}
        self.names = [name for name in dict.fromkeys([*order, *sorted(tried, key=tried.__getitem__)]) if name in tried]

    def _name(self, library: str, library_hash: str, primitive: str) -> str:
        return f"{library} {library_hash[:4]} {primitive}" if self._several else primitive

    def name_of(self, line: Line) -> str:
        """The primitive or cycle of a trial, as the report names it."""
        return self._name(line.library, line.library_hash, line.primitive)

    @cached_property
    def wins(self) -> list[bool]:
        """Of each line."""
        return [line.outcome is Outcome.SUCCESS for line in self.lines]

    @cached_property
    def strata(self) -> list[int]:
        """Of each line, the number of its primitive."""
        number = {name: index for index, name in enumerate(self.names)}
        return [number[self.name_of(line)] for line in self.lines]

    @cached_property
    def rates(self) -> list[Rate]:
        """Of each primitive, with Clopper–Pearson intervals."""
        return self._rates(self.strata, len(self.names))

    def _rates(self, kinds: Sequence[int], count: int) -> list[Rate]:
        """Of each of so many kinds of trials."""
        trials = np.bincount(kinds, minlength=count)
        wins = np.bincount(kinds, weights=self.wins, minlength=count)
        return [rate_of(int(won), int(n)) for won, n in zip(wins, trials, strict=True)]

    @property
    def values(self) -> list[float]:
        """The primitives' success rates."""
        return [rate.value for rate in self.rates]

    @property
    def counts(self) -> Counts:
        """Primitives at the paper's three levels."""
        return counts_of(self.rates)

    @property
    def overall(self) -> Rate:
        """Of all trials."""
        return rate_of(sum(self.wins), len(self.wins))

    @cached_property
    def robots(self) -> list[str]:
        """The prototypes."""
        return list(dict.fromkeys(line.robot for line in (*self.lines, *self.chains)))

    @cached_property
    def chain_rates(self) -> list[ChainRates]:
        """Of each cycle."""
        rates = []
        for name in dict.fromkeys(map(self.name_of, self.chains)):
            own = [line for line in self.chains if self.name_of(line) == name]
            made, begun = sum(line.rolls for line in own), sum(min(line.rolls + 1, line.wanted) for line in own)
            whole = rate_of(sum(line.outcome is Outcome.SUCCESS for line in own), len(own))
            rates.append(ChainRates(name, whole, rate_of(made, begun)))
        return rates

    def by_prototype(self, primitive: str | None = None) -> Interval | None:
        """Interval of the success rate of a primitive, or of all trials, bootstrapped by prototype; None: there is only one."""
        chosen = [i for i, line in enumerate(self.lines) if primitive in (None, self.name_of(line))]
        return bootstrap_by_prototype([self.robots.index(self.lines[i].robot) for i in chosen], [self.wins[i] for i in chosen])

    @cached_property
    def normality(self) -> Normality | None:
        """Of the primitives' success rates."""
        return lilliefors(self.values)

    @cached_property
    def mirror(self) -> TwoKinds:
        """Gaits by rotations against gaits by reflections, within primitives."""
        return two_kinds(self.strata, [line.proper for line in self.lines], self.wins)

    @cached_property
    def pairs(self) -> list[tuple[str, str]]:
        """Pairs of faces that were tried, sorted."""
        return sorted({(line.source, line.target) for line in self.lines})

    @cached_property
    def _pair_numbers(self) -> list[int]:
        number = {pair: index for index, pair in enumerate(self.pairs)}
        return [number[line.source, line.target] for line in self.lines]

    def pair_rates(self) -> list[Rate]:
        """Of each pair."""
        return self._rates(self._pair_numbers, len(self.pairs))

    @cached_property
    def gait_effect(self) -> ManyKinds | None:
        """Do the 24 pairs differ, within primitives?"""
        return many_kinds(self.strata, self._pair_numbers, self.wins)

    @cached_property
    def agreement(self) -> Agreement:
        """The nominal model's verdict against the outcome."""
        return compare([line.predicted for line in self.lines], self.wins)

    @cached_property
    def calibration(self) -> Calibration | None:
        """The predicted probability against the outcome."""
        return calibration([line.odds for line in self.lines], self.wins)
