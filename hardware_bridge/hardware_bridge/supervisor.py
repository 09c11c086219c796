"""The safety supervisor: a pure state machine, (state, event, now) -> (state, effects).

    DISARMED -> HOMING -> ARMED <-> HOLD,   FAULT (latched; left only by reset, to DISARMED)

It knows no clock, port or thread. A :class:`~hardware_bridge.protocol.Send` effect is the only way to bytes. A command
is refused whole or accepted whole, never clipped. Proof of life is judged before motion, so a bridge that was itself
asleep wakes into HOLD and not into a jump.

Stopping: no board here has a command that stops a servo, so the present pulses are sent again with the shortest
duration; what is left of the last frame (at most one step) is the residual motion.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hardware_bridge.calibration import STRUTS
from hardware_bridge.checks import Rules, check_homing, check_trajectory
from hardware_bridge.duty import check_duty, returns
from hardware_bridge.errors import (
    FaultLatched,
    LeaseError,
    NotClear,
    Refused,
    StaleError,
    StateError,
    SupplyError,
)
from hardware_bridge.homing import homing_path, known_pulses
from hardware_bridge.protocol import (
    HOMING_NUMBER,
    Arm,
    Disarm,
    Effect,
    Event,
    Execute,
    Fail,
    Finished,
    Granted,
    Hold,
    Kind,
    LastFrame,
    Lease,
    LinkLost,
    Mode,
    Motion,
    Now,
    Outcome,
    Prove,
    Refuse,
    Reset,
    Send,
    State,
    Stop,
    Supply,
    Tick,
)
from hardware_bridge.trajectory import Trajectory

_ROUNDING_S = 1e-6
_ALL = tuple(range(len(STRUTS)))
_NOBODY = (False,) * len(STRUTS)

Result = tuple[State, tuple[Effect, ...]]


class Supervisor:
    """The state machine under a set of rules.

    Attributes:
        rules: Calibration, limits, pacing and shape check.
        min_duration_ms: The board's shortest move, used to hold.
    """

    def __init__(self, rules: Rules, min_duration_ms: int = 20) -> None:
        self.rules = rules
        self.min_duration_ms = min_duration_ms

    def step(self, state: State, event: Event, now: Now) -> Result:
        """The next state and what to do. A refused event leaves the state as it was, with one ``Refuse``."""
        try:
            match event:
                case Tick():
                    return self._tick(state, now, event.congested)
                case Prove():
                    return self._prove(state, event, now), ()
                case Arm():
                    return self._arm(state, event, now)
                case Execute():
                    return self._execute(state, event, now)
                case Disarm():
                    return self._disarm(state, event)
                case Hold():
                    return self._hold(state, event)
                case Stop():
                    return self._stop(state, event.reason)
                case Supply():
                    return replace(state, supply_mv=event.millivolts), ()
                case LinkLost() | Fail():
                    return self._fail(state, event)
                case Reset():
                    return self._reset(state), ()
        except Refused as error:
            return state, (Refuse(error),)

    # ---- commands ---------------------------------------------------------------------------------------------------

    def _arm(self, state: State, event: Arm, now: Now) -> Result:
        if state.mode is Mode.FAULT:
            raise FaultLatched("arm", state.reason)
        if state.mode is not Mode.DISARMED and state.lease is not None:
            raise StateError("arm", state.mode, f"{state.lease.holder} holds the lease; disarm first")
        if not event.lifted_and_clear:
            raise NotClear()
        pulses_us = known_pulses(self.rules, state, event)
        check_homing(self.rules, pulses_us, homing_path(self.rules, pulses_us))
        lease = Lease(event.token, event.holder, now.wall_s)
        homing = State(
            Mode.HOMING,
            "",
            pulses_us,
            state.energised,
            lease,
            resume_s=now.robot_s,
            duty=state.duty,
            supply_mv=state.supply_mv,
        )
        return homing, (Granted(event.token),)

    def _execute(self, state: State, event: Execute, now: Now) -> Result:
        if state.mode is Mode.FAULT:
            raise FaultLatched("execute", state.reason)
        self._require_lease(state, event.lease, now)
        if not state.homed or state.mode not in (Mode.ARMED, Mode.HOLD):
            raise StateError("execute", state.mode, "wait for ARMED in the bridge's state")
        if state.motion is not None:
            raise StateError("execute", state.mode, "a motion is running; wait for its end or cancel it")
        limit_s = self.rules.limits.goal_age_s
        if not abs(event.stamp_age_s) <= limit_s:  # also not-a-number
            raise StaleError(event.stamp_age_s, limit_s)
        path = check_trajectory(self.rules, self._lengths_m(state), event.trajectory)
        self._require_strength(state, path, now)
        return replace(state, mode=Mode.ARMED, reason="", motion=Motion(event.number, path)), ()

    def _require_strength(self, state: State, path: Trajectory, now: Now) -> None:
        """Duty and supply for a motion that loads the struts; the way back to mid stroke is always open."""
        calibration, limits = self.rules.calibration, self.rules.limits
        quantum_m = max(strut.quantum_m for strut in calibration.struts)
        if returns(path, calibration.mid_stroke_length_m, quantum_m):
            return
        check_duty(state.duty, path, now.robot_s, limits)
        if state.supply_mv is not None and state.supply_mv * 1e-3 < limits.supply_low_v:
            raise SupplyError(state.supply_mv * 1e-3, limits.supply_low_v)

    def _disarm(self, state: State, event: Disarm) -> Result:
        if state.mode is Mode.FAULT:
            raise FaultLatched("disarm", state.reason)
        if state.lease is not None and event.lease != state.lease.token:
            raise LeaseError(event.lease, f"{state.lease.holder} holds another one; ask there, or stop")
        held = self._end(state, Mode.DISARMED, "", Outcome.HELD, "disarmed")
        return replace(held[0], lease=None, homed=False), held[1]

    def _hold(self, state: State, event: Hold) -> Result:
        running = state.motion is not None and state.motion.number != HOMING_NUMBER
        if event.number is not None and not (state.motion is not None and state.motion.number == event.number):
            return state, ()
        if state.mode is Mode.HOMING:  # half homed is not homed
            held = self._end(state, Mode.HOLD, f"{event.reason}; arm again", Outcome.HELD, event.reason)
            return replace(held[0], lease=None), held[1]
        if state.mode is Mode.ARMED or running:
            return self._end(state, Mode.HOLD, event.reason, Outcome.HELD, event.reason)
        return state, ()

    def _stop(self, state: State, reason: str) -> Result:
        latched = state.reason if state.mode is Mode.FAULT else reason
        stopped = self._end(state, Mode.FAULT, latched, Outcome.FAULT, reason)
        return replace(stopped[0], lease=None, homed=False), stopped[1]

    def _fail(self, state: State, event: LinkLost | Fail) -> Result:
        lost = isinstance(event, LinkLost)
        ended, effects = self._stop(state, event.reason)
        if lost:  # nothing can be sent, and who knows whether the board kept its power
            effects = tuple(effect for effect in effects if not isinstance(effect, Send))
            ended = replace(ended, energised=_NOBODY, last_frame=None)
        return ended, effects

    def _reset(self, state: State) -> State:
        if state.mode is not Mode.FAULT:
            return state
        return replace(state, mode=Mode.DISARMED, reason="", lease=None, homed=False, motion=None)

    def _prove(self, state: State, event: Prove, now: Now) -> State:
        lease = self._require_lease(state, event.lease, now)
        return replace(state, lease=replace(lease, proven_wall_s=now.wall_s))

    # ---- time -------------------------------------------------------------------------------------------------------

    def _tick(self, state: State, now: Now, congested: bool) -> Result:
        if state.lease is not None and self._silent(state.lease, now):
            limit_s = self.rules.limits.lease_silence_s
            reason = f"{state.lease.holder} was silent for more than {limit_s:g} s; arm again"
            held = self._end(state, Mode.HOLD, reason, Outcome.HELD, reason)
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
        if state.energising == len(STRUTS):
            return self._advance(state, Motion(HOMING_NUMBER, homing_path(self.rules, pulses_us)), now)
        index = state.energising
        energised = tuple(on or each == index for each, on in enumerate(state.energised))
        resume_s = now.robot_s + self.rules.pacing.energise_pause_s
        after = replace(state, energising=index + 1, energised=energised, resume_s=resume_s)
        return after, (Send(Kind.ENERGISE, (index,), pulses_us, self._period_ms()),)

    def _advance(self, state: State, motion: Motion, now: Now) -> Result:
        if motion.progress_s >= motion.path.duration_s and motion.ticked_s is not None:
            assert state.last_frame is not None
            if now.robot_s < state.last_frame.sent_s + state.last_frame.duration_s:
                return replace(state, motion=motion), ()
            if motion.number == HOMING_NUMBER:
                return replace(state, mode=Mode.ARMED, reason="", motion=None, homed=True), ()
            return replace(state, motion=None), (Finished(motion.number, Outcome.DONE, ""),)
        elapsed_s = self.rules.pacing.period_s if motion.ticked_s is None else max(0.0, now.robot_s - motion.ticked_s)
        sent_m = np.array(self._lengths_m(state))
        advance_s = self._permitted_advance_s(motion, elapsed_s, sent_m)
        progress_s = motion.progress_s + advance_s
        if progress_s > motion.path.duration_s - _ROUNDING_S:
            progress_s = motion.path.duration_s
        target_m = motion.path.at(progress_s)
        pulses_us = self.rules.calibration.pulses_us(list(target_m))

        board_m = self._board_m(state, sent_m, now)
        rounded_m = np.array(self.rules.calibration.lengths_m(pulses_us))
        change_m = float(max(np.max(np.abs(rounded_m - board_m)), np.max(np.abs(rounded_m - sent_m))))
        duration_ms = max(self._period_ms(), _whole_ms(change_m / self.rules.limits.speed_m_s))
        frame = LastFrame(tuple(map(float, board_m)), now.robot_s, duration_ms * 1e-3)
        moved = Motion(motion.number, motion.path, progress_s, now.robot_s)
        kind = Kind.HOME if motion.number == HOMING_NUMBER else Kind.MOVE
        turned = tuple(new != old for new, old in zip(pulses_us, state.pulses_us, strict=True))
        duty = state.duty.ran(turned, frame.duration_s / self.rules.pacing.overlap, now.robot_s, self.rules.limits)
        after = replace(state, motion=moved, pulses_us=pulses_us, energised=(True,) * len(STRUTS), last_frame=frame, duty=duty)
        return after, (Send(kind, _ALL, pulses_us, duration_ms),)

    def _permitted_advance_s(self, motion: Motion, elapsed_s: float, sent_m: np.ndarray) -> float:
        """How far along its path a motion may jump: to the newest due frame, but at most a step away. The rest is lost
        time, never a queue: the path is kept, only later."""
        limit_m = self.rules.limits.step_m

        def step_m(advance_s: float) -> float:
            return float(np.max(np.abs(motion.path.at(motion.progress_s + advance_s) - sent_m)))

        if step_m(elapsed_s) <= limit_m:
            return elapsed_s
        low_s, high_s = 0.0, elapsed_s
        for _ in range(30):
            middle_s = 0.5 * (low_s + high_s)
            low_s, high_s = (middle_s, high_s) if step_m(middle_s) <= limit_m else (low_s, middle_s)
        return low_s

    def _board_m(self, state: State, sent_m: np.ndarray, now: Now) -> np.ndarray:
        """Where the board's own interpolation has come to, if it does what it was told."""
        frame = state.last_frame
        if frame is None:
            return sent_m
        left = min(1.0, max(0.0, 1.0 - (now.robot_s - frame.sent_s) / frame.duration_s))
        return np.asarray(sent_m + left * (np.array(frame.from_m) - sent_m))

    # ---- shared -----------------------------------------------------------------------------------------------------

    def _end(self, state: State, mode: Mode, reason: str, outcome: Outcome, why: str) -> Result:
        """Ends motion and homing, and holds every strut that is under power where it was last sent."""
        effects: list[Effect] = []
        struts = tuple(index for index, on in enumerate(state.energised) if on)
        if struts:
            effects.append(Send(Kind.HOLD, struts, self._pulses(state), self.min_duration_ms))
        if state.motion is not None and state.motion.number != HOMING_NUMBER:
            effects.append(Finished(state.motion.number, outcome, why))
        ended = replace(state, mode=mode, reason=reason, motion=None, last_frame=None, energising=0)
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

    def _period_ms(self) -> int:
        return _whole_ms(self.rules.pacing.period_s * self.rules.pacing.overlap)


def _whole_ms(duration_s: float) -> int:
    return math.ceil((duration_s - _ROUNDING_S) * 1e3)
