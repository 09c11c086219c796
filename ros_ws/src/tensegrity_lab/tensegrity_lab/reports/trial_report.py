# SPDX-License-Identifier: Apache-2.0
"""A report of sessions: tables, pictures and a page, all made again by one command."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from sim_core.studies.binomial_intervals import Rate
from tensegrity_lab.reports import html
from tensegrity_lab.reports.hypothesis_tests import RESAMPLES, SEED, MannWhitney, mann_whitney
from tensegrity_lab.reports.robustness_report import rate_document, shown, write_table
from tensegrity_lab.reports.trial_analysis import PAPER, Group, Told
from tensegrity_lab.reports.trial_plots import figure_8, gaits_picture, odds_picture
from tensegrity_lab.session_data.record import COLUMNS, Line, row_of

VIRTUAL = (
    "These are virtual trials. The virtual prototype shares the model's equations, so they test the libraries and this software; "
    "they say nothing about a real robot, and nothing about the paper's claim."
)


EXCHANGEABLE = (
    "An interval treats the 24 different gaits of a primitive as exchangeable, as if one gait had been tried 24 times: right on a "
    "symmetric robot only (see below), and on one prototype they share its errors."
)


class Report:
    """What a report holds, and how it is written.

    Attributes:
        groups: the sessions, and those they are set against, if any.
        test: the Mann–Whitney test between them; None: there is one group.
    """

    def __init__(self, sessions: Sequence[Path], against: Sequence[Path], command: str):
        """Read the sessions. `command`: that makes the report, for people. Raises SessionError, see `Group`."""
        self.groups = [Group(sessions), *([Group(against)] if against else [])]
        self.test: MannWhitney | None = mann_whitney(self.groups[0].values, self.groups[1].values) if against else None
        self._command = command

    def write(self, folder: Path) -> Path:
        """Write tables, pictures and the page, which it returns. Raises OSError."""
        folder.mkdir(parents=True, exist_ok=True)
        write_table(folder / "primitives.csv", self._primitives())
        write_table(folder / "gaits.csv", self._gaits())
        write_table(folder / "tests.csv", self._tests())
        write_table(folder / "trials.csv", self._trials())
        figure_8(self.groups, folder / "figure8.png")
        pictures = []
        for letter, group in zip("ab", self.groups, strict=False):
            pictures.append(folder / f"gaits_{letter}.png")
            gaits_picture(group, pictures[-1])
        told = [(group.label, group.calibration) for group in self.groups]
        odds = folder / "odds.png" if odds_picture(told, folder / "odds.png") else None
        title = "Trials: " + " against ".join(group.label for group in self.groups)
        target = folder / "report.html"
        target.write_text(html.page(title, self._parts(folder, pictures, odds)), encoding="utf-8")
        return target

    # ---- tables -----------------------------------------------------------------------------------------------------

    def _primitives(self) -> Iterable[dict[str, Any]]:
        for letter, group in zip("ab", self.groups, strict=False):
            for name, rate in zip(group.names, group.rates, strict=True):
                bootstrap = group.by_prototype(name)
                low, high = bootstrap or ("", "")
                yield {
                    "group": letter,
                    "primitive": name,
                    **rate_document(rate),
                    "prototypes": len(group.robots),
                    "bootstrap_low": low,
                    "bootstrap_high": high,
                }

    def _gaits(self) -> Iterable[dict[str, Any]]:
        for letter, group in zip("ab", self.groups, strict=False):
            for (source, target), rate in zip(group.pairs, group.pair_rates(), strict=True):
                proper = next(line.proper for line in group.lines if (line.source, line.target) == (source, target))
                kind = "proper" if proper else "improper"
                yield {"group": letter, "source": source, "target": target, "kind": kind, **rate_document(rate)}

    def _trials(self) -> Iterable[dict[str, Any]]:
        for letter, group in zip("ab", self.groups, strict=False):
            for told in group.sessions:
                for line in told.lines:
                    revoked = "true" if line.number in told.revoked else "false"
                    cells = dict(zip(COLUMNS[:-1], row_of(line), strict=True))
                    yield {"group": letter, **cells, "revoked": revoked, "replay": replay_command(told, line)}

    def _tests(self) -> Iterable[dict[str, Any]]:
        def row(group: str, name: str, statistic: float, p: float, more: str = "") -> dict[str, Any]:
            return {"group": group, "test": name, "statistic": statistic, "p": p, "more": more}

        if self.test is not None:
            more = f"A = {self.test.effect:.4f}; permutation p {self.test.permutation_p:.4g}"
            yield row("a, b", "Mann-Whitney U, asymptotic, ties corrected", self.test.u, self.test.p, more)
        for letter, group in zip("ab", self.groups, strict=False):
            if group.normality is not None:
                yield row(letter, "Kolmogorov-Smirnov, Lilliefors", *group.normality)
            yield row(letter, "proper against improper, Cochran-Mantel-Haenszel", group.mirror.chi2, group.mirror.p)
            if group.gait_effect is not None:
                effect = group.gait_effect
                yield row(letter, "pairs of faces, permutation", effect.statistic, effect.p, f"{effect.kinds} pairs")

    # ---- the page ---------------------------------------------------------------------------------------------------

    def _parts(self, folder: Path, pictures: Sequence[Path], odds: Path | None) -> Iterable[str]:
        if any(group.virtual for group in self.groups):
            yield html.paragraph(VIRTUAL, "virtual")
        yield html.table(
            ("", "session", "robot", "library", "planned", "valid", "void", "revoked", "first", "last"),
            [_session_row(letter, told) for letter, group in zip("ab", self.groups, strict=False) for told in group.sessions],
        )
        yield html.paragraph(f"Made by: {self._command}", "note")
        yield html.heading("Success rates: the paper's Figure 8")
        yield html.picture(folder / "figure8.png", "success rates of primitives, and their distributions")
        yield self._counts()
        yield html.paragraph(f"Intervals: 95 %, Clopper–Pearson. {EXCHANGEABLE}", "note")
        yield from self._prototypes()
        yield html.heading("Tests")
        yield self._test_table()
        yield html.heading("Is the robot's symmetry broken?")
        for group, path in zip(self.groups, pictures, strict=True):
            yield html.picture(path, f"every gait of {group.label}")
        yield self._symmetry()
        yield html.heading("Prediction and outcome")
        yield self._agreement()
        if odds is not None:
            yield html.picture(odds, "predicted probability against the share of successes")
        yield html.heading("Primitives")
        for letter, group in zip("ab", self.groups, strict=False):
            rows = [(name, rate.successes, rate.trials, shown(rate)) for name, rate in zip(group.names, group.rates, strict=True)]
            yield html.folded(
                f"({letter}) {group.label}: {len(rows)} primitives",
                html.table(("primitive", "successes", "trials", "rate and 95 % interval"), rows),
            )
        yield html.heading("Trials, each with the command that replays it")
        for letter, group in zip("ab", self.groups, strict=False):
            for told in group.sessions:
                yield html.folded(f"({letter}) {told.path.name}: {len(told.lines)} trials", _trial_table(told))

    def _counts(self) -> str:
        rows = [(f"({letter}) {g.label}", *g.counts, shown(g.overall)) for letter, g in zip("ab", self.groups, strict=False)]
        rows += [(name, *counts, "") for name, counts in PAPER.items()]
        return html.table(("", "at 100 %", "above 80 %", "at or above 50 %", "primitives", "all trials"), rows)

    def _prototypes(self) -> Iterable[str]:
        for letter, group in zip("ab", self.groups, strict=False):
            interval = group.by_prototype()
            if interval is None:
                text = "one prototype: nothing here tells how much another one would differ."
            else:
                few = " With fewer than ten prototypes this interval is itself uncertain." if len(group.robots) < 10 else ""
                text = (
                    f"{len(group.robots)} prototypes; all trials, bootstrapped by prototype ({RESAMPLES} resamples, seed {SEED}): "
                    f"[{100 * interval.low:.2f}, {100 * interval.high:.2f}] %.{few}"
                )
            yield html.paragraph(f"({letter}) {text}")

    def _test_table(self) -> str:
        rows: list[Sequence[object]] = []
        if self.test is not None:
            test = self.test
            rows.append(
                (
                    "Mann–Whitney U, two-sided, between the primitives' rates of (a) and (b)",
                    f"{test.u:g}",
                    p_text(test.p),
                    f"effect A = {test.effect:.3f}: so often a primitive of (a) beats one of (b), ties halved; n = {test.n_a}, "
                    f"{test.n_b}; p with tie and continuity correction; by {RESAMPLES} permutations (seed {SEED}): "
                    f"{p_text(test.permutation_p)}",
                )
            )
        for letter, group in zip("ab", self.groups, strict=False):
            told = group.normality
            name = f"Kolmogorov–Smirnov, ({letter}) normal?"
            if told is None:
                rows.append((name, "", "", "fewer than four primitives, or all rates equal: not computable"))
            else:
                how = f"Lilliefors: mean and variance are the sample's own; p by Monte Carlo, {RESAMPLES} samples, seed {SEED}"
                rows.append((name, f"{told.distance:.4f}", p_text(told.p), how))
        if self.test is None:
            rows.append(("Mann–Whitney U", "", "", "needs a second group: --against SESSION"))
        return html.table(("test", "statistic", "p", ""), rows)

    def _symmetry(self) -> str:
        rows: list[Sequence[object]] = []
        for letter, group in zip("ab", self.groups, strict=False):
            mirror, effect = group.mirror, group.gait_effect
            (proper, improper), (proper_n, improper_n) = mirror.wins, mirror.trials
            told = f"proper {proper} of {proper_n}, improper {improper} of {improper_n}"
            if math.isnan(mirror.chi2):
                rows.append((f"({letter}) rotations against reflections", "", "", f"{told}: not computable"))
            else:
                how = f"{told}; Cochran–Mantel–Haenszel within primitives"
                rows.append((f"({letter}) rotations against reflections", f"{mirror.chi2:.3f}", p_text(mirror.p), how))
            if effect is None:
                rows.append(
                    (f"({letter}) pairs of faces differ", "", "", "not computable: outcomes do not vary within a primitive")
                )
            else:
                how = f"{effect.kinds} pairs; outcomes shuffled within primitives, {RESAMPLES} times, seed {SEED}"
                rows.append((f"({letter}) pairs of faces differ", f"{effect.statistic:.2f}", p_text(effect.p), how))
        return html.table(("on a symmetric robot these do not differ", "statistic", "p", ""), rows)

    def _agreement(self) -> str:
        head = ("", "predicted, succeeded", "predicted, failed", "not predicted, succeeded", "not predicted, failed")
        rows: list[Sequence[object]] = []
        for letter, group in zip("ab", self.groups, strict=False):
            told = group.agreement
            odds = group.calibration
            score = (
                "" if odds is None else f"{100 * odds.expected:.1f} % expected, {100 * odds.observed:.1f} % came; {odds.brier:.4f}"
            )
            rows.append((f"({letter}) {group.label}", *told, _percent(told.precision), _percent(told.agreement), score))
        return html.table((*head, "precision", "agreement", "predicted probability; Brier score"), rows) + html.paragraph(
            "Predicted: the nominal model says that the gait is feasible. Odds: of the robustness study on perturbed prototypes. "
            "The Brier score is the mean squared difference of predicted probability and outcome; 0.25 is a coin's.",
            "note",
        )


def replay_command(told: Told, line: Line) -> str:
    """Replays one trial; empty if it is in no bag."""
    if not line.bag:
        return ""
    return f"./sixstrut replay {shlex.quote(str(told.folder.bags / line.bag))} --trial {line.number}"


def p_text(p: float) -> str:
    """A p value for people."""
    return f"{p:.2g}" if p >= 1e-4 else f"{p:.1e}"


def _session_row(letter: str, told: Told) -> Sequence[object]:
    settings = told.folder.settings
    times = [line.began for line in told.lines if line.began]
    first, last = (min(times)[:16], max(times)[:16]) if times else ("", "")
    counts = (len(told.folder.plan), len(told.valid), len(told.voids), len(told.revoked))
    return (f"({letter})", told.path.name, settings.robot, settings.library, *counts, first, last)


def _trial_table(told: Told) -> str:
    rows = [
        (
            line.number,
            f"{line.primitive} {line.source} → {line.target}{'' if line.proper else ' m'}",
            "" if math.isnan(line.odds) else f"{100 * line.odds:.0f} %",
            f"{line.outcome}{', revoked' if line.number in told.revoked else ''}",
            " → ".join(line.faces),
            line.reason,
            replay_command(told, line),
        )
        for line in told.lines
    ]
    return html.table(("", "gait", "predicted", "outcome", "faces", "why", "replay"), rows, codes=(6,))


def summary_of(report: Report) -> str:
    """The report's key numbers for a terminal."""
    lines = []
    for letter, group in zip("ab", report.groups, strict=False):
        lines.append(f"({letter}) {group.label}: {group.counts.text}")
        lines.append(f"    all trials: {_spread(group.overall)}; {len(group.robots)} prototype(s)")
    if report.test is not None:
        lines.append(f"Mann–Whitney U = {report.test.u:g}, p = {p_text(report.test.p)}, effect A = {report.test.effect:.3f}")
    if any(group.virtual for group in report.groups):
        lines.append(VIRTUAL)
    return "\n".join(lines)


def _spread(rate: Rate) -> str:
    return f"{rate.successes} of {rate.trials}, {shown(rate).strip()}"


def _percent(rate: float | None) -> str:
    return "none predicted" if rate is None else f"{100 * rate:.1f} %"
