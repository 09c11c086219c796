# SPDX-License-Identifier: Apache-2.0
"""What a console knows: plain data, made by `ros_client`, shown by `scene` and by the page."""

import math
import secrets
from dataclasses import dataclass, field
from typing import Any

import msgspec
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
    """Newest of everything; None, NaN and empty: not heard yet."""

    heard: float = -math.inf  # when (time.monotonic), of the bridge
    twin_heard: float = -math.inf
    # of the bridge
    state: str = ""
    reason: str = ""
    holder: str = ""
    link_ok: bool = False
    virtual: bool = False
    duty_left_s: float = math.nan
    battery_v: float = math.nan
    bag: str = ""
    bag_messages: int = 0
    lengths_m: Places = field(default_factory=lambda: np.full(6, math.nan))  # commanded
    diagnostics: list[tuple[str, int, str]] = field(default_factory=list)  # of each part: name, level 0..3, words
    # where the robot stands, and who saw it there
    observed: str = ""
    settled: bool = False
    source: str = ""
    detail: str = ""  # what was seen: of an inertial sensor, how sure it is, or why it does not know
    predicted: str = ""
    # of the twin: twelve joints, then the box, in m; forces in N, of struts + tension
    joints_m: Places = field(default_factory=lambda: NOWHERE)
    tendon_n: Places = field(default_factory=lambda: np.zeros(24))
    strut_n: Places = field(default_factory=lambda: np.full(6, math.nan))
    ground_n: Places = field(default_factory=lambda: np.zeros(12))
    # rolls and travels: feedback of what is under way, how the last one ended
    rehearsal: dict[str, Any] | None = None  # see `rehearsal_of`
    unrehearsed: str = ""  # why there is none, or that it is under way
    roll: dict[str, Any] | None = None
    travel: dict[str, Any] | None = None
    last: str = ""
    way_m: Places = field(default_factory=lambda: np.zeros((0, 2)))  # planned centres
    goal_m: tuple[float, float] | None = None
    keep_in_m: Places = field(default_factory=lambda: np.zeros((0, 2)))  # corners of the keep-in area; none: there is none
    trial: dict[str, Any] | None = None  # what a session shows

    @property
    def face(self) -> str:
        """Where the robot stands: as somebody saw it, else as predicted."""
        return (self.observed if self.settled else "") if self.source else self.predicted

    @property
    def known_rehearsal(self) -> dict[str, Any] | None:
        """The rehearsal, if it is of the face that the robot stands on."""
        return self.rehearsal if self.rehearsal is not None and self.rehearsal["source"] == self.face else None


TOLD = (
    "state", "reason", "holder", "link_ok", "virtual", "duty_left_s", "battery_v", "bag", "bag_messages", "diagnostics",
    "face", "observed", "source", "detail", "predicted", "unrehearsed", "roll", "travel", "last", "trial",
)  # fmt: skip
"""Of the facts, what a page is told as it is."""


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
    """What a page shows, for `json_of`. `now`: time.monotonic()."""
    return {name: getattr(facts, name) for name in TOLD} | {
        "alive": now - facts.heard < SILENT_S,
        "twin_alive": now - facts.twin_heard < SILENT_S,
        "lengths_mm": (1e3 * facts.lengths_m).tolist(),
        "strut_n": facts.strut_n.tolist(),
        "rehearsal": facts.known_rehearsal,
        "selected": selection.target,
        "place_m": selection.place_m,
    }


def json_of(document: Any) -> str:
    """For a page, with null for NaN and infinity."""
    return msgspec.json.encode(document).decode()


def rehearsal_of(message: Any) -> dict[str, Any]:
    """A `Rehearsal` message as plain data: from where, and of each gait how many members rolled and where they ended."""
    gaits = [
        {
            "target": printable(gait.target_face, NAME_MOST),
            "primitive": printable(gait.primitive, NAME_MOST),
            "successes": int(gait.successes),
            "members": int(gait.members),
            "ends": [[printable(face, NAME_MOST), int(n)] for face, n in zip(gait.faces[:MOST], gait.counts[:MOST], strict=False)],
        }
        for gait in message.gaits[:MOST]
    ]
    return {"source": printable(message.source_face, NAME_MOST), "gaits": gaits}
