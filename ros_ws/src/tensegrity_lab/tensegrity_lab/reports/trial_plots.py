# SPDX-License-Identifier: Apache-2.0
"""Pictures of a report: the paper's Figure 8, every gait at a glance, and predictions against outcomes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import Colormap, LinearSegmentedColormap

from sim_core.structure.symmetry import CARRIERS
from sim_core.structure.topology import PAIRS
from tensegrity_lab.bags.trial_replay import PARTED_M, Course
from tensegrity_lab.reports.figure import (
    BLUE,
    GREEN,
    ORANGE,
    RED,
    draw_intervals,
    draw_lengths,
    draw_rates,
    new_figure,
    picture_file,
)  # fmt: skip
from tensegrity_lab.reports.success_statistics import Calibration
from tensegrity_lab.reports.trial_analysis import Group


@picture_file
def figure_8(groups: Sequence[Group], path: Path) -> None:
    """The paper's Figure 8: (a), (b) success rates of each library's primitives with intervals, (c) both distributions."""
    figure = new_figure(13, 4.2 * len(groups) + 0.4)
    grid = figure.add_gridspec(len(groups), 2, width_ratios=(2.4, 1))
    for row, (group, color) in enumerate(zip(groups, (BLUE, ORANGE), strict=False)):
        axes = figure.add_subplot(grid[row, 0])
        places = np.arange(len(group.names))
        draw_rates(axes, places, group.rates, color, 0.8 * min(1.0, len(places) / 12))
        axes.set_xticks(places, group.names, rotation=90, fontsize="small")
        axes.set(xlim=(-0.6, len(places) - 0.4), ylabel="success rate (%)")
        axes.set_title(f"{group.title}: {group.counts.text}", loc="left", fontsize="medium")
    _distributions(figure.add_subplot(grid[:, 1]), groups)
    figure.savefig(path, dpi=110)


def _distributions(axes: Any, groups: Sequence[Group]) -> None:
    rng = np.random.default_rng(1)  # only where points are drawn
    values = [[100 * value for value in group.values] for group in groups]
    axes.boxplot(values, showfliers=False, widths=0.5, medianprops={"color": "black"})
    for at, (own, color) in enumerate(zip(values, (BLUE, ORANGE), strict=False), start=1):
        axes.plot(at + rng.uniform(-0.12, 0.12, len(own)), own, "o", ms=4, color=color, alpha=0.7)
        axes.plot(at, np.mean(own), "D", ms=7, mfc="white", mec="black", label="mean" if at == 1 else None)
    axes.set_xticks(range(1, len(groups) + 1), [group.title for group in groups])
    axes.set(ylim=(-3, 105), ylabel="success rate of a primitive (%)")
    axes.set_title("(c) quartiles, every primitive, mean", loc="left", fontsize="medium")
    axes.legend(loc="lower right", frameon=False)


@picture_file
def gaits_picture(group: Group, path: Path) -> None:
    """Every primitive (row) in every pair of faces (column): share of successes; below, each pair's rate by direction."""
    columns = [PAIRS.index(pair if pair[0].startswith("TC") else pair[::-1]) for pair in group.pairs]
    wins, trials = np.zeros((2, len(group.names), len(PAIRS)))
    column = dict(zip(group.pairs, columns, strict=True))
    for line, row, won in zip(group.lines, group.strata, group.wins, strict=True):
        at = column[line.source, line.target]
        wins[row, at] += won
        trials[row, at] += 1
    shares = np.divide(wins, trials, out=np.full_like(wins, np.nan), where=trials > 0)
    figure = new_figure(13, 3.6 + 0.2 * len(group.names))
    above, below = figure.subplots(2, 1, height_ratios=(max(1.0, 0.13 * len(group.names)), 1), sharex=True)
    image = above.imshow(shares, cmap=_colors(), vmin=0, vmax=1, aspect="auto", interpolation="nearest")
    above.set_yticks(range(len(group.names)), group.names, fontsize="small")
    above.set_title(f"{group.label}: share of successes; white: not tried; m: a mirrored gait", loc="left", fontsize="medium")
    figure.colorbar(image, ax=above, ticks=[0, 0.5, 1], pad=0.01)
    rates = group.pair_rates()
    for kind, color, off, label in (("TC", BLUE, -0.2, "TC → TO"), ("TO", ORANGE, 0.2, "TO → TC")):
        own = [number for number, pair in enumerate(group.pairs) if pair[0].startswith(kind)]
        if own:
            draw_rates(below, np.array([columns[n] for n in own]) + off, [rates[n] for n in own], color, 0.4, label)
    below.set_xticks(range(len(PAIRS)), [f"{tc}–{to}{'' if CARRIERS[tc, to].proper else ' m'}" for tc, to in PAIRS], rotation=90)
    below.set_ylabel("success rate (%)")
    below.legend(loc="lower right", bbox_to_anchor=(1.0, 0.99), ncol=2, frameon=False)
    figure.savefig(path, dpi=100)


def _colors() -> Colormap:
    return LinearSegmentedColormap.from_list("shares", [RED, BLUE], N=11).with_extremes(bad="white")


@picture_file
def calibration_picture(rows: Sequence[tuple[str, Calibration]], path: Path) -> None:
    """Predicted probability against the share that succeeded, of up to two (label, calibration)."""
    figure = new_figure(5.2, 4.6)
    axes = figure.add_subplot()
    axes.plot([0, 100], [0, 100], color="0.6", lw=1, ls="--")
    for (label, told), color, mark in zip(rows, (BLUE, ORANGE), "os", strict=False):
        places = [100 * one.expected for one in told.bins]
        rates = [one.rate for one in told.bins]
        axes.plot(places, [100 * rate.value for rate in rates], mark, color=color, label=label)
        draw_intervals(axes, places, rates)
    axes.set(xlim=(0, 102), ylim=(0, 102))
    axes.set(xlabel="predicted probability of success, mean of a range (%)", ylabel="trials that succeeded (%)")
    axes.legend(loc="upper left", frameon=False)
    figure.savefig(path, dpi=100)


@picture_file
def course_picture(course: Course, path: Path) -> None:
    """One replayed trial: what was sent, and how far twin and record are apart."""
    line = course.line
    figure = new_figure(10, 6)
    above, below = figure.subplots(2, 1, sharex=True)
    draw_lengths(above, list(course.sent_s), course.lengths_m)
    below.plot(course.times_s, 1e3 * course.apart_m, color=GREEN)
    below.axhline(1e3 * PARTED_M, color="0.4", lw=0.8, ls=":")
    if course.parted_s is not None:
        below.axvline(course.parted_s, color=RED, lw=1, label=f"they part at {course.parted_s:.1f} s")
        below.legend(frameon=False)
    below.set_ylim(bottom=0)
    below.set(xlabel="robot time after the roll was asked for (s)", ylabel="twin to record, mean of joints (mm)")
    above.set_xlabel("")
    kind = "virtual trial" if line.virtual_robot else "trial"
    twin = f"twin: {' → '.join(course.faces)}, {'success' if course.succeeds else 'failure'}"
    figure.suptitle(f"{kind} {line.number}, {line.primitive}: recorded {' → '.join(line.faces)}, {line.outcome}; {twin}")
    figure.savefig(path, dpi=110)
