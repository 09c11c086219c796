# SPDX-License-Identifier: Apache-2.0
"""Whatever is done to the supervisor, in whatever order: what must hold always. Limits are computed here anew."""

from dataclasses import replace

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from hardware_bridge.boards.lsc import Lsc
from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.calibration.whole_pulses import exact_pulses_us, whole
from hardware_bridge.errors import Refused, TrajectoryError
from hardware_bridge.safety.duty_cycle import returns
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.limits import Limits, Pacing
from hardware_bridge.safety.supervisor import Supervisor
from hardware_bridge.safety.supervisor_messages import (
    Arm,
    Disarm,
    Event,
    Execute,
    Finished,
    Hold,
    Kind,
    LinkDown,
    Mode,
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
from tests.scale import examples

MID_M = 0.234
SPREAD_M = 0.07
SILENCE_S = 1.0
WINDOWS = (30.0, 6.0), (10.0, 4.0)
LOADED_M = 0.012
LOW_MV = 6400


def shape(lengths_m: tuple[float, ...]) -> str | None:
    return "too crooked" if max(lengths_m) - min(lengths_m) > SPREAD_M else None


CALIBRATION = load_calibration()
CALIBRATION = replace(
    CALIBRATION, struts=(replace(CALIBRATION.struts[0], direction=-1, us_per_mm=7.3, trim_us=17), *CALIBRATION.struts[1:])
)
RULES = Rules(
    CALIBRATION,
    Limits(duty_window_s=30.0, duty_fraction=0.2, burst_window_s=10.0, burst_fraction=0.4),
    Pacing(energise_pause_s=0.1, homing_speed_m_s=0.02),
    shape,
    lambda lengths_m: tuple(length - MID_M > LOADED_M for length in lengths_m),
)

tokens = st.sampled_from(["a", "b", "c", ""])
lengths = st.floats(0.18, 0.29) | st.sampled_from([0.189, 0.279, 0.184, 0.284, 0.234])
calm = st.floats(0.215, 0.25)
waits = st.sampled_from([0.0, 0.001, 0.04, 0.05, 0.05, 0.05, 0.06, 0.2, 1.5])


class AnySequence(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.supervisor = Supervisor(RULES, Lsc().move_time_s)
        self.state = State()
        self.time_s = 0.0
        self.issued: set[str] = set()
        self.current: str | None = None
        self.proven_s = 0.0
        self.board: list[int | None] = [None] * 6  # pulse that each strut has been sent, as a board would know it
        self.ramps: list[tuple[float, float, float] | None] = [None] * 6  # where from, where to (us), since when: a board's own way
        self.accepted = False
        self.homed_alone: set[int] = set()
        self.ran: list[tuple[float, np.ndarray]] = []  # when, and for how long which struts ran, or were held under load
        self.ticked_s: float | None = None
        self.supply_mv: int | None = None

    @initialize(known=st.booleans(), spread=st.integers(0, 400))
    def record(self, known: bool, spread: int) -> None:
        if known:
            self.state = State(pulses_us=(1520, 1500 + spread, 1500, 1500, 1500, 1500))

    # ---- anything may happen ----------------------------------------------------------------------------------------

    @rule(token=tokens, clear=st.sampled_from([True, True, True, False]), confirmed=st.none() | st.tuples(*[calm] * 6))
    def arm(self, token: str, clear: bool, confirmed: tuple[float, ...] | None) -> None:
        self.feed(Arm("somebody", clear, token, confirmed or (None,) * 6))

    @precondition(lambda self: self.current is None)
    @rule(token=tokens)
    def arm_well_and_home(self, token: str) -> None:
        self.feed(Reset())
        self.feed(Arm("somebody", True, token, tuple(None if known else MID_M for known in self.state.pulses_us)))
        while self.state.mode is Mode.HOMING:
            self.live(10)

    @precondition(lambda self: self.current is not None)
    @rule(token=tokens)
    def disarm(self, token: str) -> None:
        self.feed(Disarm(token))

    @rule(token=tokens)
    def prove(self, token: str) -> None:
        self.feed(Prove(token))

    @rule(
        token=tokens,
        age_s=st.sampled_from([0.0, 0.1, 0.49, 0.51, float("nan")]),
        ends=st.lists(st.tuples(*[lengths] * 6), min_size=1, max_size=3),
        gap_s=st.floats(0.01, 8.0),
    )
    def execute_anything(self, token: str, age_s: float, ends: list[tuple[float, ...]], gap_s: float) -> None:
        self.execute(token, age_s, [gap_s * (knot + 1) for knot in range(len(ends))], ends)

    @precondition(lambda self: self.current is not None and self.state.homed)
    @rule(ends=st.lists(st.tuples(*[calm] * 6), min_size=1, max_size=2), gap_s=st.floats(2.0, 6.0))
    def execute_something_good(self, ends: list[tuple[float, ...]], gap_s: float) -> None:
        assert self.current is not None
        self.execute(self.current, 0.0, [gap_s * (knot + 1) for knot in range(len(ends))], ends)

    @precondition(lambda self: self.current is not None and self.state.homed)
    @rule(
        index=st.integers(0, 5),
        stroke_m=st.floats(0.025, 0.05),
        opposite=st.booleans(),
        time_s=st.sampled_from([1.0, 2.0, 3.0, 5.0]),
        age_s=st.sampled_from([0.0, 0.0, 0.49, 0.51]),
    )
    def execute_near_the_limits(self, index: int, stroke_m: float, opposite: bool, time_s: float, age_s: float) -> None:
        assert self.current is not None
        ends = [MID_M] * 6
        ends[index] += stroke_m
        ends[index - 1] -= stroke_m * opposite
        self.execute(self.current, age_s, [time_s], [tuple(ends)])

    @precondition(lambda self: self.state.motion is not None)
    @rule(
        token=tokens | st.none(),
        number=st.sampled_from([2, 2, 2, 1, 0]),
        ahead_s=st.sampled_from([0.2, 0.2, 0.0, 1.0, 30.0, -0.1]),
        ends=st.lists(st.tuples(*[calm] * 6) | st.tuples(*[lengths] * 6), min_size=1, max_size=3),
        gap_s=st.floats(0.01, 6.0),
        age_s=st.sampled_from([0.0, 0.0, 0.51]),
        count=st.integers(0, 30),
    )
    def overtake(
        self, token: str | None, number: int, ahead_s: float, ends: list[tuple[float, ...]], gap_s: float, age_s: float, count: int
    ) -> None:
        self.live(count)
        before, motion = self.state, self.state.motion
        if motion is None:
            return
        running = motion.number if number == 2 else number
        token = self.current or "" if token is None else token
        asked = Execute(Trajectory([gap_s * (knot + 1) for knot in range(len(ends))], ends), token, age_s, motion.number + 1)
        effects = self.feed(Overtake(asked, running, motion.progress_s + ahead_s))
        if not isinstance(effects[0], Finished):
            return
        assert effects == (Finished(motion.number, MotionOutcome.OVERTAKEN, effects[0].reason),), "no frame between the two"
        assert (token, running) == (self.current, motion.number)
        assert before.homed
        assert before.mode is Mode.ARMED
        assert age_s <= 0.5
        assert ahead_s >= 0.0
        after = self.state.motion
        assert after is not None
        assert after.number == motion.number + 1
        from_m = motion.path.at(min(motion.progress_s + ahead_s, motion.path.duration_s))
        if not returns(Trajectory(range(len(ends) + 1), [from_m, *ends]), CALIBRATION):
            self.judge_strength(after.path)
        kept_s = min(ahead_s, motion.path.duration_s - motion.progress_s)
        for time_s in np.linspace(0.0, kept_s, 7):
            assert np.abs(after.path.at(time_s) - motion.path.at(motion.progress_s + time_s)).max() <= 1.5e-4, "the old path first"
        assert np.array_equal(after.path.lengths_m[-1], ends[-1])
        speeds = np.abs(np.diff(after.path.lengths_m, axis=0)) / np.diff(after.path.times_s)[:, None]
        assert speeds[1:].max(initial=0.0) <= 0.02 * (1 + 1e-6)
        assert all(abs(length - MID_M) <= 0.045 + 1e-9 for end in ends for length in end)

    @precondition(lambda self: self.state.motion is not None)
    @rule(count=st.integers(0, 20), stall_s=st.floats(0.06, 0.95))
    def stall_in_motion(self, count: int, stall_s: float) -> None:
        assert self.current is not None
        self.live(count)
        self.feed(Prove(self.current))
        self.time_s += stall_s
        self.feed(Tick())

    @precondition(lambda self: self.current is not None)
    @rule(number=st.none() | st.integers(0, 3))
    def hold(self, number: int | None) -> None:
        self.feed(Hold("held", number))

    @rule()
    def stop(self) -> None:
        powered = self.state.energised
        effects = self.feed(Stop())
        assert self.state.mode is Mode.FAULT
        held = [effect for effect in effects if isinstance(effect, Send)]
        assert [effect.kind for effect in held] == ([Kind.HOLD] if any(powered) else [])
        for effect in held:
            assert effect.struts == tuple(index for index, on in enumerate(powered) if on)

    @rule()
    def lose_the_link(self) -> None:
        effects = self.feed(LinkDown("gone"))
        assert not any(isinstance(effect, Send) for effect in effects)
        assert not any(self.state.energised)
        assert self.state.mode is Mode.FAULT

    @rule()
    def fail(self) -> None:
        self.feed(Stop("bug"))
        assert self.state.mode is Mode.FAULT

    @rule()
    def reset(self) -> None:
        self.feed(Reset())
        assert self.state.mode is not Mode.FAULT

    @rule(wait_s=waits, congested=st.sampled_from([False, False, True]))
    def tick(self, wait_s: float, congested: bool) -> None:
        self.time_s += wait_s
        self.feed(Tick(congested))

    @rule(count=st.integers(1, 120))
    def live(self, count: int) -> None:
        for _ in range(count):
            self.time_s += 0.05
            if self.current is not None:
                self.feed(Prove(self.current))
            self.feed(Tick())

    @rule(millivolts=st.sampled_from([None, 7400, 7400, 6399]))
    def supply(self, millivolts: int | None) -> None:
        self.supply_mv = millivolts
        assert self.feed(Supply(millivolts)) == ()

    @rule(seconds=st.floats(1.0, 40.0))
    def rest(self, seconds: float) -> None:
        self.live(round(seconds / 0.05))

    # ---- what must hold ---------------------------------------------------------------------------------------------

    def execute(self, token: str, age_s: float, times: list[float], ends: list[tuple[float, ...]]) -> None:
        try:
            trajectory = Trajectory(times, ends)
        except TrajectoryError:
            return
        before = self.state
        effects = self.feed(Execute(trajectory, token, age_s, 1))
        if not effects:  # accepted
            assert token == self.current
            assert self.time_s - self.proven_s <= SILENCE_S
            assert age_s <= 0.5
            assert before.homed
            assert before.mode in (Mode.ARMED, Mode.HOLD)
            assert all(abs(length - MID_M) <= 0.045 + 1e-9 for end in ends for length in end)
            knots = np.array([CALIBRATION.lengths_m([pulse or 0 for pulse in before.pulses_us]), *ends])
            speeds = np.abs(np.diff(knots, axis=0)) / np.diff([0.0, *times])[:, None]
            assert speeds.max() <= 0.02 + 2e-4 / min(np.diff([0.0, *times]))
            assert (knots.max(axis=1) - knots.min(axis=1)).max() <= SPREAD_M + 2e-4
            path = Trajectory([0.0, *times], knots)
            if not returns(path, CALIBRATION):
                self.judge_strength(path)

    def judge_strength(self, path: Trajectory) -> None:
        """An accepted motion that loads the struts: the supply is not low, and no strut will have run too long anywhere on it."""
        assert self.supply_mv is None or self.supply_mv >= LOW_MV
        edges = np.arange(0.0, path.duration_s + 0.05, 0.05)
        lengths_m = np.stack([np.interp(edges, path.times_s, column) for column in path.lengths_m.T], axis=1)
        pulses_us = whole(exact_pulses_us(CALIBRATION, lengths_m))
        held = (lengths_m[:-1] - MID_M > LOADED_M + 1e-4) & (lengths_m[1:] - MID_M > LOADED_M + 1e-4)
        runs_s = 0.05 * ((np.diff(pulses_us, axis=0) != 0) | held)
        at_s = np.array([*(at for at, _ in self.ran), *(self.time_s + edges[:-1])])
        ran_s = np.array([*(run_s for _, run_s in self.ran), *runs_s])
        for window_s, budget_s in WINDOWS:
            for edge in self.time_s + edges[:-1:10]:
                assert ran_s[(at_s > edge - window_s) & (at_s <= edge)].sum(axis=0).max() <= budget_s + 1e-6

    def feed(self, event: Event) -> tuple[object, ...]:
        before = self.state
        try:
            self.state, effects = self.supervisor.step(before, event, Now(self.time_s, self.time_s))
        except Refused as error:
            refused = error
        else:
            refused = None
        if isinstance(event, Tick):
            self.count_held(before)
        if refused is not None:
            assert "\n" not in str(refused)
            return (refused,)
        if isinstance(event, Arm):
            assert event.lifted_and_clear
            assert self.current is None
            assert self.state.mode is Mode.HOMING
            self.current, self.proven_s = event.token, self.time_s
            self.homed_alone = set()
        for effect in effects:
            if isinstance(effect, Send):
                self.judge(effect, event, before)
        if isinstance(event, Prove):
            assert event.lease == self.current
            self.proven_s = self.time_s
        if self.state.lease is None:
            self.current = None
        if before.mode is Mode.FAULT and self.state.mode is not Mode.FAULT:
            assert isinstance(event, Reset)
            assert self.state.mode is Mode.DISARMED
        if self.state.mode is Mode.ARMED and before.mode not in (Mode.ARMED, Mode.HOLD):
            assert before.mode is Mode.HOMING
            assert self.homed_alone == set(range(6)), "homing energises every strut first"
            assert self.board == list(CALIBRATION.pulses_us([MID_M] * 6))
        return effects

    def count_held(self, before: State) -> None:
        """In whatever state: struts that hold under load since the tick before."""
        held_s = 0.0 if self.ticked_s is None else self.time_s - self.ticked_s
        self.ticked_s = self.time_s
        self.ran.append((self.time_s, held_s * self.held(before)))

    @staticmethod
    def held(state: State) -> np.ndarray:
        strokes_m = [0.0 if us is None else CALIBRATION.length_m(index, us) - MID_M for index, us in enumerate(state.pulses_us)]
        return np.array(state.energised) & (np.array(strokes_m) > LOADED_M)

    def judge(self, send: Send, event: Event, before: State) -> None:
        known = list(before.pulses_us)
        changes = np.zeros(6)
        for index in send.struts:
            strut, pulse = CALIBRATION.struts[index], send.pulses_us[index]
            assert isinstance(pulse, int)
            assert strut.pulse_us[0] <= pulse <= strut.pulse_us[1]
            stroke_m = CALIBRATION.length_m(index, pulse) - MID_M
            if send.kind is Kind.MOVE:
                assert abs(stroke_m) <= 0.045 + strut.quantum_m
            assert known[index] is not None, "no strut is moved from an unknown position"
            changes[index] = abs(CALIBRATION.length_m(index, pulse) - CALIBRATION.length_m(index, known[index]))
            assert changes[index] <= 0.002 + strut.quantum_m + 1e-9
            assert changes[index] <= 0.02 * send.duration_ms * 1e-3 + strut.quantum_m + 1e-9
            if self.board[index] is not None and send.kind is not Kind.ENERGISE:
                assert known[index] == self.board[index], "the record is what the board was sent"
        self.judge_by_the_board(send)
        if send.kind is Kind.ENERGISE:
            assert not changes.any()
        if send.kind in (Kind.MOVE, Kind.HOME):
            first = before.motion is None or before.motion.ticked_s is None
            run_s = 0.05 if first else min(0.05, self.time_s - before.motion.ticked_s)  # type: ignore[operator,union-attr]
            self.ran.append((self.time_s, run_s * (changes > 0.0) * ~self.held(before)))
        if send.kind is Kind.ENERGISE:
            assert len(send.struts) == 1
            self.homed_alone.add(send.struts[0])
        if send.kind in (Kind.MOVE, Kind.HOME):
            assert self.homed_alone == set(range(6))
            assert shape(CALIBRATION.lengths_m(send.pulses_us)) is None or self.is_borderline(send)
        if send.kind is not Kind.HOLD:
            assert isinstance(event, Tick)
            assert self.current is not None
            assert self.time_s - self.proven_s <= SILENCE_S
            assert before.mode is (Mode.ARMED if send.kind is Kind.MOVE else Mode.HOMING)
        for index in send.struts:
            self.board[index] = send.pulses_us[index]

    def judge_by_the_board(self, send: Send) -> None:
        """Nothing is faster than the limit from where a board is that goes straight to what it was told, and a hold is there."""
        assert send.duration_ms == 55
        for index in send.struts:
            ramp, pulse = self.ramps[index], send.pulses_us[index]
            at_us = float(pulse)
            if ramp is not None:
                from_us, to_us, since_s = ramp
                at_us = from_us + min(1.0, (self.time_s - since_s) / 0.055) * (to_us - from_us)
            quantum_m = CALIBRATION.struts[index].quantum_m
            assert abs(pulse - at_us) * quantum_m <= 0.02 * 0.055 + quantum_m + 1e-9
            assert send.kind is not Kind.HOLD or abs(pulse - at_us) <= 0.501
            self.ramps[index] = (at_us, float(pulse), self.time_s)

    def is_borderline(self, send: Send) -> bool:
        """Frames fall between the judged ones: by rounding alone a shape may be over; the bridge's last gate stops it."""
        lengths_m = CALIBRATION.lengths_m(send.pulses_us)
        return max(lengths_m) - min(lengths_m) <= SPREAD_M + 2e-4

    @invariant()
    def all_that_heats_is_counted(self) -> None:
        for window_s, _ in WINDOWS:
            ran_s = sum((run_s for at_s, run_s in self.ran if at_s > self.time_s - window_s), np.zeros(6))
            assert (self.state.duty.used_s(self.time_s, window_s) >= ran_s - 1e-6).all()

    @invariant()
    def nothing_moves_without_a_lease(self) -> None:
        assert self.state.motion is None or self.state.lease is not None
        assert self.state.motion is None or self.state.mode in (Mode.HOMING, Mode.ARMED)


AnySequence.TestCase.settings = settings(max_examples=examples(200), stateful_step_count=40, deadline=None)
test_any_sequence_of_events_keeps_the_promises = AnySequence.TestCase
