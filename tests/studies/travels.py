# SPDX-License-Identifier: Apache-2.0
"""Travels to random goals, on level ground and on a slope, with travellers that know odds and with one that does not."""

import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from sim_core.files.bounded_reader import read_text
from tensegrity_lab.reports.markdown import table
from tensegrity_lab.stack.simulation_lag import LATE_S
from tensegrity_lab.stack.virtual_stack import VirtualRobot
from tensegrity_lab.studies.travel import Trip, travel

DISTANCE_M = 1.0
SLOPE_DEG = 3.0
TRIPS = "trips.jsonl"
TRAVELLERS = True, False
"""Whether it knows odds. On level ground the gaits of `robust` hardly differ, uphill they do: there odds show their worth."""
Key = tuple[int, float, str, bool]

INTRODUCTION = """\
# A study of travels

How well does the traveller reach a place on the floor? How it chooses its way is told in [the guide](../guide/travel.md).
"""


@dataclass(frozen=True)
class Case:
    """One row of the study."""

    number: int
    goal_m: tuple[float, float]
    incline_deg: float
    library: str
    use_odds: bool

    @property
    def key(self) -> Key:
        """What makes the trip another one than those made."""
        return self.number, self.incline_deg, self.library, self.use_odds

    @property
    def group(self) -> tuple[float, str, bool]:
        """Ground and traveller."""
        return self.incline_deg, self.library, self.use_odds


def cases_of(goals: int, seed: int, library: str = "robust", level: bool = False) -> list[Case]:
    """Every goal on both floors with every traveller; directions drawn by the seed. The robot of a goal is always the same.

    `level`: on level ground only, by the traveller that knows odds.
    What is compared comes together, so that a study that is ended early has something to compare.
    """
    angles = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, goals)
    places = [(round(DISTANCE_M * math.cos(a), 3), round(DISTANCE_M * math.sin(a), 3)) for a in angles]
    floors, travellers = ((0.0,), TRAVELLERS[:1]) if level else ((0.0, SLOPE_DEG), TRAVELLERS)
    return [Case(n, place, deg, library, odds) for deg in floors for n, place in enumerate(places, 1) for odds in travellers]


MOST_BYTES = 256_000_000
"""Of the file of all trips."""


def groups_of(cases: Iterable[Case]) -> list[tuple[float, str, bool]]:
    """Ground and traveller, in the order of the page."""
    return sorted({case.group for case in cases}, key=lambda group: (group[0], group[1], not group[2]))


def words_of(group: tuple[float, str, bool]) -> tuple[str, str]:
    """Ground and traveller, for people."""
    deg, library, odds = group
    return f"inclined by {deg:g}°" if deg else "level", f"{Path(library).stem}, {'knows odds' if odds else 'ignores odds'}"


def read_trips(folder: Path) -> dict[Key, Trip]:
    """The trips that a folder holds, by case; a last line that was cut short is none."""
    found = {}
    path = folder / TRIPS
    for line in read_text(path, MOST_BYTES).splitlines() if path.exists() else ():
        try:
            row = json.loads(line)
        except (ValueError, RecursionError):
            continue
        number = row.pop("number")
        for name in ("goal_m", "faces"):
            row[name] = tuple(row[name])
        for name in ("places_m", "stands"):
            row[name] = tuple(map(tuple, row.get(name, ())))
        trip = Trip(**row)
        found[number, trip.incline_deg, trip.library, trip.use_odds] = trip
    return found


def study(
    cases: Sequence[Case], robot: VirtualRobot, folder: Path, tell: Callable[[str], None], done: Callable[[str], None]
) -> None:
    """Make every trip that the folder does not hold yet, each with a stack of its own. Goes on where it was stopped.

    A trip whose robot took its orders too late is none: it is made again, and all after it, at half the time scale.

    Args:
        cases: the trips.
        robot: its seed is that of the first goal.
        folder: where trips and bags are kept.
        tell: told what goes on.
        done: told of each trip that is over.

    Raises:
        StackError, OSError.
    """
    folder.mkdir(parents=True, exist_ok=True)
    known = read_trips(folder)
    for count, case in enumerate(cases, start=1):
        if case.key not in known:
            head = f"{count} of {len(cases)}, goal {case.number}, {', '.join(words_of(case.group))}: "
            seed = robot.seed + case.number - 1
            own = replace(robot, seed=seed, incline_deg=case.incline_deg, library=case.library, bags=folder)
            trip = _trip(own, case, lambda text, head=head: tell(head + text))  # type: ignore[misc]  # of the default
            while trip.late_s > LATE_S and own.time_scale > 1.0:
                robot, own = (replace(one, time_scale=max(1.0, one.time_scale / 2.0)) for one in (robot, own))
                done(f"{head}orders {trip.late_s:.1f} s of robot time late: again, at {own.time_scale:g} times real time")
                trip = _trip(own, case, lambda text, head=head: tell(head + text))  # type: ignore[misc]  # of the default
            with (folder / TRIPS).open("a", encoding="utf-8") as file:
                file.write(json.dumps({"number": case.number, **asdict(trip)}) + "\n")
            end = "arrived" if trip.success else trip.reason
            done(f"{head}{end}; {trip.rolls} rolls, {trip.missed} missed")


def _trip(robot: VirtualRobot, case: Case, tell: Callable[[str], None]) -> Trip:
    return travel(robot, case.goal_m, tell, use_odds=case.use_odds)


SUMMARY = (
    *("ground", "traveller", "arrived", "rolls", "in chains", "missed", "rolls of an arrival", "rolling time of an arrival"),
    *("median", "m/min", "path ratio"),
)
EVERY = ("goal", "at (m)", "incline", "traveller", "end", "rolls", "in chains", "missed", "left", "rolling time", "m/min")


def summary_of(trips: Sequence[Trip]) -> tuple[object, ...]:
    """Cells of a row: arrived, rolls, in chains, missed; rolls, rolling time, speed and path ratio of those that arrived."""
    arrived = [trip for trip in trips if trip.success]
    rolls, missed = sum(trip.rolls for trip in trips), sum(trip.missed for trip in trips)
    chained = sum(trip.chained for trip in trips)
    head = f"{len(arrived)} of {len(trips)}", rolls, chained, f"{missed} ({100 * missed / max(1, rolls):.0f} %)"
    if not arrived:
        return *head, "–", "–", "–", "–", "–"
    each = np.mean([trip.rolls for trip in arrived])
    time_s = np.mean([trip.robot_s for trip in arrived])
    median_s = np.median([trip.robot_s for trip in arrived])
    speed = np.mean([trip.speed_m_min for trip in arrived])
    return (
        *head,
        f"{each:.1f}",
        f"{time_s:.0f} s",
        f"{median_s:.0f} s",
        f"{speed:.2f}",
        f"{np.mean([trip.ratio for trip in arrived]):.2f}",
    )


def tables_of(found: dict[Case, Trip]) -> tuple[str, str]:
    """Of all travels, and of each."""
    rows = [
        (*words_of(group), *summary_of([trip for case, trip in found.items() if case.group == group])) for group in groups_of(found)
    ]
    return table(SUMMARY, rows, "ll" + "r" * 9), table(EVERY, [_row(*one) for one in found.items()], "rlrll" + "r" * 6)


def level_text(found: dict[Case, Trip], robot: VirtualRobot, command: str) -> str:
    """Travels on level ground, for the page of rolling on."""
    about = (
        f"{len(found)} goals at {DISTANCE_M:g} m, each for a robot of its own at ±{100 * robot.perturbation:g} % with "
        f"{robot.actuators} actuators, the same as in [the study of travels](travel.md), at {robot.time_scale:g} times real time. "
        f"Written by `{command}`."
    )
    return "\n\n".join((about, *tables_of(found)))


def page_of(found: dict[Case, Trip], left: int, robot: VirtualRobot, command: str, picture: str) -> str:
    """The page, as Markdown. `left`: how many travels are still to be made."""
    summary, each = tables_of(found)
    scales = sorted({f"{trip.time_scale:g}" for trip in found.values()}, key=float)
    goals = len({case.number for case in found})
    lines = [
        INTRODUCTION,
        f"This page is written by `{command}`; do not edit it, run the command again.",
        "**All travels are virtual**, through the whole stack: planner, bridge, board's bytes, and a virtual prototype with hidden",
        "errors.",
        *([f"**{len(found)} travels of {len(found) + left}**, so far: the same command goes on."] if left else []),
        "",
        f"{goals} goals at {DISTANCE_M:g} m in directions drawn by a seed, each for a robot of its own at",
        f"±{100 * robot.perturbation:g} % with {robot.actuators} actuators; every goal on level ground and on ground inclined by",
        f"{SLOPE_DEG:g}° in a direction drawn by the robot's seed, of which planner and traveller know nothing. Two travellers:",
        f"as it is, with the library `{Path(robot.library).stem}`, and",
        "for comparison one that takes all its gaits for equally likely, takes them in",
        "turn, and learns nothing (`use_odds:=false`).",
        f"{' or '.join(scales)} times real time; a travel whose prototype took its orders more than {LATE_S:g} s of robot time",
        "late, because the computer was busy, was made again at a slower pace.",
        "",
        summary,
        "",
        "*Rolling time* is robot time from first to last move of all rolls; resting for the actuators' duty is not counted.",
        "*m/min* is the distance won over the rolling time; *in chains* are rolls without a stop between.",
        "*Path ratio* is the way from rest to rest over the distance won; the robot rolls over triangles, so 1 cannot be reached.",
        "",
        f"![paths of all travels on level and on inclined ground]({picture})",
        "",
        "## Every travel",
        "",
        each,
    ]
    return "\n".join(lines) + "\n"


def _row(case: Case, trip: Trip) -> tuple[object, ...]:
    where = f"{case.goal_m[0]:+.2f}, {case.goal_m[1]:+.2f}", f"{case.incline_deg:g}°"
    end = "arrived" if trip.success else trip.reason
    counts = (
        trip.rolls,
        trip.chained,
        trip.missed,
        f"{100 * trip.left_m:.0f} cm",
        f"{trip.robot_s:.0f} s",
        f"{trip.speed_m_min:.2f}",
    )
    return case.number, *where, words_of(case.group)[1], end, *counts
