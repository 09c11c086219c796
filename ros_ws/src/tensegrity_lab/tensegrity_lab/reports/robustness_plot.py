# SPDX-License-Identifier: Apache-2.0
"""A robustness study as the paper's Figure 8: success of each primitive, how many have which rate, and what kills gaits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sim_core.structure.symmetry import TC_TO
from sim_core.studies.attribution import Attribution
from sim_core.studies.robustness import Study
from tensegrity_lab.reports.figure import new_figure

COLORS = {True: "#0072b2", False: "#e69f00"}
LEVELS = (80, 50)


def robustness_picture(study: Study, blame: Attribution | None, path: Path, title: str) -> None:
    """Bars sorted by rate with their intervals, a histogram, and, if known, the uncertainties to blame."""
    if blame is not None and not blame.failed:
        blame = None  # nothing failed: nothing is to blame
    figure = new_figure(12, 6)
    grid = figure.add_gridspec(2, 2, width_ratios=(2.2, 1))
    axes = figure.add_subplot(grid[:, 0])
    rows = sorted(zip(study.primitives, study.rates, strict=True), key=lambda row: -row[1].value)
    for is_tc, label in ((True, "TC → TO"), (False, "TO → TC")):
        places = [at for at, (primitive, _) in enumerate(rows) if (primitive.roll_class is TC_TO) == is_tc]
        if places:
            chosen = [rows[at][1] for at in places]
            values = np.array([100 * rate.value for rate in chosen])
            off = [values - [100 * rate.low for rate in chosen], [100 * rate.high for rate in chosen] - values]
            axes.bar(places, values, color=COLORS[is_tc], label=label)
            axes.errorbar(places, values, np.abs(off), fmt="none", ecolor="0.25", elinewidth=1, capsize=2)
    for level in LEVELS:
        axes.axhline(level, color="0.4", lw=0.8, ls=":")
    axes.set_xticks(range(len(rows)), [primitive.name for primitive, _ in rows], rotation=90, fontsize="small")
    axes.set_ylim(0, 105)
    axes.set_ylabel("success rate over gaits and prototypes (%)")
    axes.set_xlabel("primitive; bars: 95 % Clopper–Pearson intervals")
    axes.set_title(study.counts.text)
    axes.legend(loc="lower left", ncol=2)

    histogram = figure.add_subplot(grid[0, 1] if blame is not None else grid[:, 1])
    values = np.array([100 * rate.value for _, rate in rows])
    counts, edges = np.histogram(values, np.arange(0, 101, 10))
    histogram.bar(edges[:-1], counts, width=10, align="edge", color="0.6", edgecolor="white")
    histogram.set_xlabel("success rate (%)")
    histogram.set_ylabel("primitives")
    histogram.set_xlim(0, 100)
    histogram.yaxis.get_major_locator().set_params(integer=True)
    if blame is not None:
        _draw_blame(figure.add_subplot(grid[1, 1]), blame)
    figure.suptitle(title)
    figure.savefig(path, dpi=110)


def _draw_blame(axes: Any, blame: Attribution) -> None:
    rows, count = blame.blames[::-1], max(1, len(blame.failures))
    at = np.arange(len(rows))
    axes.barh(at + 0.2, [100 * row.vanish_without / count for row in rows], 0.4, color="#d55e00", label="vanish without it")
    axes.barh(at - 0.2, [100 * row.come_alone / count for row in rows], 0.4, color="#56b4e9", label="come with it alone")
    axes.set_yticks(at, [row.group for row in rows])
    axes.set_xlim(0, 100)
    axes.set_xlabel(f"of {len(blame.failures)} failed trials looked at (%)")
    axes.legend(fontsize="small", loc="lower right")
