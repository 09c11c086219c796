# SPDX-License-Identifier: Apache-2.0
"""A session as a short moving picture: the twin on its way over the floor, faces that it stood on, struts by their lengths."""

import io
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sim_core.dynamics.robot import Robot
from sim_core.structure.topology import FACES, STRUTS, TENDONS
from tensegrity_lab.bags.replay import ReplayError
from tensegrity_lab.reports.figure import STRUT_COLORS, halo, new_figure, picture_file

FRAMES_PER_S = 15
LONGEST_REST_S = 0.7
"""Robot time that is shown of a rest."""
LAST_MS = 900
STILL_M = 2e-4
"""Between two moments; less is rest."""
WIDTH_IN, HEIGHT_IN, DPI = 7.2, 4.6, 100
EYE = np.array([0.62, -0.95, 0.55])
"""From the middle of the way to the camera (m)."""
LOOSE, TIGHT = np.array([0.55, 0.66, 0.76]), np.array([0.90, 0.38, 0.12])


Part = tuple[float, Callable[..., Any]]
"""How far it is, and what draws it at a `zorder`."""


class Moment(NamedTuple):
    """The robot at one time: robot time (s), joints (12, 3) and box (3,) in m, rest lengths (6,) in m."""

    time_s: float
    joints_m: np.ndarray
    box_m: np.ndarray
    lengths_m: np.ndarray


class Stand(NamedTuple):
    """From that robot time (s) on it stands on this face."""

    time_s: float
    face: str


def moment_of(time_s: float, robot: Robot) -> Moment:
    """The robot now, as copies."""
    return Moment(time_s, robot.joints_m().copy(), robot.box_m().copy(), robot.rest_lengths_m().copy())


@picture_file
def animate(moments: Sequence[Moment], stands: Sequence[Stand], path: Path, title: str, seconds: float = 8.0) -> None:
    """Write a moving picture that loops.

    Args:
        moments: in order.
        stands: faces, in order.
        path: .webp or .gif.
        title: above it.
        seconds: how long it takes, about.

    Raises:
        ReplayError: there is nothing to show.
    """
    from PIL import Image

    if len(moments) < 2:
        raise ReplayError("the bag holds fewer than two moments: there is nothing to show")
    shown = _frames(moments, round(seconds * FRAMES_PER_S))
    scene = Scene(moments, stands, title)
    images = [Image.open(io.BytesIO(scene.png(moment))).convert("RGB") for moment in shown]
    durations = [1000 // FRAMES_PER_S] * (len(images) - 1) + [LAST_MS]
    images[0].save(path, save_all=True, append_images=images[1:], duration=durations, loop=0, quality=70, method=4)


def _frames(moments: Sequence[Moment], count: int) -> list[Moment]:
    """Evenly in time, with long rests cut short."""
    moved = [float(np.abs(b.joints_m - a.joints_m).max()) > STILL_M for a, b in pairwise(moments)]
    clock, rested = [0.0], 0.0
    for a, b, moves in zip(moments, moments[1:], moved, strict=False):
        step = b.time_s - a.time_s
        rested = 0.0 if moves else rested + step
        clock.append(clock[-1] + (step if moves or rested <= LONGEST_REST_S else 0.0))
    wanted = np.linspace(0.0, clock[-1], count)
    return [moments[at] for at in np.searchsorted(clock, wanted).clip(0, len(moments) - 1)]


class Scene:
    """The floor with its camera, and what is drawn on it."""

    def __init__(self, moments: Sequence[Moment], stands: Sequence[Stand], title: str):
        stands = [stands[0]._replace(time_s=moments[0].time_s), *stands[1:]] if stands else []
        self._stands = stands
        self._title = title
        self._times = np.array([moment.time_s for moment in moments])
        self._way = np.array([moment.joints_m.mean(axis=0) for moment in moments])
        self._feet = []
        for stand in stands:
            at = min(int(np.searchsorted(self._times, stand.time_s)), len(moments) - 1)
            self._feet.append(moments[at].joints_m[list(FACES[stand.face])])
        every = np.concatenate([moment.joints_m for moment in moments[:: max(1, len(moments) // 200)]])
        self._low, self._high = every.min(axis=0), every.max(axis=0)
        target = (self._low + self._high) / 2.0
        self._rest_m = moments[0].lengths_m.mean()
        self._slack = float(np.median([np.linalg.norm(moments[0].joints_m[a] - moments[0].joints_m[b]) for a, b in TENDONS]))
        forward = -EYE / np.linalg.norm(EYE)
        right = np.cross(forward, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        self._axes3 = np.stack([right, np.cross(right, forward), forward])
        reach = float(np.linalg.norm((self._high - self._low)[:2]))
        self.eye_m = target + EYE * max(1.0, reach / 0.42)
        self.figure = new_figure(WIDTH_IN, HEIGHT_IN)
        self.figure.set_layout_engine("none")
        flat = self.flat(every)[:, :2]
        low, high = flat.min(axis=0), flat.max(axis=0)
        middle, half = (low + high) / 2.0, 0.5 * (high - low)
        scale = 1.16 * max(half[0] / (0.80 * WIDTH_IN), half[1] / (0.86 * HEIGHT_IN))
        self._x = (middle[0] - 0.90 * scale * WIDTH_IN, middle[0] + 1.10 * scale * WIDTH_IN)
        self._y = (middle[1] - 0.98 * scale * HEIGHT_IN, middle[1] + 1.02 * scale * HEIGHT_IN)

    def png(self, moment: Moment) -> bytes:
        """One picture."""
        axes = self.new_axes()
        self.draw_floor(axes, moment)
        self.draw_robot(axes, moment)
        self._draw_lengths(moment)
        data = io.BytesIO()
        self.figure.savefig(data, format="png", dpi=DPI)
        return data.getvalue()

    def new_axes(self) -> Any:
        """All of the picture, empty."""
        self.figure.clear()
        axes = self.figure.add_axes((0, 0, 1, 1))
        axes.set_xlim(*self._x)
        axes.set_ylim(*self._y)
        axes.axis("off")
        return axes

    def flat(self, points_m: Any) -> np.ndarray:
        """Picture coordinates and distance of points (n, 3)."""
        seen = (np.atleast_2d(points_m) - self.eye_m) @ self._axes3.T
        return np.column_stack([seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2], seen[:, 2]])

    def draw_floor(self, axes: Any, moment: Moment) -> None:
        """A grid of 5 cm, the faces stood on, the path, and the robot's shadow."""
        from matplotlib.collections import LineCollection, PolyCollection

        pitch = 0.05
        x0, y0 = np.floor((self._low[:2] - 0.45) / pitch) * pitch
        x1, y1 = np.ceil((self._high[:2] + 0.45) / pitch) * pitch
        lines = [self.flat([(x, y0, 0.0), (x, y1, 0.0)])[:, :2] for x in np.arange(x0, x1, pitch)]
        lines += [self.flat([(x0, y, 0.0), (x1, y, 0.0)])[:, :2] for y in np.arange(y0, y1, pitch)]
        axes.add_collection(LineCollection(lines, colors="#e4e8ec", linewidths=0.8, zorder=0))
        stood = [feet for feet, stand in zip(self._feet, self._stands, strict=True) if stand.time_s <= moment.time_s]
        floor = [self.flat(feet * (1.0, 1.0, 0.0))[:, :2] for feet in stood]
        axes.add_collection(PolyCollection(floor, facecolors="#bfd7ea", edgecolors="#5b8db8", alpha=0.5, linewidths=1.0, zorder=1))
        for corners, stand in zip(floor, self._stands, strict=False):
            here = stand is self._now(moment)
            axes.text(
                *corners.mean(axis=0), stand.face, ha="center", va="center", fontsize=11 if here else 9, zorder=4,
                color="#1f4e79" if here else "#6f8fa8", weight="bold" if here else "normal", path_effects=[halo()],
            )  # fmt: skip
        way = self._way[self._times <= moment.time_s] * (1.0, 1.0, 0.0)
        if len(way) > 1:
            axes.plot(*self.flat(way)[:, :2].T, color="#d55e00", lw=1.6, alpha=0.9, zorder=3)
        shadow = [self.flat(moment.joints_m[list(pair)] * (1.0, 1.0, 0.0))[:, :2] for pair in STRUTS]
        style: dict[str, Any] = {"colors": "#8a949e", "linewidths": 5, "alpha": 0.18, "capstyle": "round", "zorder": 2}
        axes.add_collection(LineCollection(shadow, **style))

    def draw_robot(self, axes: Any, moment: Moment) -> None:
        """Farthest first."""
        parts: list[Part] = []

        def line(a: np.ndarray, b: np.ndarray, color: Any, width: float, edge: float = 0.0) -> None:
            flat = self.flat([a, b])
            near = 1.0 / (flat[:, 2].mean() / np.linalg.norm(EYE))

            def draw(zorder: float) -> None:
                if edge:
                    axes.plot(*flat[:, :2].T, color="#22303c", lw=(width + edge) * near, solid_capstyle="round", zorder=zorder)
                axes.plot(*flat[:, :2].T, color=color, lw=width * near, solid_capstyle="round", zorder=zorder + 0.0005)

            parts.append((float(flat[:, 2].mean()), draw))

        joints = moment.joints_m
        for a, b in TENDONS:
            stretch = np.linalg.norm(joints[a] - joints[b]) / self._slack
            tight = float(np.clip((stretch - 0.85) / 0.4, 0.0, 1.0))
            line(joints[a], joints[b], tuple(LOOSE + tight * (TIGHT - LOOSE)), 1.4)
        for strut, (a, b) in enumerate(STRUTS):
            way = joints[b] - joints[a]
            body = joints[a] + way * (0.62 * self._rest_m / np.linalg.norm(way))  # the actuator's body stays as long as it is
            line(body, joints[b], "#c9d1d8", 3.4, 1.2)
            line(joints[a], body, STRUT_COLORS[strut], 7.0, 1.4)
        for joint in joints:
            x, y, far = self.flat(joint)[0]
            style = {"ms": 5.2, "mfc": "#f7f9fa", "mec": "#22303c", "mew": 1.0}
            parts.append((far - 0.004, partial(axes.plot, x, y, "o", **style)))
        for axis, shade in enumerate(("#46525e", "#36404a", "#5d6b78")):
            parts.append(self._box_side(axes, moment.box_m, axis, shade))
        for order, (_, draw) in enumerate(sorted(parts, key=lambda part: -part[0])):
            draw(zorder=10.0 + 0.01 * order)

    def _box_side(self, axes: Any, middle_m: np.ndarray, axis: int, shade: str, half_m: float = 0.019) -> Part:
        """Of the control box: that side of the two across an axis which looks at the camera."""
        corners = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)], dtype=float)
        side = np.insert(corners, axis, np.sign((self.eye_m - middle_m)[axis]), axis=1) * half_m + middle_m
        flat = self.flat(side)
        return float(flat[:, 2].mean()), partial(axes.fill, *flat[:, :2].T, fc=shade, ec="#22303c", lw=0.7)

    def _draw_lengths(self, moment: Moment) -> None:
        """Title, and six bars: how far each strut is from mid stroke."""
        figure = self.figure
        now = self._now(moment)
        figure.text(0.03, 0.945, self._title, fontsize=10.5, color="#22303c", va="center")
        figure.text(0.03, 0.895, f"{moment.time_s:.0f} s of robot time" + (f", last stood on {now.face}" if now else ""),
                    fontsize=9, color="#5d6b78", va="center")  # fmt: skip
        axes = figure.add_axes((0.845, 0.66, 0.125, 0.24))
        strokes = 1e3 * (moment.lengths_m - self._rest_m)
        axes.bar(range(6), strokes, color=STRUT_COLORS, width=0.7)
        axes.axhline(0.0, color="#22303c", lw=0.8)
        axes.set_ylim(-48, 48)
        axes.set_xticks(range(6), [f"S{i}" for i in range(1, 7)], fontsize=7, color="#5d6b78")
        axes.set_yticks([-40, 40], ["−40", "+40"], fontsize=7, color="#5d6b78")
        axes.tick_params(length=0)
        axes.set_title("strokes (mm)", fontsize=8, color="#5d6b78", pad=3)
        axes.patch.set_alpha(0.0)
        for side in axes.spines.values():
            side.set_visible(False)

    def _now(self, moment: Moment) -> Stand | None:
        return next((stand for stand in reversed(self._stands) if stand.time_s <= moment.time_s), None)
