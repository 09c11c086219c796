"""One stream of events from the bridge's two topics, through late joining and restarts of the bridge. Knows no ROS.

Within a topic events arrive in order; between the two topics they may not. Whoever joins late gets the last faces of the past,
which lie before the first write that it hears of. A bridge that starts again numbers from 1 again.
"""

from __future__ import annotations

from dataclasses import dataclass

from sim_core.follow import Event, Observed, Order, Sent


@dataclass(frozen=True)
class Begin:
    """The stream begins (again) here. `face`: on which the robot was last seen before; None if nobody had seen it."""

    face: str | None


class EventStream:
    """Puts what arrives into the order in which it happened.

    A stream is not given out before `begin`, or a face from after its first write: the faces on which the robot stood before
    belong before it, but often arrive later. Stamps (ns, of the bridge's wall clock) tell an old bridge's events from a new one's.
    """

    def __init__(self, patience: int = 200):
        """Args: patience: as `Order`'s."""
        self._patience = patience
        self._order: Order | None = None
        self._lost_before = 0
        self._first_seq = 0
        self._last_sent = (0, 0, 0)
        self._renewed = False
        self._last_face_seq = 0
        self._waiting: list[Sent] = []
        self._waiting_faces: list[Observed] = []

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

    def sent(self, event: Sent, stamp_ns: int) -> list[Event | Begin]:
        """A write or a heartbeat; returns what is now due."""
        seq, robot_time_ns, _ = self._last_sent
        began_again = self._renewed or event.seq <= seq or event.robot_time_ns < robot_time_ns
        self._renewed = False
        self._last_sent = (event.seq, event.robot_time_ns, stamp_ns)
        if began_again:
            self._waiting.clear()
            self._lost_before, self._order = self.lost, None
        if self._order is not None:
            return list(self._order.add(event))
        self._waiting.append(event)
        return self.begin() if any(face.seq > self._waiting[0].seq for face in self._waiting_faces) else []

    def observed(self, event: Observed, stamp_ns: int) -> list[Event | Begin]:
        """A face observation; returns what is now due."""
        seq, _, sent_stamp_ns = self._last_sent
        of_new_bridge = (self._renewed or event.seq <= seq) and stamp_ns > sent_stamp_ns
        if self._order is None or of_new_bridge:
            self._waiting_faces.append(event)
            return self.begin() if self._waiting and event.seq > self._waiting[0].seq else []
        if event.seq <= self._last_face_seq:
            return []
        self._last_face_seq = event.seq
        if event.seq < self._first_seq:  # very late: begin again from there
            return [Begin(event.face)] if event.face else []
        return list(self._order.add(event))

    def begin(self) -> list[Event | Begin]:
        """Let out what waits, on the newest face seen before it."""
        if not self._waiting:
            return []
        writes, self._waiting = self._waiting, []
        faces, self._waiting_faces = sorted(self._waiting_faces, key=lambda face: face.seq), []
        self._order = Order(self._patience)
        self._first_seq = writes[0].seq
        self._last_face_seq = faces[-1].seq if faces else 0
        before = [face.face for face in faces if face.seq < self._first_seq and face.face]
        due: list[Event | Begin] = [Begin(before[-1] if before else None)]
        within = [face for face in faces if face.seq > self._first_seq]
        events: list[Event] = [*writes, *within]
        for event in events:
            due += self._order.add(event)
        return due
