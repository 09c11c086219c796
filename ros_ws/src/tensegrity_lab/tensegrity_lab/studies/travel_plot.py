# SPDX-License-Identifier: Apache-2.0
"""Pictures of travels: the floor, seen from above."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_lab.reports.figure import BLUE, GREEN, RED, label_beside, new_figure, picture_file
from tensegrity_lab.studies.travel import Trip


@picture_file
def travel_picture(trip: Trip, path: Path) -> None:
    """One travel, with the faces stood on and the straight way."""
    figure = new_figure(7, 6)
    axes = figure.add_subplot()
    axes.plot(*zip((0.0, 0.0), trip.goal_m, strict=True), color="0.6", lw=1, ls=":", label="straight way")
    _floor(axes, [trip])
    stands = np.array([(x, y) for _, x, y in trip.stands]).reshape(-1, 2)
    axes.plot(*stands.T, ".", color="0.3", ms=5)
    label_beside(axes, stands, [face for face, _, _ in trip.stands])
    end = "arrived" if trip.success else "gave up"
    axes.set_title(f"{end}: {trip.rolls} rolls, {trip.missed} missed, {trip.robot_s:.0f} s of robot time; virtual")
    figure.savefig(path, dpi=110)


@picture_file
def study_picture(panels: Sequence[tuple[str, Sequence[Trip]]], path: Path) -> None:
    """A panel for each (title, trips), two in a row."""
    rows = (len(panels) + 1) // 2
    figure = new_figure(11, 5.2 * rows)
    for number, (title, trips) in enumerate(panels, start=1):
        axes = figure.add_subplot(rows, 2, number)
        _floor(axes, trips)
        axes.set_title(title)
    figure.savefig(path, dpi=100)


def _floor(axes: Any, trips: Sequence[Trip]) -> None:
    for trip in trips:
        color, mark = (BLUE, "o") if trip.success else (RED, "X")
        places = np.array(trip.places_m).reshape(-1, 2)
        axes.plot(*places.T, color=color, lw=1.2)
        axes.plot(*trip.goal_m, "*", color=GREEN, ms=11, mec="black", mew=0.5, zorder=3)
        axes.plot(*places[-1:].T, mark, color=color, ms=6)
    axes.plot(0.0, 0.0, "s", color="black", ms=6)
    marks = [("start", "s", "black"), ("goal", "*", GREEN)]
    marks += [("arrived", "o", BLUE)] * any(trip.success for trip in trips)
    marks += [("gave up", "X", RED)] * any(not trip.success for trip in trips)
    for label, mark, color in marks:
        axes.plot([], [], mark, color=color, label=label)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.1)
    axes.grid(color="0.9")
    axes.set(xlabel="x on the floor (m)", ylabel="y on the floor (m)")
    axes.legend(fontsize="small", loc="best", frameon=False)
