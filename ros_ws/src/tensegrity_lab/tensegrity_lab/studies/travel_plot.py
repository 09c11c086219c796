# SPDX-License-Identifier: Apache-2.0
"""Pictures of travels: the floor, seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_lab.reports.figure import new_figure
from tensegrity_lab.studies.travel import Trip

BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"


def travel_picture(trip: Trip, path: Path) -> None:
    """One travel."""
    figure = new_figure(7, 6)
    axes = figure.add_subplot()
    _floor(axes, [trip])
    end = "arrived" if trip.success else "gave up"
    axes.set_title(f"{end}: {trip.rolls} rolls, {trip.missed} missed, {trip.robot_s:.0f} s of robot time; virtual")
    figure.savefig(path, dpi=110)


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
        color = BLUE if trip.success else ORANGE
        places = np.array(trip.places_m).reshape(-1, 2)
        axes.plot(*places.T, color=color, lw=1.2)
        axes.plot(*trip.goal_m, "*", color=GREEN, ms=11, mec="black", mew=0.5, zorder=3)
        if len(places):
            axes.plot(*places[-1], "o" if trip.success else "X", color=color, ms=6)
    axes.plot(0.0, 0.0, "s", color="black", ms=6)
    marks = [("start", "s", "black"), ("goal", "*", GREEN)]
    marks += [("arrived", "o", BLUE)] * any(trip.success for trip in trips)
    marks += [("gave up", "X", ORANGE)] * any(not trip.success for trip in trips)
    for label, mark, color in marks:
        axes.plot([], [], mark, color=color, label=label)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.1)
    axes.grid(color="0.9")
    axes.set_xlabel("x on the floor (m)")
    axes.set_ylabel("y on the floor (m)")
    axes.legend(fontsize="small", loc="best", frameon=False)
