# SPDX-License-Identifier: Apache-2.0
"""The safety supervisor: a pure state machine, (state, event, now) -> (state, effects).

    DISARMED -> HOMING -> ARMED <-> HOLD,   FAULT (latched; left only by reset, to DISARMED)

It knows no clock, port or thread. A `Send` effect is the only way to bytes. A
command is refused whole or accepted whole, never clipped. Proof of life is judged before motion, so a bridge that was itself
asleep wakes into HOLD and not into a jump.

Stopping: no board here has a command that stops a servo where it is and says so, so the struts are sent to where the board
must be by now, if it does what it is told (`LastFrame`). No frame is more than one frame at the speed limit ahead of that, and
all last equally long, so a hold has nothing to make good: what is left is what the line still carries.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hardware_bridge.calibration.whole_pulses import exact_pulses_us, whole
from hardware_bridge.errors import (
    SEND_AGAIN,
    FaultLatched,
    LeaseError,
    NotClear,
    StaleError,
    StateError,
    SupplyError,
)
from hardware_bridge.safety.board_position import MoveTime
from hardware_bridge.safety.duty_cycle import check_duty, returns
from hardware_bridge.safety.homing import homing_path, known_pulses
from hardware_bridge.safety.limit_checks import Rules, check_homing, check_trajectory
from hardware_bridge.safety.overtaking import joined, paced
from hardware_bridge.safety.supervisor_messages import (
    HOMING_NUMBER,
    NONE_ENERGISED,
    Arm,
    Disarm,
    Effect,
    Event,
    Execute,
    Finished,
    Hold,
    Kind,
    LastFrame,
    Lease,
    LinkDown,
    Mode,
    Motion,
    MotionOutcome,
    Now,
    Overtake,
    Prove,
    Reset,
    Send,
    State,
    Stop,
    Supply,
    Tick,
)
from hardware_bridge.safety.trajectory import Trajectory
from sim_core.names import STRUT_NAMES

_ROUNDING_S = 1e-6
_HALF_US = 0.5 + 1e-9
"""Rounding to a whole pulse, at most."""
_ALL = tuple(range(len(STRUT_NAMES)))

Result = tuple[State, tuple[Effect, ...]]


class _Where(NamedTuple):
    """Pulses in [us], (6,) each: where the struts were sent, where the board is, and where the pace is, see `LastFrame`."""

    sent_us: NDArray[np.float64]
    board_us: NDArray[np.float64]
    paced_us: NDArray[np.float64]


class Supervisor:
    """The state machine under a set of rules; `move_time` says how long the board takes for a way."""

    def __init__(self, rules: Rules, move_time: MoveTime) -> None:
        self.rules = rules
        self._move_time = move_time
        us_per_m = np.array([1.0 / strut.quantum_m for strut in rules.calibration.struts])
        self._frame_ms = _whole_ms(rules.pacing.period_s * rules.pacing.overlap)
        self._speed_us_s = rules.limits.speed_m_s * us_per_m
        self._reach_us = self._speed_us_s * self._frame_ms * 1e-3 + _HALF_US
        self._step_us = rules.limits.step_m * us_per_m + _HALF_US

    def step(self, state: State, event: Event, now: Now) -> Result:  # noqa: PLR0911 (one row an event)
        """The next state and what to do. Raises Refused: the event changes nothing."""
        match event:
            case Tick():
                return self._tick(self._held(state, now), now, event.congested)
            case Prove():
                return self._prove(state, event, now), ()
            case Arm():
                return self._arm(state, event, now), ()
            case Execute():
                return self._execute(state, event, now), ()
            case Overtake():
                return self._overtake(state, event, now)
            case Disarm():
                return self._disarm(state, event, now)
            case Hold():
                return self._hold(state, event, now)
            case Stop():
                return self._stop(state, event.reason, now)
            case Supply():
                return replace(state, supply_mv=event.millivolts), ()
            case LinkDown():
                return self._lose_link(state, event, now)
            case Reset():
                return self._reset(state), ()

    # ---- commands ---------------------------------------------------------------------------------------------------

    def _arm(self, state: State, event: Arm, now: Now) -> State:
        if state.mode is Mode.FAULT:
            raise FaultLatched("arm", state.reason)
        if state.mode is not Mode.DISARMED and state.lease is not None:
            raise StateError("arm", state.mode, f"{state.lease.holder} holds the lease; disarm first")
        if not event.lifted_and_clear:
            raise NotClear()
        pulses_us = known_pulses(self.rules, state, event)
        check_homing(self.rules, pulses_us, homing_path(self.rules, pulses_us))
        lease = Lease(event.token, event.holder, now.wall_s)
        return State(
            Mode.HOMING,
            "",
            pulses_us,
            state.energised,
            lease,
            resume_s=now.robot_s,
            last_frame=state.last_frame if pulses_us == state.pulses_us else None,
            duty=state.duty,
            ticked_s=state.ticked_s,
            supply_mv=state.supply_mv,
        )

    def _execute(self, state: State, event: Execute, now: Now) -> State:
        self._require_command(state, event, now)
        if state.motion is not None:
            raise StateError("execute", state.mode, "a motion is running; wait for its end, cancel it, or overtake it")
        return self._begin(state, event, event.trajectory, event.trajectory.starting_at(self._lengths_m(state)), now)

    def _overtake(self, state: State, event: Overtake, now: Now) -> Result:
        """The rest of the old path and the new one are judged as one motion, that begins where the board is."""
        self._require_command(state, event.asked, now)
        motion = state.motion
        if motion is None or motion.number != event.running:
            raise StateError("overtake", state.mode, f"motion {event.running} is not running any more; {SEND_AGAIN}")
        if event.from_s < motion.progress_s:
            raise StateError("overtake", state.mode, f"motion {event.running} is beyond {event.from_s:.3f} s; {SEND_AGAIN}")
        path = joined(motion, event.from_s, event.asked.trajectory, self.rules.limits.speed_m_s)
        from_m = motion.path.at(event.from_s)
        asked = paced(from_m, event.asked.trajectory, self.rules.limits.speed_m_s).starting_at(from_m.tolist())
        after = self._begin(state, event.asked, path, asked, now)
        assert after.motion is not None
        after = replace(after, motion=replace(after.motion, ticked_s=motion.ticked_s))
        why = f"overtaken by motion {event.asked.number}"
        return after, (Finished(motion.number, MotionOutcome.OVERTAKEN, why),)

    def _require_command(self, state: State, event: Execute, now: Now) -> None:
        if state.mode is Mode.FAULT:
            raise FaultLatched("execute", state.reason)
        self._require_lease(state, event.lease, now)
        if not state.homed or state.mode not in (Mode.ARMED, Mode.HOLD):
            raise StateError("execute", state.mode, "wait for ARMED in the bridge's state")

    def _begin(self, state: State, event: Execute, trajectory: Trajectory, asked: Trajectory, now: Now) -> State:
        """A motion along a trajectory, of which what was `asked` is new: if that is a way back, it needs no strength."""
        path = check_trajectory(self.rules, self._lengths_m(state), trajectory)
        if not returns(asked, self.rules.calibration):
            self._require_strength(state, path, now)
        limit_s = self.rules.limits.goal_age_s  # last: what is too old is worth sending again only if nothing else is wrong
        if not abs(event.stamp_age_s) <= limit_s:  # also not-a-number
            raise StaleError(event.stamp_age_s, limit_s)
        return replace(state, mode=Mode.ARMED, reason="", motion=Motion(event.number, path))

    def _require_strength(self, state: State, path: Trajectory, now: Now) -> None:
        """Duty and supply for a motion that loads the struts; the way back to mid stroke is always open."""
        limits = self.rules.limits
        check_duty(state.duty, path, now.robot_s, self.rules)
        if state.supply_mv is not None and state.supply_mv * 1e-3 < limits.supply_low_v:
            raise SupplyError(state.supply_mv * 1e-3, limits.supply_low_v)

    def _disarm(self, state: State, event: Disarm, now: Now) -> Result:
        if state.mode is Mode.FAULT:
            raise FaultLatched("disarm", state.reason)
        if state.lease is not None and event.lease != state.lease.token:
            raise LeaseError(event.lease, f"{state.lease.holder} holds another one; ask there, or stop")
        held = self._end(state, now, Mode.DISARMED, "", MotionOutcome.HELD, "disarmed")
        return replace(held[0], lease=None, homed=False), held[1]

    def _hold(self, state: State, event: Hold, now: Now) -> Result:
        running = state.motion is not None and state.motion.number != HOMING_NUMBER
        if event.number is not None and not (state.motion is not None and state.motion.number == event.number):
            return state, ()
        if state.mode is Mode.HOMING:  # half homed is not homed
            held = self._end(state, now, Mode.HOLD, f"{event.reason}; arm again", MotionOutcome.HELD, event.reason)
            return replace(held[0], lease=None), held[1]
        if state.mode is Mode.ARMED or running:
            return self._end(state, now, Mode.HOLD, event.reason, MotionOutcome.HELD, event.reason)
        return state, ()

    def _stop(self, state: State, reason: str, now: Now) -> Result:
        latched = state.reason if state.mode is Mode.FAULT else reason
        stopped = self._end(state, now, Mode.FAULT, latched, MotionOutcome.FAULT, reason)
        return replace(stopped[0], lease=None, homed=False), stopped[1]

    def _lose_link(self, state: State, event: LinkDown, now: Now) -> Result:
        """Nothing can be sent, and who knows whether the board kept its power."""
        ended, effects = self._stop(state, event.reason, now)
        ended = replace(ended, energised=NONE_ENERGISED, pulses_us=state.pulses_us, last_frame=None)
        return ended, tuple(effect for effect in effects if not isinstance(effect, Send))

    def _reset(self, state: State) -> State:
        if state.mode is not Mode.FAULT:
            return state
        return replace(state, mode=Mode.DISARMED, reason="", lease=None, homed=False, motion=None)

    def _prove(self, state: State, event: Prove, now: Now) -> State:
        lease = self._require_lease(state, event.lease, now)
        return replace(state, lease=replace(lease, proven_wall_s=now.wall_s))

    # ---- time -------------------------------------------------------------------------------------------------------

    def _held(self, state: State, now: Now) -> State:
        """With the time counted since the last tick for every strut under power that works to hold, in whatever state."""
        since_s = 0.0 if state.ticked_s is None else max(0.0, now.robot_s - state.ticked_s)
        loads = self.rules.loads(self._lengths_m(state)) if any(state.energised) else NONE_ENERGISED
        runs_s = [since_s * (on and load) for on, load in zip(state.energised, loads, strict=True)]
        duty = state.duty.ran(runs_s, now.robot_s, self.rules.limits) if any(runs_s) else state.duty
        return replace(state, ticked_s=now.robot_s, duty=duty)

    def _tick(self, state: State, now: Now, congested: bool) -> Result:
        if state.lease is not None and self._silent(state.lease, now):
            limit_s = self.rules.limits.lease_silence_s
            reason = f"{state.lease.holder} was silent for more than {limit_s:g} s; arm again"
            held = self._end(state, now, Mode.HOLD, reason, MotionOutcome.HELD, reason)
            return replace(held[0], lease=None, homed=False), held[1]
        if congested:
            return state, ()
        if state.mode is Mode.HOMING and state.motion is None:
            return self._energise_next(state, now)
        if state.motion is not None:
            return self._advance(state, state.motion, now)
        return state, ()

    def _energise_next(self, state: State, now: Now) -> Result:
        if now.robot_s < state.resume_s:
            return state, ()
        pulses_us = self._pulses(state)
        if state.energising == len(STRUT_NAMES):
            return self._advance(state, Motion(HOMING_NUMBER, homing_path(self.rules, pulses_us)), now)
        index = state.energising
        energised = tuple(on or each == index for each, on in enumerate(state.energised))
        resume_s = now.robot_s + self.rules.pacing.energise_pause_s
        after = replace(state, energising=index + 1, energised=energised, resume_s=resume_s)
        return after, (Send(Kind.ENERGISE, (index,), pulses_us, self._frame_ms),)

    def _advance(self, state: State, motion: Motion, now: Now) -> Result:
        if motion.progress_s >= motion.path.duration_s and motion.ticked_s is not None:
            frame = state.last_frame
            if frame is not None and now.robot_s < frame.sent_s + max(self._frame_ms * 1e-3, *frame.moves_s):
                return replace(state, motion=motion), ()
            if motion.number == HOMING_NUMBER:
                return replace(state, mode=Mode.ARMED, reason="", motion=None, homed=True), ()
            return replace(state, motion=None), (Finished(motion.number, MotionOutcome.DONE, ""),)
        period_s = self.rules.pacing.period_s
        elapsed_s = period_s if motion.ticked_s is None else max(0.0, now.robot_s - motion.ticked_s)
        where = self._where(state, now)
        progress_s = motion.progress_s + self._permitted_advance_s(motion, elapsed_s, where)
        if progress_s > motion.path.duration_s - _ROUNDING_S:
            progress_s = motion.path.duration_s
        target_us = whole(exact_pulses_us(self.rules.calibration, motion.path.at(progress_s)))
        pulses_us = tuple(int(pulse) for pulse in target_us)
        moved = Motion(motion.number, motion.path, progress_s, now.robot_s)
        kind = Kind.HOME if motion.number == HOMING_NUMBER else Kind.MOVE
        turned = target_us != self._pulses(state)
        after = replace(
            state,
            motion=moved,
            pulses_us=pulses_us,
            energised=(True,) * len(STRUT_NAMES),
            last_frame=self._frame(where, pulses_us, now),
        )
        # A strut that is loaded before and after is counted by the clock, see `_held`.
        loads = np.logical_and(self.rules.loads(self._lengths_m(state)), self.rules.loads(self._lengths_m(after)))
        runs_s = min(elapsed_s, period_s) * (turned & ~loads)
        after = replace(after, duty=state.duty.ran(runs_s, now.robot_s, self.rules.limits))
        return after, (Send(kind, _ALL, pulses_us, self._frame_ms),)

    def _permitted_advance_s(self, motion: Motion, elapsed_s: float, where: _Where) -> float:
        """How far along its path a motion may jump, in [s].

        To the newest due frame, but no strut farther than the board comes within one frame at the speed limit, than the pace
        permits, or than a step. The rest is lost time, never a queue: the path is kept, only later.
        """
        low_us = np.maximum(np.maximum(where.board_us, where.paced_us) - self._reach_us, where.sent_us - self._step_us)
        high_us = np.minimum(np.minimum(where.board_us, where.paced_us) + self._reach_us, where.sent_us + self._step_us)

        def is_near(advance_s: float) -> bool:
            exact_us = exact_pulses_us(self.rules.calibration, motion.path.at(motion.progress_s + advance_s))
            return bool(((exact_us >= low_us) & (exact_us <= high_us)).all())

        if is_near(elapsed_s):
            return elapsed_s
        near_s, far_s = 0.0, elapsed_s
        for _ in range(30):
            middle_s = 0.5 * (near_s + far_s)
            near_s, far_s = (middle_s, far_s) if is_near(middle_s) else (near_s, middle_s)
        return near_s

    def _where(self, state: State, now: Now) -> _Where:
        """Where everything has come to since the newest frame."""
        sent_us = np.array(self._pulses(state), dtype=float)
        frame = state.last_frame
        if frame is None:
            return _Where(sent_us, sent_us, sent_us)
        since_s = max(0.0, now.robot_s - frame.sent_s)
        parts = np.array([1.0 if since_s >= move_s else since_s / move_s for move_s in frame.moves_s])
        from_us, paced_us = np.array(frame.from_us), np.array(frame.paced_us)
        left_us = np.maximum(0.0, np.abs(sent_us - paced_us) - self._speed_us_s * since_s)
        return _Where(sent_us, from_us + parts * (sent_us - from_us), sent_us - np.sign(sent_us - paced_us) * left_us)

    def _frame(self, where: _Where, pulses_us: tuple[int, ...], now: Now) -> LastFrame:
        ways_us = np.abs(np.array(pulses_us) - where.board_us)
        moves_s = tuple(self._move_time(float(way_us), self._frame_ms) for way_us in ways_us)
        return LastFrame(tuple(where.board_us.tolist()), now.robot_s, moves_s, tuple(where.paced_us.tolist()))

    # ---- shared -----------------------------------------------------------------------------------------------------

    def _end(self, state: State, now: Now, mode: Mode, reason: str, outcome: MotionOutcome, why: str) -> Result:
        """Ends motion and homing, and holds every strut that is under power where the board is."""
        effects: list[Effect] = []
        ended = replace(state, mode=mode, reason=reason, motion=None, energising=0)
        struts = tuple(index for index, on in enumerate(state.energised) if on)
        if struts:
            where = self._where(state, now)
            board_us = whole(where.board_us)
            held_us = tuple(
                int(at) if on else sent for at, on, sent in zip(board_us, state.energised, state.pulses_us, strict=True)
            )
            ended = replace(ended, pulses_us=held_us)
            ended = replace(ended, last_frame=self._frame(where, self._pulses(ended), now))
            effects.append(Send(Kind.HOLD, struts, self._pulses(ended), self._frame_ms))
        if state.motion is not None and state.motion.number != HOMING_NUMBER:
            effects.append(Finished(state.motion.number, outcome, why))
        return ended, tuple(effects)

    def _require_lease(self, state: State, token: str, now: Now) -> Lease:
        lease = state.lease
        if lease is None:
            raise LeaseError(token, "nobody holds a lease; arm first")
        if token != lease.token:
            raise LeaseError(token, f"{lease.holder} holds another one")
        if self._silent(lease, now):
            raise LeaseError(token, f"silent for more than {self.rules.limits.lease_silence_s:g} s; arm again")
        return lease

    def _silent(self, lease: Lease, now: Now) -> bool:
        return now.wall_s - lease.proven_wall_s > self.rules.limits.lease_silence_s

    def _pulses(self, state: State) -> tuple[int, ...]:
        """All six pulses; where nobody knows one, mid stroke stands in for a strut that no frame will contain."""
        calibration = self.rules.calibration
        return tuple(
            calibration.pulse_us(index, calibration.mid_stroke_length_m) if pulse is None else pulse
            for index, pulse in enumerate(state.pulses_us)
        )

    def _lengths_m(self, state: State) -> tuple[float, ...]:
        return self.rules.calibration.lengths_m(self._pulses(state))


def _whole_ms(duration_s: float) -> int:
    return math.ceil((duration_s - _ROUNDING_S) * 1e3)
