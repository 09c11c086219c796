# SPDX-License-Identifier: Apache-2.0
"""Stepping the twin through a bag's event stream."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hardware_bridge.errors import BridgeError
from hardware_bridge.recording.bag_reader import Session, seconds_of
from sim_core.dynamics.actuators import ActuatorParameters
from sim_core.dynamics.model import Model, build_model
from sim_core.dynamics.robot import Robot
from sim_core.files.yaml_reader import parse_yaml
from sim_core.structure.parameters import Prototype, load_prototype, parse_prototype
from sim_core.twin.follower import AT_REST, Event, Follower, Observed, Pace, Sent, impossible
from sim_core.twin.model_versions import label_of

MOST_GAP_S, MOST_S = 86_400.0, 7 * 86_400.0
"""Robot time between two events, and of a whole bag, that is stepped through."""


class ReplayError(BridgeError):
    """A bag that the twin cannot follow."""


@dataclass(frozen=True)
class FaceCheck:
    """Where twin and robot stood when the robot had settled: robot time (s), both faces, and who observed."""

    time_s: float
    predicted: str | None
    observed: str | None
    source: str

    @property
    def agrees(self) -> bool:
        """Whether both stood on the same face."""
        return self.predicted == self.observed


@dataclass
class Replay:
    """What a replay found.

    Attributes:
        digest: sha256 of the twin's final state.
        step: its step count.
        model_hash: of the model used.
        live_states: states of the live twin in the bag that can be compared.
        same_states: those with the same bits.
        faces: twin against record at settled observations, one for every change.
        final: the twin's last face.
        recorded: the last face seen (None: nobody looked).
        times_s, twin_m: path of the twin's centre, (n,) and (n, 3).
        lengths_m: sent rest lengths, (n, 6).
        resets: observations that contradicted the twin.
        origin_s: robot time of the first event, from which all times here count.
    """

    digest: str = ""
    step: int = 0
    model_hash: str = ""
    live_states: int = 0
    same_states: int = 0
    first_difference: int | None = None
    faces: list[FaceCheck] = field(default_factory=list)
    final: str | None = None
    recorded: str | None = None
    times_s: list[float] = field(default_factory=list)
    twin_m: list[np.ndarray] = field(default_factory=list)
    lengths_m: list[tuple[float, ...]] = field(default_factory=list)
    resets: int = 0
    origin_s: float = 0.0


def prototype_of(session: Session) -> Prototype:
    """The prototype that is attached to a bag; the nominal one if none is. Raises ParameterError, YamlError."""
    data, where = session.attachments.get("prototype.yaml"), f"{session.path}: prototype.yaml"
    return load_prototype() if data is None else parse_prototype(parse_yaml(data, where), where)


def model_of(session: Session) -> Model:
    """The model whose parameters the bag holds. Raises as `prototype_of`."""
    return build_model(prototype_of(session))


def require_same_model(session: Session, model: Model) -> None:
    """Whether the software of today makes of the bag's numbers the model that the bag was recorded with.

    Raises:
        ReplayError: it does not; both hashes are named.
    """
    recorded, built = session.metadata.get("session", {}).get("model", ""), label_of(model.hash)
    if recorded and recorded != built:
        raise ReplayError(
            f"{session.path} was recorded with model {recorded}, its numbers now give model {built}: its bits cannot be had back; "
            "replay it with the software of then, or compare faces only with --compare"
        )


def events_of(session: Session, mid_stroke_m: float = 0.234) -> list[Event]:
    """The bag's event stream, of struts of that mid stroke (m), in the order of its numbers.

    Raises:
        ReplayError: it has none, or it cannot be a bridge's.
    """
    timed: list[tuple[Event, int]] = [
        (sent_of(found.message), found.log_time_ns) for found in session.recorded("bridge/struts_sent")
    ]
    if not timed:
        raise ReplayError(f"{session.path} holds no sent commands (topic bridge/struts_sent): nothing to replay")
    for found in session.recorded("bridge/face"):
        m = found.message
        timed.append((Observed(m.seq, m.robot_time_ns, m.face or None, m.settled), found.log_time_ns))
    return possible(session.path, timed, mid_stroke_m)


def sent_of(message: Any) -> Sent:
    """What the twin needs of a recorded write or heartbeat."""
    return Sent(message.seq, message.robot_time_ns, tuple(float(v) for v in message.length_m))


def possible(path: Path, timed: Sequence[tuple[Event, int]], mid_stroke_m: float) -> list[Event]:
    """Events, each with its log time (ns), in the order of their numbers.

    Raises:
        ReplayError: a bridge cannot have told them: to step a twin through them might take for ever.
    """
    pace, first_ns, last_ns = Pace(), None, 0
    ordered = sorted(timed, key=lambda one: one[0].seq)
    for event, log_time_ns in ordered:
        first_ns = event.robot_time_ns if first_ns is None else first_ns
        problem = impossible(event, mid_stroke_m) or pace.refuses(event, log_time_ns)
        if not problem and event.robot_time_ns - max(first_ns, last_ns) > 1e9 * MOST_GAP_S:
            problem = f"nothing was told for {(event.robot_time_ns - last_ns) / 86_400e9:.3g} days before event {event.seq}"
        if not problem and event.robot_time_ns - first_ns > 1e9 * MOST_S:
            problem = f"it goes on for more than {MOST_S / 86_400:g} days of robot time"
        if problem:
            raise ReplayError(f"{path} is no recording of a bridge: {problem}; it was changed, or is damaged")
        last_ns = event.robot_time_ns
    return [event for event, _ in ordered]


def replay(
    session: Session,
    model: Model | None = None,
    actuators: ActuatorParameters | None = None,
    report: Callable[[int, int], None] = lambda done, total: None,
    watch: Callable[[float, Robot], None] = lambda time_s, robot: None,
) -> Replay:
    """Step a fresh twin through the bag; compare bits with the live twin's and faces with those observed.

    Args:
        session: the bag, read.
        model: default: the bag's own.
        actuators: of the twin, for a `following` model; None: ideal ones.
        report: called with (events done, total).
        watch: called with robot time (s) and the robot, after each write and heartbeat.
    """
    model = model or model_of(session)
    events = events_of(session, model.prototype.strut_length_m)
    live = {m.last_seq: m for m in session.of("twin/state") if m.last_seq > 0}
    sources = {m.seq: m.source for m in session.of("bridge/face")}
    first_seq, start = start_of(session)
    events = [event for event in events if event.seq >= first_seq]
    follower = Follower(model, start, actuators, rule_of(session))
    result = Replay(model_hash=follower.identity)
    result.origin_s = began_s = events[0].robot_time_ns / 1e9
    for done, event in enumerate(events, start=1):
        follower.apply(event)
        if follower.corrected_from is not None and not isinstance(event, Observed):  # it stood elsewhere for too long
            seen = next(past for past in reversed(events[:done]) if isinstance(past, Observed))
            time_s = event.robot_time_ns / 1e9 - began_s
            result.faces.append(FaceCheck(time_s, follower.corrected_from or None, seen.face, sources[seen.seq]))
        if isinstance(event, Sent):
            result.times_s.append(event.robot_time_ns / 1e9 - began_s)
            result.lengths_m.append(event.lengths_m)
            result.twin_m.append(follower.robot.joints_m().mean(axis=0))
            watch(result.times_s[-1], follower.robot)
        elif event.settled:
            predicted = follower.robot.footing().face
            check = FaceCheck(event.robot_time_ns / 1e9 - began_s, predicted, event.face, sources[event.seq])
            if not result.faces or (check.predicted, check.observed) != (result.faces[-1].predicted, result.faces[-1].observed):
                result.faces.append(check)
            result.recorded = event.face
        state = live.get(event.seq)
        comparable = state is not None and (state.first_seq, state.robot_time_ns) == (follower.first_seq, event.robot_time_ns)
        if state is not None and comparable and state.model_hash == follower.identity:
            result.live_states += 1
            if (state.digest, state.step) == (follower.digest(), follower.step):
                result.same_states += 1
            elif result.first_difference is None:
                result.first_difference = event.seq
        report(done, len(events))
    result.digest, result.step, result.resets = follower.digest(), follower.step, follower.resets
    result.final = follower.robot.footing().face
    return result


def start_of(session: Session) -> tuple[int, str]:
    """Number of the event with which the live twin began, and the face on which; without a live twin 0 and TC6."""
    states = [m for m in session.of("twin/state") if m.last_seq > 0]
    first_seq = min((m.first_seq for m in states), default=0)
    before = sorted((m.seq, m.face) for m in session.of("bridge/face") if m.seq < first_seq and m.face)
    told = (m.face for m in session.of("twin/state") if m.face)
    return first_seq, before[-1][1] if before else next(told, "TC6")


def rule_of(session: Session) -> int:
    """By which the bag's live twin was corrected; bags that name none, by the first one."""
    return max((getattr(m, "rule", 0) for m in session.of("twin/state")), default=0) or AT_REST


def observed_path(session: Session, origin_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Robot times (s, from `origin_s`) and joints (n, 12, 3) as the observer saw them."""
    sent = list(session.of("bridge/struts_sent"))
    stamps = np.array([seconds_of(m.header.stamp) for m in sent])
    robot_s = np.array([m.robot_time_ns / 1e9 for m in sent])
    seen = [m for m in session.of("bridge/observed_joints") if len(m.poses) >= 12]
    times = np.interp([seconds_of(m.header.stamp) for m in seen], stamps, robot_s) - origin_s if sent and seen else np.zeros(0)
    joints = [[(p.position.x, p.position.y, p.position.z) for p in m.poses[:12]] for m in seen]
    return times, np.array(joints).reshape(-1, 12, 3)
