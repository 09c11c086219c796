# SPDX-License-Identifier: Apache-2.0
"""A report of sessions: tables, pictures and a page, all made again by one command."""

import math
import shlex
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sim_core.structure.symmetry import carrier
from tensegrity_lab.reports import html
from tensegrity_lab.reports.robustness_report import rate_document, spread
from tensegrity_lab.reports.success_statistics import RESAMPLES, SEED, mann_whitney
from tensegrity_lab.reports.trial_analysis import PAPER, Group, Told
from tensegrity_lab.reports.trial_plots import calibration_picture, figure_8, gaits_picture
from tensegrity_lab.session_data.csv_tables import cells_of, write_table
from tensegrity_lab.session_data.ledger_line import Line

VIRTUAL = (
    "These are virtual trials. The virtual prototype shares the model's equations, so they test the libraries and this software; "
    "they say nothing about a real robot, and nothing about the paper's claim."
)


EXCHANGEABLE = (
    "An interval treats the 24 different gaits of a primitive as exchangeable, as if one gait had been tried 24 times: right on a "
    "symmetric robot only (see below), and on one prototype they share its errors."
)


CHAINS = (
    "A chain is one trial: made if it came onto all its faces and rests on the last one. Intervals: 95 %, Clopper–Pearson. Rolls "
    "of one chain are not independent, so their interval is somewhat too narrow. Nothing else on this page counts chains."
)


class Test(NamedTuple):
    """One test. `group`: whose, "a", "b" or both. `statistic`, `p`: NaN: they cannot be computed, and `more` says why."""

    group: str
    test: str
    statistic: float
    p: float
    more: str


class TrialReport:
    """What a report holds, and how it is written.

    Attributes:
        groups: the sessions, and those they are set against, if any.
        test: the Mann–Whitney test between them; None: there is one group.
    """

    def __init__(self, sessions: Sequence[Path], against: Sequence[Path], command: str):
        """Read the sessions. `command`: that makes the report, for people. Raises SessionError, see `Group`."""
        self.groups = [Group(sessions), *([Group(against, "b")] if against else [])]
        self._rolled = [group for group in self.groups if group.lines]
        self.test = mann_whitney(*(group.values for group in self._rolled)) if len(self._rolled) == 2 else None
        self._command = command

    def write(self, folder: Path) -> Path:
        """Write tables, pictures and the page, which it returns. Raises OSError."""
        folder.mkdir(parents=True, exist_ok=True)
        write_table(folder / "trials.csv", self._trials())
        if any(group.chains for group in self.groups):
            write_table(folder / "chains.csv", self._chains())
        if self._rolled:
            self._write_rolls(folder)
        title = "Trials: " + " against ".join(group.label for group in self.groups)
        target = folder / "report.html"
        target.write_text(html.page(title, self._parts(folder)), encoding="utf-8")
        return target

    def _write_rolls(self, folder: Path) -> None:
        """What is known of single rolls."""
        write_table(folder / "primitives.csv", self._primitives())
        write_table(folder / "gaits.csv", self._gaits())
        tests = [*self._comparisons(), *self._symmetry()]
        write_table(folder / "tests.csv", (test._asdict() for test in tests if not math.isnan(test.statistic)))
        figure_8(self._rolled, folder / "figure8.png")
        for group in self._rolled:
            gaits_picture(group, folder / f"gaits_{group.letter}.png")
        predicted = [(group.label, group.calibration) for group in self._rolled if group.calibration is not None]
        if predicted:
            calibration_picture(predicted, folder / "odds.png")

    # ---- tables -----------------------------------------------------------------------------------------------------

    def _primitives(self) -> Iterator[dict[str, Any]]:
        for group in self._rolled:
            for name, rate in zip(group.names, group.rates, strict=True):
                low, high = group.by_prototype(name) or ("", "")
                row = {"group": group.letter, "primitive": name, **rate_document(rate), "prototypes": len(group.robots)}
                yield row | {"bootstrap_low": low, "bootstrap_high": high}

    def _gaits(self) -> Iterator[dict[str, Any]]:
        for group in self._rolled:
            for (source, target), rate in zip(group.pairs, group.pair_rates(), strict=True):
                kind = "proper" if carrier(source, target).proper else "improper"
                yield {"group": group.letter, "source": source, "target": target, "kind": kind, **rate_document(rate)}

    def _chains(self) -> Iterator[dict[str, Any]]:
        for group in self.groups:
            for cycle, *rates in group.chain_rates:
                for what, rate in zip(("chains", "rolls"), rates, strict=True):
                    yield {"group": group.letter, "cycle": cycle, "of": what, **rate_document(rate)}

    def _trials(self) -> Iterator[dict[str, Any]]:
        for group in self.groups:
            for told in group.sessions:
                for line in told.lines:
                    revoked, replay = line.number in told.revoked, replay_command(told, line)
                    yield {"group": group.letter, **cells_of(line), "revoked": revoked, "replay": replay}

    def _comparisons(self) -> Iterator[Test]:
        """Between the groups, and of the distribution of each."""
        name = "Mann-Whitney U, two-sided, asymptotic, ties corrected"
        if self.test is None:
            yield Test("a, b", name, math.nan, math.nan, "needs a second group: --against SESSION")
        else:
            test = self.test
            more = (
                f"between the primitives' rates; effect A = {test.effect:.4f}: so often a primitive of (a) beats one of (b), ties "
                f"halved; n = {test.n_a}, {test.n_b}; permutation p {test.permutation_p:.4g} ({RESAMPLES} of seed {SEED})"
            )
            yield Test("a, b", name, test.u, test.p, more)
        for group in self._rolled:
            more = f"normal? mean and variance are the sample's own; p by Monte Carlo, {RESAMPLES} samples, seed {SEED}"
            if group.normality is None:
                more = "fewer than four primitives, or all rates equal: not computable"
            yield Test(group.letter, "Kolmogorov-Smirnov, Lilliefors", *(group.normality or (math.nan, math.nan)), more)

    def _symmetry(self) -> Iterator[Test]:
        """What does not differ on a symmetric robot."""
        for group in self._rolled:
            mirror, effect = group.mirror, group.gait_effect
            (proper, improper), (proper_n, improper_n) = mirror.wins, mirror.trials
            more = f"proper {proper} of {proper_n}, improper {improper} of {improper_n}; within primitives"
            more += ": not computable" if math.isnan(mirror.chi2) else ""
            yield Test(group.letter, "proper against improper, Cochran-Mantel-Haenszel", mirror.chi2, mirror.p, more)
            more = "not computable: outcomes do not vary within a primitive"
            if effect is not None:
                more = f"{effect.kinds} pairs; outcomes shuffled within primitives, {RESAMPLES} times, seed {SEED}"
            statistic, p = (math.nan, math.nan) if effect is None else effect[:2]
            yield Test(group.letter, "pairs of faces, permutation", statistic, p, more)

    # ---- the page ---------------------------------------------------------------------------------------------------

    def _parts(self, folder: Path) -> Iterator[str]:
        if any(group.virtual for group in self.groups):
            yield html.paragraph(VIRTUAL, "virtual")
        yield html.table(
            ("", "session", "robot", "library", "planned", "valid", "void", "revoked", "first", "last"),
            [_session_row(group.letter, told) for group in self.groups for told in group.sessions],
        )
        yield html.paragraph(f"Made by: {self._command}", "note")
        if any(group.chains for group in self.groups):
            yield html.heading("Chains")
            rows = [(group.title, c.cycle, spread(c.whole), spread(c.rolls)) for group in self.groups for c in group.chain_rates]
            yield html.table(("", "cycle", "chains made", "rolls made, of those begun"), rows)
            yield html.paragraph(CHAINS, "note")
        if self._rolled:
            yield from self._roll_parts(folder)
        yield html.heading("Trials, each with the command that replays it")
        for group in self.groups:
            for told in group.sessions:
                yield html.folded(f"({group.letter}) {told.path.name}: {len(told.lines)} trials", _trial_table(told))

    def _roll_parts(self, folder: Path) -> Iterator[str]:
        yield html.heading("Success rates: the paper's Figure 8")
        yield html.picture(folder / "figure8.png", "success rates of primitives, and their distributions")
        rows: list[Sequence[object]] = [(group.title, *group.counts, spread(group.overall)) for group in self._rolled]
        rows += [(name, *counts, "") for name, counts in PAPER.items()]
        yield html.table(("", "at 100 %", "above 80 %", "at or above 50 %", "primitives", "all trials"), rows)
        yield html.paragraph(f"Intervals: 95 %, Clopper–Pearson. {EXCHANGEABLE}", "note")
        for group in self._rolled:
            yield html.paragraph(f"({group.letter}) {_prototypes_text(group)}")
        yield html.heading("Tests")
        yield _test_table("", self._comparisons())
        yield html.heading("Is the robot's symmetry broken?")
        for group in self._rolled:
            yield html.picture(folder / f"gaits_{group.letter}.png", f"every gait of {group.label}")
        yield _test_table("on a symmetric robot these do not differ", self._symmetry())
        yield html.heading("Prediction and outcome")
        yield self._agreement()
        if any(group.calibration is not None for group in self._rolled):
            yield html.picture(folder / "odds.png", "predicted probability against the share of successes")
        yield html.heading("Primitives")
        for group in self._rolled:
            shares = [(name, spread(rate)) for name, rate in zip(group.names, group.rates, strict=True)]
            table = html.table(("primitive", "successes, rate and 95 % interval"), shares)
            yield html.folded(f"{group.title}: {len(shares)} primitives", table)

    def _agreement(self) -> str:
        rows: list[Sequence[object]] = []
        for group in self._rolled:
            told, found, score = group.agreement, group.calibration, ""
            if found is not None:
                score = f"{100 * found.expected:.1f} % expected, {100 * found.observed:.1f} % came; {found.brier:.4f}"
            rows.append((group.title, *told, _percent(told.precision), _percent(told.agreement), score))
        head = ("", "predicted, succeeded", "predicted, failed", "not predicted, succeeded", "not predicted, failed")
        note = (
            "Predicted: the nominal model says that the gait is feasible. Probability: of the robustness study on perturbed "
            "prototypes. The Brier score is the mean squared difference of predicted probability and outcome; 0.25 is a coin's."
        )
        table = html.table((*head, "precision", "agreement", "predicted probability; Brier score"), rows)
        return table + html.paragraph(note, "note")


def _prototypes_text(group: Group) -> str:
    interval, count = group.by_prototype(), len(group.robots)
    if interval is None:
        return "one prototype: nothing here tells how much another one would differ."
    few = " With fewer than ten prototypes this interval is itself uncertain." if count < 10 else ""
    return (
        f"{count} prototypes; all trials, bootstrapped by prototype ({RESAMPLES} resamples, seed {SEED}): "
        f"[{100 * interval.low:.2f}, {100 * interval.high:.2f}] %.{few}"
    )


def _test_table(about: str, tests: Iterable[Test]) -> str:
    rows = []
    for test in tests:
        numbers = ("", "") if math.isnan(test.statistic) else (f"{test.statistic:.6g}", p_text(test.p))
        rows.append((f"({test.group}) {test.test}", *numbers, test.more))
    return html.table((about or "test", "statistic", "p", ""), rows)


def replay_command(told: Told, line: Line) -> str:
    """Replays one trial; empty if it is in no bag."""
    if not line.bag:
        return ""
    bag = told.path if told.folder is None else told.folder.bags / line.bag
    return f"./sixstrut replay {shlex.quote(str(bag))} --trial {line.number}"


def p_text(p: float) -> str:
    """A p value for people."""
    return f"{p:.2g}" if p >= 1e-4 else f"{p:.1e}"


def _session_row(letter: str, told: Told) -> Sequence[object]:
    times = [line.began for line in told.lines if line.began]
    first, last = (min(times)[:16], max(times)[:16]) if times else ("", "")
    planned = "" if told.folder is None else len(told.folder.plan)
    counts = (planned, len(told.valid), told.voids, len(told.revoked))
    robots, libraries = (", ".join(dict.fromkeys(getattr(line, key) for line in told.lines)) for key in ("robot", "library"))
    return (f"({letter})", told.path.name, robots, libraries, *counts, first, last)


def _trial_table(told: Told) -> str:
    rows = [
        (
            line.number,
            f"{line.name.replace('→', ' → ')}{'' if line.proper else ' m'}",
            "" if math.isnan(line.odds) else f"{100 * line.odds:.0f} %",
            f"{line.ended}{', revoked' if line.number in told.revoked else ''}",
            " → ".join(line.faces),
            line.reason,
            replay_command(told, line),
        )
        for line in told.lines
    ]
    return html.table(("", "gait", "predicted", "outcome", "faces", "why", "replay"), rows, codes=(6,))


def summary_of(report: TrialReport) -> str:
    """The report's key numbers for a terminal."""
    lines = []
    for group in report.groups:
        lines.append(f"{group.title}: {group.counts.text if group.lines else 'chains alone'}")
        if group.lines:
            lines.append(f"    all trials: {spread(group.overall)}; {len(group.robots)} prototype(s)")
        lines += [f"    chains by {c.cycle}: {spread(c.whole)}; rolls {spread(c.rolls)}" for c in group.chain_rates]
    if report.test is not None:
        lines.append(f"Mann–Whitney U = {report.test.u:g}, p = {p_text(report.test.p)}, effect A = {report.test.effect:.3f}")
    if any(group.virtual for group in report.groups):
        lines.append(VIRTUAL)
    return "\n".join(lines)


def _percent(rate: float | None) -> str:
    return "none predicted" if rate is None else f"{100 * rate:.1f} %"
