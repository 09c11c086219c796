# SPDX-License-Identifier: Apache-2.0
"""One stream of events from the bridge's two topics, through late joining and restarts of the bridge. Knows no ROS.

Within a topic events arrive in order; between the two topics they may not. Whoever joins late gets the last faces of the past,
which lie before the first write that it hears of. A bridge that starts again numbers from 1 again.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from sim_core.printable import printable
from sim_core.twin.follower import Event, Observed, Order, Pace, Sent, impossible
from sim_core.twin.live_bridge import FRESH_S

SILENT_NS = 2_000_000_000
"""A stream of which nothing came for so long may be replaced by another one; a heartbeat comes every 50 ms of robot time."""
FRESH_NS = round(FRESH_S * 1e9)
"""An event whose stamp is older was played from a recording, or its bridge's clock is wrong."""
MOST_FACES = 50
MOST_WAITING = 20_000


class Arrival(NamedTuple):
    """Whose event it is, and when it came.

    Attributes:
        session: of the bridge.
        stamp_ns: when it happened, by the bridge's wall clock.
        wall_ns, steady_ns: when it came, by our wall clock and by one that nobody sets.
    """

    session: str
    stamp_ns: int
    wall_ns: int
    steady_ns: int

    @property
    def fresh(self) -> bool:
        """It happened just now."""
        return abs(self.wall_ns - self.stamp_ns) <= FRESH_NS


@dataclass(frozen=True)
class Begin:
    """The stream begins (again) here. `face`: on which the robot was last seen before; None if nobody had seen it."""

    face: str | None


class EventStream:
    """Puts what arrives into the order in which it happened.

    A stream is not given out before `begin`, or a face from after its first write: the faces on which the robot stood before
    belong before it, but often arrive later.

    A stream has the session of its bridge. While one lives, events of others are strangers', and ignored. Events of old bags are of
    the session without a name, in which numbers and stamps tell an old bridge's events from a new one's. An event that cannot have
    happened is refused: no number in it becomes work.

    Attributes:
        session: of the stream that is followed; empty before the first, and of an old bag.
        refused: events that could not have happened.
        strangers: writes of other sessions.
    """

    def __init__(self, patience: int = 200, mid_stroke_m: float = 0.234, warn: Callable[[str], None] = lambda text: None):
        """Args: patience: as `Order`'s. mid_stroke_m: of the struts. warn: told for people, once for every cause."""
        self._patience = patience
        self._mid_stroke_m = mid_stroke_m
        self._warn = warn
        self._warned: set[str] = set()
        self.session = ""
        self.refused = self.strangers = 0
        self._followed: Arrival | None = None
        self._pace = Pace()
        self._faces_of_others: deque[tuple[str, Observed]] = deque(maxlen=MOST_FACES)
        self._order: Order | None = None
        self._lost_before = 0
        self._first_seq = 0
        self._last_sent = (0, 0, 0)
        self._renewed = False
        self._last_face_seq = 0
        self._waiting: deque[Sent] = deque(maxlen=MOST_WAITING)
        self._waiting_faces: deque[Observed] = deque(maxlen=MOST_FACES)

    @property
    def lost(self) -> int:
        """Events that never came."""
        return self._lost_before + (self._order.lost if self._order else 0)

    @property
    def waiting(self) -> bool:
        """Writes have come that only `begin`, or a new face, will let out."""
        return bool(self._waiting)

    def renew(self) -> None:
        """Another bridge was found: its first write begins a new stream, whatever its number."""
        self._renewed = True

    def sent(self, event: Sent, arrival: Arrival) -> list[Event | Begin]:
        """A write or a heartbeat; returns what is now due."""
        if reason := impossible(event, self._mid_stroke_m):
            return self._refuse(reason)
        if self._followed is None or arrival.session != self.session:
            if not self._may_follow(arrival):
                return self._ignore(arrival.session)
            self._follow(arrival.session)
            begins = True
        else:
            back = self._goes_back(event)
            jump = "" if back else self._pace.refuses(event, arrival.steady_ns)
            named = bool(arrival.session)
            if (jump or (back and named)) and self._alive(arrival):
                return self._refuse(jump or back)
            begins = bool(back or jump or (self._renewed and not named))
        if begins:
            self._pace = Pace()
            self._pace.refuses(event, arrival.steady_ns)
            self._waiting.clear()
            self._lost_before, self._order = self.lost, None
        self._renewed = False
        self._followed = arrival
        self._last_sent = (event.seq, event.robot_time_ns, arrival.stamp_ns)
        if self._order is not None:
            return list(self._order.add(event))
        self._waiting.append(event)
        return self.begin() if any(face.seq > self._waiting[0].seq for face in self._waiting_faces) else []

    def observed(self, event: Observed, arrival: Arrival) -> list[Event | Begin]:
        """A face observation; returns what is now due. Only writes say which session is followed."""
        if reason := impossible(event, self._mid_stroke_m):
            return self._refuse(reason)
        if self._followed is None or arrival.session != self.session:
            self._faces_of_others.append((arrival.session, event))
            return []
        seq, _, sent_stamp_ns = self._last_sent
        new = not arrival.session and (self._renewed or event.seq <= seq)
        of_new_bridge = new and arrival.stamp_ns > sent_stamp_ns
        if self._order is None or of_new_bridge:
            self._waiting_faces.append(event)
            return self.begin() if self._waiting and event.seq > self._waiting[0].seq else []
        if event.seq <= self._last_face_seq:
            return []
        if reason := self._pace.refuses(event, arrival.steady_ns):
            return self._refuse(reason)
        self._last_face_seq = event.seq
        if event.seq < self._first_seq:  # very late: begin again from there
            return [Begin(event.face)] if event.face else []
        return list(self._order.add(event))

    def _goes_back(self, event: Sent) -> str:
        """How a write lies before the last one; empty: it does not. Of a session without a name: its bridge was started again."""
        seq, robot_time_ns, _ = self._last_sent
        if event.seq > seq and event.robot_time_ns >= robot_time_ns:
            return ""
        return f"event {event.seq} at {event.robot_time_ns / 1e9:.3f} s goes back behind {seq} at {robot_time_ns / 1e9:.3f} s"

    def _may_follow(self, arrival: Arrival) -> bool:
        """Whether another session takes the place of the followed one: that is silent, or old, or known to have ended."""
        followed = self._followed
        if followed is None or self._renewed or not self._alive(arrival):
            return True
        return arrival.fresh and not followed.fresh

    def _alive(self, arrival: Arrival) -> bool:
        """Whether something of the followed session has come lately."""
        return self._followed is not None and arrival.steady_ns - self._followed.steady_ns <= SILENT_NS

    def _follow(self, session: str) -> None:
        self.session = session
        self._last_sent = (0, 0, 0)
        self._last_face_seq = 0
        self._waiting_faces.clear()
        self._waiting_faces.extend(face for of, face in self._faces_of_others if of == session)
        self._faces_of_others.clear()

    def _ignore(self, session: str) -> list[Event | Begin]:
        self.strangers += 1
        other, own = (printable(name, 40) or "without a name" for name in (session, self.session))
        self._tell("strangers", f"events of another bridge session ({other}) are ignored: that which is followed ({own}) lives")
        return []

    def _refuse(self, reason: str) -> list[Event | Begin]:
        self.refused += 1
        self._tell("refused", f"an event of the bridge's stream is refused: {reason}")
        return []

    def _tell(self, cause: str, text: str) -> None:
        if cause not in self._warned:
            self._warned.add(cause)
            self._warn(text)

    def begin(self) -> list[Event | Begin]:
        """Let out what waits, on the newest face seen before it."""
        if not self._waiting:
            return []
        writes, faces = list(self._waiting), sorted(self._waiting_faces, key=lambda face: face.seq)
        self._waiting.clear()
        self._waiting_faces.clear()
        self._order = Order(self._patience)
        self._first_seq = writes[0].seq
        self._last_face_seq = faces[-1].seq if faces else 0
        before = [face.face for face in faces if face.seq < self._first_seq and face.face]
        due: list[Event | Begin] = [Begin(before[-1] if before else None)]
        now_ns = self._followed.steady_ns if self._followed else 0
        within = [face for face in faces if face.seq > self._first_seq and not self._pace.refuses(face, now_ns)]
        events: list[Event] = [*writes, *within]
        for event in events:
            due += self._order.add(event)
        return due
