"""What a console knows: plain data, made by `ros_side`, shown by `scene` and by the page."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Places = NDArray[np.float64]
SILENT_S = 3.0
"""Bridge and twin tell something at 2 Hz or more."""
NOWHERE: Places = np.zeros((0, 3))


@dataclass
class Facts:
    """Newest of everything; None and empty: not heard yet.

    Attributes:
        joints_m: twin's joints (12, 3), then its box. tendon_n: (24,). strut_n: (6,), + tension. ground_n: (12,).
        lengths_m: commanded rest lengths, NaN unknown. seen_m: joints as observed (12, 3).
        predicted, observed: faces; source: whose word the observed one is.
        state, reason, holder, link_ok, virtual, time_scale, duty_left_s, battery_v, bag, bag_messages: of the bridge.
        diagnostics: (name, level 0..3, words) of each part.
        rehearsal: odds of the neighbours, as `rehearsal_of` makes it. way_m: planned centres (n, 2). goal_m: place.
        roll, travel: feedback of what is under way, as plain data. last: how the last one ended.
        trial: what a session shows, as plain data. unrehearsed: why there are no odds.
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


@dataclass
class Selection:
    """What was clicked on and not yet done. `target`: a neighbouring face; `place_m`: on the floor."""

    target: str = ""
    place_m: tuple[float, float] | None = None


def document_of(facts: Facts, selection: Selection, now: float) -> dict[str, Any]:
    """What the page shows, for JSON. Args: now: time.monotonic()."""
    silent_s = now - facts.heard
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
            "target": gait.target_face,
            "primitive": gait.primitive,
            "odds": gait.odds,
            "successes": int(gait.successes),
            "members": int(gait.members),
            "ends": [[face, int(count)] for face, count in zip(gait.faces, gait.counts, strict=True)],
        }
        for gait in message.gaits
    ]
    return {"source": message.source_face, "ensemble": message.ensemble, "seconds": message.duration_s, "gaits": gaits}


def _number(value: float) -> float | None:
    return round(float(value), 4) if math.isfinite(value) else None
