# SPDX-License-Identifier: Apache-2.0
"""Pictures of what the commands did: readable labels, units, colour-blind safe."""

import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import wraps
from inspect import signature
from itertools import groupby
from pathlib import Path
from typing import Any, ParamSpec

import numpy as np

from hardware_bridge.recording.bag_reader import Session
from sim_core.printable import printable
from sim_core.rolling.roll import RollResult, Sample
from sim_core.structure.topology import STRUTS, TENDONS
from sim_core.studies.binomial_intervals import Rate
from tensegrity_lab.bags.replay import Replay, observed_path

BLUE, ORANGE, GREEN, RED = "#0072b2", "#e69f00", "#009e73", "#d55e00"
STRUT_COLORS = (BLUE, ORANGE, GREEN, RED, "#cc79a7", "#56b4e9")
"""Okabe–Ito: told apart by everyone."""


P = ParamSpec("P")


def picture_file(draw: Callable[P, None]) -> Callable[P, Path | None]:
    """Of a function that draws into the file `path`: in matplotlib's own style whatever the user's is, and whole or not at all.

    A picture that fails is a warning, because what it shows is worth more. Returns the file; None: there is no picture.
    """

    @wraps(draw)
    def drawn(*words: P.args, **options: P.kwargs) -> Path | None:
        given = signature(draw).bind(*words, **options)
        path = given.arguments["path"]
        part = given.arguments["path"] = path.with_stem(f"{path.stem}.part")
        try:
            import matplotlib as mpl

            path.parent.mkdir(parents=True, exist_ok=True)
            with mpl.rc_context():
                mpl.rcdefaults()
                draw(*given.args, **given.kwargs)
            part.replace(path)
        except Exception as error:
            for rest in (part, path):  # nor an old one, that would be taken for this
                with suppress(OSError):
                    rest.unlink(missing_ok=True)
            print(f"warning: no picture {path}: {printable(error)}", file=sys.stderr)
            return None
        return Path(path)

    return drawn


def new_figure(width_in: float, height_in: float) -> Any:
    """A matplotlib figure for a file; pyplot, which would look for a screen, has no part in it."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")


def halo() -> Any:
    """White around letters."""
    from matplotlib.patheffects import withStroke

    return withStroke(linewidth=2.5, foreground="white", alpha=0.8)


def label_beside(axes: Any, points: np.ndarray, texts: Sequence[str]) -> None:
    """Texts beside a path, at points of it, (n, 2)."""
    way = np.gradient(points, axis=0) if len(points) > 1 else np.ones((len(points), 2))
    for point, (dx, dy), text in zip(points, way, texts, strict=True):
        aside = 17.0 * np.array([-dy, dx]) / (np.hypot(dx, dy) or 1.0)
        style = {"ha": "center", "va": "center", "fontsize": "small", "path_effects": [halo()]}
        axes.annotate(text, point, xytext=aside, textcoords="offset points", **style)


def draw_robot(axes: Any, joints_m: np.ndarray, box_m: np.ndarray) -> None:
    """Struts, tendons and box on 3D axes, equal scales."""
    for a, b in TENDONS:
        axes.plot(*joints_m[[a, b]].T, color="0.6", lw=0.8)
    for strut, (a, b) in enumerate(STRUTS):
        axes.plot(*joints_m[[a, b]].T, color=STRUT_COLORS[strut], lw=4, solid_capstyle="round")
    axes.scatter(*box_m, s=60, color="0.3", marker="s")
    middle = joints_m.mean(axis=0)
    x, y = middle[:2]
    ticks = dict.fromkeys(("xticks", "yticks", "zticks"), ())
    axes.set(xlim=(x - 0.15, x + 0.15), ylim=(y - 0.15, y + 0.15), zlim=(0.0, 0.3), box_aspect=(1, 1, 1), **ticks)


def _draw_floor(axes: Any, path_m: np.ndarray) -> None:
    """The floor under the robot, x marked, and where its centre came along; path_m is (n, 3)."""
    x, y = path_m[-1, :2]
    for line in np.linspace(-0.15, 0.15, 5):
        axes.plot([x + line, x + line], [y - 0.15, y + 0.15], [0, 0], color="0.85", lw=0.6, zorder=0)
        axes.plot([x - 0.15, x + 0.15], [y + line, y + line], [0, 0], color="0.85", lw=0.6, zorder=0)
    axes.plot(path_m[:, 0], path_m[:, 1], 0.0 * path_m[:, 0], color="black", lw=1.5)
    axes.quiver(x - 0.15, y - 0.15, 0.0, 0.08, 0.0, 0.0, color="0.3", lw=1.2, arrow_length_ratio=0.3)
    axes.text(x - 0.05, y - 0.15, 0.0, "x", color="0.3", fontsize="small")


def draw_lengths(axes: Any, times_s: Sequence[float], lengths_m: np.ndarray) -> None:
    """Rest lengths of the six struts over time; lengths_m is (n, 6)."""
    for strut in range(6):
        axes.plot(times_s, 1e3 * lengths_m[:, strut], color=STRUT_COLORS[strut], label=f"S{strut + 1}")
    axes.set(xlabel="robot time (s)", ylabel="rest length (mm)")
    axes.legend(ncol=6, fontsize="small", loc="upper center", bbox_to_anchor=(0.5, 1.15), frameon=False)


def draw_rates(axes: Any, places: Any, rates: Sequence[Rate], color: str, width: float = 0.8, label: str | None = None) -> None:
    """Bars of success rates (%) with their intervals, and lines at the paper's levels."""
    axes.bar(places, [100 * rate.value for rate in rates], width, color=color, label=label)
    draw_intervals(axes, places, rates)
    for level in (80, 50):
        axes.axhline(level, color="0.4", lw=0.8, ls=":")
    axes.set_ylim(0, 105)


def draw_intervals(axes: Any, places: Any, rates: Sequence[Rate]) -> None:
    """The intervals of rates (%)."""
    low, value, high = 100 * np.array([(rate.low, rate.value, rate.high) for rate in rates]).T
    off = [np.maximum(value - low, 0.0), np.maximum(high - value, 0.0)]
    axes.errorbar(places, value, off, fmt="none", ecolor="0.25", elinewidth=1, capsize=2)


@picture_file
def roll_picture(result: RollResult, trace: Sequence[Sample], path: Path, title: str) -> None:
    """Four moments of a roll, its strut lengths and its strut forces."""
    figure = new_figure(12, 7)
    grid = figure.add_gridspec(2, 4)
    for column, moment in enumerate(np.linspace(0, len(trace) - 1, 4).astype(int)):
        axes = figure.add_subplot(grid[0, column], projection="3d")
        draw_robot(axes, trace[moment].joints_m, trace[moment].box_m)
        _draw_floor(axes, np.array([sample.joints_m.mean(axis=0) for sample in trace[: moment + 1]]))
        axes.set_title(f"{trace[moment].time_s - trace[0].time_s:.1f} s: {trace[moment].face or 'tipping'}")
    times = [sample.time_s - trace[0].time_s for sample in trace]
    draw_lengths(figure.add_subplot(grid[1, :2]), times, np.array([sample.lengths_m for sample in trace]))
    axes = figure.add_subplot(grid[1, 2:])
    forces = np.array([sample.forces_n for sample in trace])
    for strut in range(6):
        axes.plot(times, -forces[:, strut], color=STRUT_COLORS[strut])
    axes.set(xlabel="robot time (s)", ylabel="strut compression (N)")
    figure.suptitle(f"{title}: {' → '.join(result.faces)}, {'feasible' if result.feasible else 'not feasible'}")
    figure.savefig(path, dpi=110)


@picture_file
def session_picture(session: Session, replay: Replay, path: Path) -> None:
    """A session: path on the floor with faces, strut lengths over time, twin against prototype."""
    twin_t, twin = np.array(replay.times_s), np.array(replay.twin_m)
    seen_t, joints = observed_path(session, replay.origin_s)
    seen = joints.mean(axis=1) if len(joints) else np.zeros((0, 3))
    figure = new_figure(13, 7)
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.25))

    floor = figure.add_subplot(grid[:, 0])
    floor.plot(1e3 * twin[:, 0], 1e3 * twin[:, 1], color=BLUE, lw=2, label="twin")
    if len(seen):
        floor.plot(1e3 * seen[:, 0], 1e3 * seen[:, 1], color=RED, lw=1.5, ls="--", label="virtual prototype")
    stood = [next(checks) for _, checks in groupby(replay.faces, lambda check: check.observed)]
    places = twin[np.searchsorted(twin_t, [check.time_s for check in stood]).clip(0, len(twin) - 1), :2]
    floor.plot(*(1e3 * places.T), "o", color="black", ms=5)
    label_beside(floor, 1e3 * places, [check.observed or "no face" for check in stood])
    floor.set_aspect("equal", adjustable="datalim")
    floor.margins(0.15)
    floor.grid(color="0.9")
    floor.set(xlabel="x on the floor (mm)", ylabel="y on the floor (mm)", title="Path of the centre, with the faces stood on")
    floor.legend(frameon=False)

    draw_lengths(figure.add_subplot(grid[0, 1]), replay.times_s, np.array(replay.lengths_m))
    apart = figure.add_subplot(grid[1, 1])
    if len(seen):
        common = np.column_stack([np.interp(seen_t, twin_t, twin[:, axis]) for axis in range(3)])
        apart.plot(seen_t, 1e3 * np.linalg.norm(common - seen, axis=1), color=GREEN)
    apart.set(xlabel="robot time (s)", ylabel="twin to prototype, centres (mm)")
    apart.set_ylim(bottom=0)
    apart.set_xlim(left=0)
    apart.grid(color="0.9")
    figure.suptitle(f"{session.path.name}, {replay.times_s[-1]:.0f} s of robot time")
    figure.savefig(path, dpi=110)
