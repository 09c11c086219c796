# SPDX-License-Identifier: Apache-2.0
"""Pictures of a report: the paper's Figure 8, every gait at a glance, and predictions against outcomes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import Colormap, ListedColormap

from sim_core.structure.symmetry import CARRIERS
from sim_core.structure.topology import PAIRS
from sim_core.studies.binomial_intervals import Rate
from tensegrity_lab.bags.trial_replay import PARTED_M, Course
from tensegrity_lab.reports.figure import draw_lengths, new_figure
from tensegrity_lab.reports.hypothesis_tests import Calibration
from tensegrity_lab.reports.trial_analysis import Group

BLUE, ORANGE, GREY = "#0072b2", "#e69f00", "#999999"
LEVELS = (80, 50)


def figure_8(groups: Sequence[Group], path: Path) -> None:
    """The paper's Figure 8: (a), (b) success rates of each library's primitives with intervals, (c) both distributions."""
    figure = new_figure(13, 4.2 * len(groups) + 0.4)
    grid = figure.add_gridspec(len(groups), 2, width_ratios=(2.4, 1))
    for row, (group, color) in enumerate(zip(groups, (BLUE, ORANGE), strict=False)):
        axes = figure.add_subplot(grid[row, 0])
        places = np.arange(len(group.names))
        axes.bar(places, [100 * value for value in group.values], color=color)
        _intervals(axes, places, group.rates)
        for level in LEVELS:
            axes.axhline(level, color="0.4", lw=0.8, ls=":")
        axes.set_xticks(places, group.names, rotation=90, fontsize="small")
        axes.set_xlim(-0.6, max(12, len(places)) - 0.4)
        axes.set_ylim(0, 105)
        axes.set_ylabel("success rate (%)")
        axes.set_title(f"({'ab'[row]}) {group.label}: {group.counts.text}", loc="left", fontsize="medium")
    _distributions(figure.add_subplot(grid[:, 1]), groups)
    figure.savefig(path, dpi=110)


def _intervals(axes: Any, places: Any, rates: Sequence[Rate]) -> None:
    values = np.array([100 * rate.value for rate in rates])
    off = [values - [100 * rate.low for rate in rates], [100 * rate.high for rate in rates] - values]
    axes.errorbar(places, values, np.abs(off), fmt="none", ecolor="0.25", elinewidth=1, capsize=2)


def _distributions(axes: Any, groups: Sequence[Group]) -> None:
    rng = np.random.default_rng(1)  # only where points are drawn
    values = [[100 * value for value in group.values] for group in groups]
    axes.boxplot(values, showfliers=False, widths=0.5, medianprops={"color": "black"})
    for at, (own, color) in enumerate(zip(values, (BLUE, ORANGE), strict=False), start=1):
        axes.plot(at + rng.uniform(-0.12, 0.12, len(own)), own, "o", ms=4, color=color, alpha=0.7)
        axes.plot(at, np.mean(own), "D", ms=7, mfc="white", mec="black", label="mean" if at == 1 else None)
    axes.set_xticks(range(1, len(groups) + 1), [f"({'ab'[i]}) {group.label}" for i, group in enumerate(groups)])
    axes.set_ylim(-3, 105)
    axes.set_ylabel("success rate of a primitive (%)")
    axes.set_title("(c) quartiles, every primitive, mean", loc="left", fontsize="medium")
    axes.legend(loc="lower right", frameon=False)


def gaits_picture(group: Group, path: Path) -> None:
    """Every primitive (row) in every pair of faces (column): share of successes; below, each pair's rate by direction."""
    column = {pair: index for index, pair in enumerate(PAIRS)}
    shares = np.full((len(group.names), len(PAIRS)), np.nan)
    wins, trials = np.zeros_like(shares), np.zeros_like(shares)
    for line, row, won in zip(group.lines, group.strata, group.wins, strict=True):
        at = column[_pair(line.source, line.target)]
        wins[row, at] += won
        trials[row, at] += 1
    np.divide(wins, trials, out=shares, where=trials > 0)
    figure = new_figure(13, 3.6 + 0.2 * len(group.names))
    above, below = figure.subplots(2, 1, height_ratios=(max(1.0, 0.13 * len(group.names)), 1), sharex=True)
    image = above.imshow(shares, cmap=_colors(), vmin=0, vmax=1, aspect="auto", interpolation="nearest")
    above.set_yticks(range(len(group.names)), group.names, fontsize="small")
    above.set_title(f"{group.label}: share of successes; white: not tried; m: a mirrored gait", loc="left", fontsize="medium")
    figure.colorbar(image, ax=above, ticks=[0, 0.5, 1], pad=0.01)
    for way, (color, off) in enumerate(((BLUE, -0.2), (ORANGE, 0.2))):
        chosen = [
            (column[_pair(*pair)], rate)
            for pair, rate in zip(group.pairs, group.pair_rates(), strict=True)
            if pair[0].startswith(("TC", "TO")[way])
        ]
        if chosen:
            places = np.array([at for at, _ in chosen]) + off
            rates = [rate for _, rate in chosen]
            below.bar(places, [100 * rate.value for rate in rates], 0.4, color=color, label=("TC → TO", "TO → TC")[way])
            _intervals(below, places, rates)
    below.set_xticks(range(len(PAIRS)), [f"{tc}–{to}{'' if CARRIERS[tc, to].proper else ' m'}" for tc, to in PAIRS], rotation=90)
    below.set_ylim(0, 105)
    below.set_ylabel("success rate (%)")
    below.legend(loc="lower right", bbox_to_anchor=(1.0, 0.99), ncol=2, frameon=False)
    figure.savefig(path, dpi=100)


def _pair(source: str, target: str) -> tuple[str, str]:
    return (source, target) if source.startswith("TC") else (target, source)


def _colors() -> Colormap:
    steps = np.linspace(0, 1, 11)[:, None]
    failed, won = np.array([0.835, 0.369, 0.0]), np.array([0.0, 0.447, 0.698])
    shades = np.column_stack([(1 - steps) * failed + steps * won, np.ones(11)])
    return ListedColormap(shades.tolist()).with_extremes(bad="white")


def odds_picture(rows: Sequence[tuple[str, Calibration | None]], path: Path) -> bool:
    """Predicted probability against the share that succeeded, of up to two (label, calibration); False: nothing was predicted."""
    if all(told is None for _, told in rows):
        return False
    figure = new_figure(5.2, 4.6)
    axes = figure.add_subplot()
    axes.plot([0, 100], [0, 100], color="0.6", lw=1, ls="--")
    for (label, told), color, mark in zip(rows, (BLUE, ORANGE), "os", strict=False):
        if told is None:
            continue
        places = [100 * expected for _, _, _, expected, _ in told.bins]
        rates = [_rate_of(share, count) for _, _, count, _, share in told.bins]
        axes.plot(places, [100 * rate.value for rate in rates], mark, color=color, label=label)
        _intervals(axes, places, rates)
    axes.set_xlim(0, 102)
    axes.set_ylim(0, 102)
    axes.set_xlabel("predicted probability of success, mean of a range (%)")
    axes.set_ylabel("trials that succeeded (%)")
    axes.legend(loc="upper left", frameon=False)
    figure.savefig(path, dpi=100)
    return True


def _rate_of(share: float, count: int) -> Rate:
    from sim_core.studies.binomial_intervals import rate_of

    return rate_of(round(share * count), count)


def course_picture(course: Course, path: Path) -> None:
    """One replayed trial: what was sent, and how far twin and record are apart."""
    line = course.line
    figure = new_figure(10, 6)
    above, below = figure.subplots(2, 1, sharex=True)
    draw_lengths(above, list(course.sent_s), course.lengths_m)
    below.plot(course.times_s, 1e3 * course.apart_m, color="#009e73")
    below.axhline(1e3 * PARTED_M, color="0.4", lw=0.8, ls=":")
    if course.parted_s is not None:
        below.axvline(course.parted_s, color="#d55e00", lw=1, label=f"they part at {course.parted_s:.1f} s")
        below.legend(frameon=False)
    below.set_ylim(bottom=0)
    below.set_xlabel("robot time after the roll was asked for (s)")
    below.set_ylabel("twin to record, mean of joints (mm)")
    above.set_xlabel("")
    kind = "virtual trial" if line.virtual_robot else "trial"
    twin = f"twin: {' → '.join(course.faces)}, {'success' if course.succeeds else 'failure'}"
    figure.suptitle(f"{kind} {line.number}, {line.primitive}: recorded {' → '.join(line.faces)}, {line.outcome}; {twin}")
    figure.savefig(path, dpi=110)
