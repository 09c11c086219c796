# SPDX-License-Identifier: Apache-2.0
"""What a console knows: plain data, made by `ros_client`, shown by `scene` and by the page."""

from __future__ import annotations

import math
import secrets
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_core.printable import NAME_MOST, printable

Places = NDArray[np.float64]
SILENT_S = 3.0
"""Bridge and twin tell something at 2 Hz or more."""
MOST = 20
"""Of gaits, and of faces where they end: there are no more faces."""
NOWHERE: Places = np.zeros((0, 3))


@dataclass
class Facts:
    """Newest of everything; None and empty: not heard yet.

    Attributes:
        joints_m: twin's joints (12, 3), then its box.
        tendon_n: (24,).
        strut_n: (6,), + tension.
        ground_n: (12,).
        lengths_m: commanded rest lengths, NaN unknown.
        seen_m: joints as observed (12, 3).
        predicted, observed: faces;
        source: who observed it.
        state, reason, holder, link_ok, virtual, time_scale, duty_left_s, battery_v, bag, bag_messages: of the bridge.
        diagnostics: (name, level 0..3, words) of each part.
        rehearsal: odds of the neighbours, as `rehearsal_of` makes it.
        way_m: planned centres (n, 2).
        goal_m: place.
        roll, travel: feedback of what is under way, as plain data.
        last: how the last one ended.
        trial: what a session shows, as plain data.
        unrehearsed: why there are no odds.
        heard, twin_heard: when (time.monotonic) bridge and twin were heard last.
    """

    joints_m: Places = field(default_factory=lambda: NOWHERE)
    tendon_n: Places = field(default_factory=lambda: np.zeros(24))
    strut_n: Places = field(default_factory=lambda: np.zeros(6))
    ground_n: Places = field(default_factory=lambda: np.zeros(12))
    lengths_m: Places = field(default_factory=lambda: np.full(6, math.nan))
    seen_m: Places = field(default_factory=lambda: NOWHERE)
    predicted: str = ""
    observed: str = ""
    settled: bool = False
    source: str = ""
    state: str = ""
    reason: str = ""
    holder: str = ""
    link_ok: bool = False
    virtual: bool = False
    time_scale: float = 1.0
    duty_left_s: float = math.nan
    battery_v: float = math.nan
    bag: str = ""
    bag_messages: int = 0
    diagnostics: list[tuple[str, int, str]] = field(default_factory=list)
    rehearsal: dict[str, Any] | None = None
    way_m: Places = field(default_factory=lambda: np.zeros((0, 2)))
    goal_m: tuple[float, float] | None = None
    roll: dict[str, Any] | None = None
    travel: dict[str, Any] | None = None
    last: str = ""
    trial: dict[str, Any] | None = None
    unrehearsed: str = ""
    heard: float = -math.inf
    twin_heard: float = -math.inf

    @property
    def face(self) -> str:
        """Where the robot stands: as somebody saw it, else as predicted."""
        return (self.observed if self.settled else "") if self.source else self.predicted


@dataclass(frozen=True)
class Selection:
    """What was clicked on. `target`: a neighbouring face; `stood`: where the robot was then; `place_m`: on the floor."""

    target: str = ""
    place_m: tuple[float, float] | None = None
    stood: str = ""


@dataclass(eq=False)
class Page:
    """A page that is open, and what it selected: no other page's buttons mean that. `number`: its own, that nobody guesses."""

    number: str = field(default_factory=lambda: secrets.token_urlsafe(12))
    selection: Selection = field(default_factory=Selection)

    def selected(self, facts: Facts) -> Selection:
        """What is still selected: a face is not, once the robot stands elsewhere."""
        chosen = self.selection
        return chosen if chosen.stood == facts.face else Selection("", chosen.place_m)


def document_of(facts: Facts, selection: Selection, now: float) -> dict[str, Any]:
    """What a page shows, for JSON: no NaN, no infinity. `now`: time.monotonic()."""
    silent_s = now - facts.heard
    return _finite(_document(facts, selection, now, silent_s))


def _finite(value: Any) -> Any:
    """The same with None for every number that is none."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    return [_finite(one) for one in value] if isinstance(value, (list, tuple)) else value


def _document(facts: Facts, selection: Selection, now: float, silent_s: float) -> dict[str, Any]:
    return {
        "alive": silent_s < SILENT_S,
        "twin_alive": now - facts.twin_heard < SILENT_S,
        "unrehearsed": facts.unrehearsed,
        "state": facts.state,
        "reason": facts.reason,
        "holder": facts.holder,
        "link": facts.link_ok,
        "virtual": facts.virtual,
        "time_scale": facts.time_scale,
        "face": facts.face,
        "predicted": facts.predicted,
        "observed": facts.observed,
        "source": facts.source,
        "duty_left_s": _number(facts.duty_left_s),
        "battery_v": _number(facts.battery_v),
        "bag": facts.bag.rpartition("/")[2],
        "bag_messages": facts.bag_messages,
        "lengths_mm": [_number(1e3 * value) for value in facts.lengths_m],
        "strut_n": [_number(value) for value in facts.strut_n],
        "diagnostics": [list(row) for row in facts.diagnostics],
        "rehearsal": facts.rehearsal if facts.rehearsal and facts.rehearsal["source"] == facts.face else None,
        "roll": facts.roll,
        "travel": facts.travel,
        "last": facts.last,
        "trial": facts.trial,
        "goal_m": facts.goal_m,
        "selected": selection.target,
        "place_m": selection.place_m,
    }


def rehearsal_of(message: Any) -> dict[str, Any]:
    """A `Rehearsal` message as plain data: source, ensemble, and of each gait its odds and where it ended."""
    gaits = [
        {
            "target": printable(gait.target_face, NAME_MOST),
            "primitive": printable(gait.primitive, NAME_MOST),
            "odds": gait.odds if math.isfinite(gait.odds) else 0.0,
            "successes": int(gait.successes),
            "members": int(gait.members),
            "ends": [[printable(face, NAME_MOST), int(n)] for face, n in zip(gait.faces[:MOST], gait.counts[:MOST], strict=False)],
        }
        for gait in message.gaits[:MOST]
    ]
    source, ensemble = printable(message.source_face, NAME_MOST), printable(message.ensemble)
    return {"source": source, "ensemble": ensemble, "seconds": message.duration_s, "gaits": gaits}


def _number(value: float) -> float | None:
    return round(float(value), 4) if math.isfinite(value) else None
