# SPDX-License-Identifier: Apache-2.0
"""A robustness study as the paper's Figure 8: success of each primitive, how many have which rate, and what kills gaits."""

from pathlib import Path
from typing import Any

import numpy as np

from sim_core.structure.roll_classes import TC_TO, TO_TC
from sim_core.studies.attribution import Attribution
from sim_core.studies.robustness import Study
from tensegrity_lab.reports.figure import BLUE, ORANGE, RED, draw_rates, new_figure, picture_file


@picture_file
def robustness_picture(study: Study, blame: Attribution | None, path: Path, title: str) -> None:
    """Bars sorted by rate with their intervals, a histogram, and, if known, the uncertainties to blame."""
    if blame is not None and not blame.failed:
        blame = None  # nothing failed: nothing is to blame
    figure = new_figure(12, 6)
    grid = figure.add_gridspec(2, 2, width_ratios=(2.2, 1))
    axes = figure.add_subplot(grid[:, 0])
    rows = sorted(zip(study.primitives, study.rates, strict=True), key=lambda row: -row[1].value)
    for roll_class, color, label in ((TC_TO, BLUE, "TC → TO"), (TO_TC, ORANGE, "TO → TC")):
        places = [at for at, (primitive, _) in enumerate(rows) if primitive.roll_class is roll_class]
        if places:
            draw_rates(axes, places, [rows[at][1] for at in places], color, label=label)
    axes.set_xticks(range(len(rows)), [primitive.name for primitive, _ in rows], rotation=90, fontsize="small")
    axes.set(ylabel="success rate over gaits and prototypes (%)", xlabel="primitive; bars: 95 % Clopper–Pearson intervals")
    axes.set_title(study.counts.text, loc="left", fontsize="medium")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncol=2, frameon=False)

    histogram = figure.add_subplot(grid[0, 1] if blame is not None else grid[:, 1])
    values = np.array([100 * rate.value for _, rate in rows])
    counts, edges = np.histogram(values, np.arange(0, 101, 10))
    histogram.bar(edges[:-1], counts, width=10, align="edge", color="0.6", edgecolor="white")
    histogram.set(xlabel="success rate (%)", ylabel="primitives", xlim=(0, 100))
    histogram.yaxis.get_major_locator().set_params(integer=True)
    if blame is not None:
        _draw_blame(figure.add_subplot(grid[1, 1]), blame)
    figure.suptitle(title)
    figure.savefig(path, dpi=110)


def _draw_blame(axes: Any, blame: Attribution) -> None:
    rows, count = blame.blames[::-1], max(1, len(blame.failures))
    at = np.arange(len(rows))
    axes.barh(at + 0.2, [100 * row.vanish_without / count for row in rows], 0.4, color=RED, label="vanish without it")
    axes.barh(at - 0.2, [100 * row.come_alone / count for row in rows], 0.4, color="#56b4e9", label="come with it alone")
    axes.set_yticks(at, [row.group for row in rows])
    axes.set(xlim=(0, 100), xlabel=f"of {len(blame.failures)} failed trials looked at (%)")
    axes.legend(fontsize="small", loc="lower right")
