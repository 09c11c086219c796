# SPDX-License-Identifier: Apache-2.0
"""A recorded trial beside the twin: where they part, by how much, and how the twin would have it end."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hardware_bridge.recording.bag_on_disk import bags_in, file_of, is_bag_folder, whole_bag
from hardware_bridge.recording.bag_reader import Bag, Session, seconds_of
from sim_core.dynamics.actuators import ActuatorParameters, following
from sim_core.dynamics.model import Model, build_model
from sim_core.errors import SimError
from sim_core.files.yaml_reader import parse_yaml
from sim_core.gaits.cycle import Chain
from sim_core.gaits.library import Gait, Library, gait_of, parse_library
from sim_core.structure.parameters import with_value
from sim_core.twin.follower import Follower
from tensegrity_lab.bags.replay import observed_path, possible, prototype_of, sent_of
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.bag_messages import lines_in_bag
from tensegrity_lab.session_data.ledger_line import Event, Line, Outcome, utc_ns
from tensegrity_lab.session_data.plan import chain_in

PARTED_M = 0.02
"""Twin and record have parted when their joints are farther apart than this on average; a tip moves joints by ten times as much."""
REST_LIMIT_S = 15.0
SHORT_NAMES = {"mu_s": "friction_static", "mu_k": "friction_kinetic"}


@dataclass(frozen=True)
class Course:
    """One trial, replayed.

    Attributes:
        line: the record.
        actuated, returned: where the twin stood at rest after actuation and after the return; None: on no face.
        faces: the twin's faces on the way, the source first.
        times_s: when the observer saw joints (s of robot time after the roll was asked for), (n,).
        apart_m: mean distance of the twelve joints then, both laid over each other as they stood at first, (n,). Empty: nobody
            observed joints.
        sent_s, lengths_m: rest lengths sent, (m,), (m, 6).
    """

    line: Line
    actuated: str | None
    returned: str | None
    faces: tuple[str, ...]
    times_s: np.ndarray
    apart_m: np.ndarray
    sent_s: np.ndarray
    lengths_m: np.ndarray

    @property
    def succeeds(self) -> bool:
        """Whether the twin's roll is a success, by the rule of trials; a chain came onto all its faces in their order."""
        if self.line.chain:
            faces = iter(self.faces)
            return all(face in faces for face in self.line.chain.split("-")) and self.returned == self.line.target
        return self.actuated == self.returned == self.line.target

    @property
    def agrees(self) -> bool | None:
        """Whether twin and record end alike; None: the trial is void."""
        return None if self.line.outcome is Outcome.VOID else self.succeeds == (self.line.outcome is Outcome.SUCCESS)

    @property
    def parted_s(self) -> float | None:
        """When they parted (s of robot time); None: they did not."""
        far = np.flatnonzero(self.apart_m > PARTED_M)
        return float(self.times_s[far[0]]) if len(far) else None


def trials_of(bag: Path) -> list[Line]:
    """Trials that were rolled in a bag, as recorded in it or, if that session was killed, in a later one beside it.

    Raises:
        SessionError: there are none.
    """
    found: dict[int, Line] = {}
    bag = whole_bag(bag)
    alone = is_bag_folder(bag) and not file_of(bag).is_file()  # recorded by rosbag2, whose name no trial knows
    for other in [bag] if alone else sorted({bag, *bags_in(bag.parent)}):
        for line in lines_in_bag(other):
            if (alone or line.bag == bag.name) and line.event is Event.TRIAL:
                found[line.number] = line
    if not found:
        raise SessionError(f"{bag} holds no trials: it is not of a session that `sixstrut trial` ran; leave --trial out")
    return [found[number] for number in sorted(found)]


def chosen_trials(lines: Sequence[Line], numbers: Sequence[int]) -> list[Line]:
    """Trials by number; all if none is given. Raises SessionError: one is not there."""
    known = {line.number: line for line in lines}
    missing = [number for number in numbers if number not in known]
    if missing:
        raise SessionError(f"trial {missing[0]} is not in this bag: it holds trials {', '.join(map(str, known))}")
    return [known[number] for number in numbers] if numbers else list(lines)


def changed_model(session: Session, changes: Mapping[str, float], actuators: ActuatorParameters | None = None) -> Model:
    """The bag's own model with other numbers, by the names of `sixstrut parameters` (or mu_s, mu_k), to follow these actuators.

    Raises:
        SimError: no such parameter, or a value that is not valid.
    """
    robot = prototype_of(session)
    # the lower of two that are bound to each other first, so that neither passes the other on the way
    for name in sorted(changes, key=lambda name: changes[name]):
        robot = with_value(robot, SHORT_NAMES.get(name, name), changes[name])
    return build_model(robot if actuators is None else following(robot, actuators))


def library_of(session: Session) -> Library:
    """The library in a bag. Raises SessionError: it holds none."""
    data = session.attachments.get("library.yaml")
    if data is None:
        raise SessionError(f"{session.path} holds no library: odds cannot be told")
    where = f"{session.path}: library.yaml"
    return parse_library(parse_yaml(data, where), where)


def gait_in(library: Library, line: Line) -> Gait | Chain:
    """The gait or chain of a trial. Raises SimError."""
    if line.chain:
        return chain_in(library, line)
    return gait_of(library.primitive(line.primitive), line.source, line.target)


def replay_trial(bag: Bag, line: Line, model: Model) -> Course:
    """Roll the twin, from rest on the trial's source, by what was really sent.

    It is told no observed face, so that its end is its own.

    Raises:
        SessionError: nothing was sent in that trial.
        BagError: the bag cannot be decoded.
        ReplayError: no bridge sent this.
    """
    try:
        session = bag.session(utc_ns(line.began), utc_ns(line.recorded))
    except ValueError as error:
        raise SessionError(f"{bag.path}: trial {line.number} has no beginning and end: {error}") from error
    found = sorted(session.recorded("bridge/struts_sent"), key=lambda recorded: recorded.message.seq)
    if not found:
        raise SessionError(f"{bag.path}: nothing was sent in trial {line.number}; it is {line.outcome}: {line.reason}")
    sent = [recorded.message for recorded in found]
    timed = [(sent_of(recorded.message), recorded.log_time_ns) for recorded in found]
    events = possible(bag.path, timed, model.prototype.strut_length_m)
    began_s = sent[0].robot_time_ns / 1e9
    returns_s = _return_time(session, sent)
    follower = Follower(model, line.source)
    faces, twin, times = [line.source], [follower.robot.joints_m()], [0.0]
    actuated: str | None = line.source
    for message, event in zip(sent, events, strict=True):
        before_return = seconds_of(message.header.stamp) < returns_s
        follower.apply(event)
        face = follower.robot.footing().face
        if before_return:
            actuated = face
        if face is not None and face != faces[-1]:
            faces.append(face)
        twin.append(follower.robot.joints_m())
        times.append(message.robot_time_ns / 1e9 - began_s)
    returned = _at_rest(follower)
    if returned is not None and returned != faces[-1]:
        faces.append(returned)
    seen_s, seen = observed_path(session, began_s)
    apart_m = _apart(np.array(times), np.array(twin), seen_s, seen)
    lengths_m = np.array([message.length_m for message in sent])
    return Course(line, actuated, returned, tuple(faces), seen_s, apart_m, np.array(times[1:]), lengths_m)


def _return_time(session: Session, sent: Sequence[Any]) -> float:
    """When the return was asked for (ROS time, s); the end, if it never was."""
    asked = [seconds_of(m.header.stamp) for m in session.of("bridge/asked")]
    return asked[-1] if len(asked) > 1 else seconds_of(sent[-1].header.stamp) + 1.0


def _at_rest(follower: Follower) -> str | None:
    """Where the twin stands once it rests."""
    step = follower.model.steps_per_second // 20
    for _ in range(round(REST_LIMIT_S * 20)):
        if follower.robot.is_slow():
            break
        follower.robot.advance(step)
    return follower.robot.footing().face


def _apart(times_s: np.ndarray, twin_m: np.ndarray, seen_s: np.ndarray, seen_m: np.ndarray) -> np.ndarray:
    """Mean distance of joints (n,), after the twin's floor is turned and shifted so that both coincide at first."""
    if not len(seen_s):
        return np.zeros(0)
    first, there = twin_m[0], seen_m[0]
    a, b = first[:, :2] - first[:, :2].mean(axis=0), there[:, :2] - there[:, :2].mean(axis=0)
    product = a.T @ b
    yaw = np.arctan2(product[0, 1] - product[1, 0], product[0, 0] + product[1, 1])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    laid = twin_m.copy()
    laid[:, :, :2] = (twin_m[:, :, :2] - first[:, :2].mean(axis=0)) @ turn.T + there[:, :2].mean(axis=0)
    flat = laid.reshape(len(laid), -1)
    then = np.column_stack([np.interp(seen_s, times_s, column) for column in flat.T]).reshape(-1, 12, 3)
    return np.linalg.norm(then - seen_m, axis=2).mean(axis=1)


def parsed_changes(words: Sequence[str]) -> dict[str, float]:
    """`name=value` words. Raises SimError: one is not that."""
    changes = {}
    for word in words:
        name, _, value = word.partition("=")
        try:
            changes[name.strip()] = float(value)
        except ValueError:
            raise SimError(
                f"--set {word!r}: valid is NAME=NUMBER with a name of `sixstrut parameters`, such as mu_s=0.45"
            ) from None
    return changes


def course_text(course: Course) -> str:
    """One trial for people, in three lines."""
    line = course.line
    verdict = {True: "as recorded", False: "NOT as recorded", None: "the record is void"}[course.agrees]
    ends = f"after actuation on {course.actuated or 'no face'}, after the return on {course.returned or 'no face'}"
    why = f": {line.reason}" if line.reason else ""
    lines = [
        f"trial {line.number}: {line.name}, {line.ended}{why}",
        f"  record {' → '.join(line.faces)}; twin {' → '.join(course.faces)}: {ends}",
        f"  the twin {'succeeds' if course.succeeds else 'fails'}, {verdict}",
    ]
    if len(course.apart_m):
        parted = "they do not part" if course.parted_s is None else f"they part at {course.parted_s:.1f} s"
        lines[-1] += (
            f"; joints apart: {1e3 * course.apart_m[0]:.1f} mm at first, {1e3 * course.apart_m.max():.0f} mm at most, "
            f"{1e3 * course.apart_m[-1]:.0f} mm at the end; {parted} (more than {1e3 * PARTED_M:.0f} mm)"
        )
    return "\n".join(lines)
