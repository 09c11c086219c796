# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from hardware_bridge.boards.lsc import Lsc
from hardware_bridge.errors import (
    DutyError,
    FaultLatched,
    LeaseError,
    LimitError,
    NotClear,
    PositionUnknown,
    Refused,
    ShapeError,
    StaleError,
    StateError,
    SupplyError,
)
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.limits import Limits, Pacing
from hardware_bridge.safety.supervisor import Supervisor
from hardware_bridge.safety.supervisor_messages import (
    Arm,
    Disarm,
    Effect,
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
from tests.hardware_bridge.helpers import MID, MID_M


class Driver:
    """Feeds a supervisor and keeps its state, time and effects."""

    def __init__(self, rules: Rules, pulses_us: tuple[int | None, ...] = (None,) * 6) -> None:
        self.supervisor = Supervisor(rules, Lsc().move_time_s)
        self.state = State(pulses_us=pulses_us)
        self.time_s = 100.0
        self.effects: list[Effect] = []

    def feed(self, event: Event) -> tuple[Effect, ...]:
        self.state, effects = self.supervisor.step(self.state, event, Now(self.time_s, self.time_s))
        self.effects += effects
        return effects

    def refusal(self, event: Event) -> Refused:
        before = self.state
        with pytest.raises(Refused) as caught:
            self.feed(event)
        assert self.state == before
        return caught.value

    def tick(self, after_s: float = 0.05, congested: bool = False) -> tuple[Effect, ...]:
        self.time_s += after_s
        if self.state.lease is not None:
            self.feed(Prove(self.state.lease.token))
        return self.feed(Tick(congested))

    def arm(self) -> None:
        self.feed(Arm("test", True, "key", MID))
        for _ in range(5000):
            self.tick()
            if self.state.mode is Mode.ARMED:
                self.effects.clear()
                return
        raise AssertionError("homing does not end")

    def move(self, stroke_m: float = 0.01, time_s: float = 1.0) -> None:
        trajectory = Trajectory([time_s], [[MID_M + stroke_m, *MID[1:]]])
        assert not self.feed(Execute(trajectory, "key", 0.0, 1))

    def sent(self) -> list[Send]:
        return [effect for effect in self.effects if isinstance(effect, Send)]


@pytest.fixture
def driver(rules: Rules) -> Driver:
    return Driver(rules)


@pytest.fixture
def armed(driver: Driver) -> Driver:
    driver.arm()
    return driver


# ---- arming and homing ----------------------------------------------------------------------------------------------


def test_arming_needs_the_operators_word(driver: Driver) -> None:
    assert isinstance(driver.refusal(Arm("test", False, "key", MID)), NotClear)


def test_arming_needs_every_position(driver: Driver) -> None:
    error = driver.refusal(Arm("test", True, "key", (*MID[:3], None, *MID[4:])))
    assert isinstance(error, PositionUnknown)
    assert error.strut == "S4"
    assert isinstance(driver.refusal(Arm("test", True, "key", (*MID[:5], float("nan")))), PositionUnknown)
    assert isinstance(driver.refusal(Arm("test", True, "key", MID[:5])), PositionUnknown)


def test_a_confirmed_length_outside_the_actuator_is_refused(driver: Driver) -> None:
    error = driver.refusal(Arm("test", True, "key", (0.3, *MID[1:])))
    assert isinstance(error, LimitError)
    assert error.strut == "S1"


def test_a_record_and_a_confirmation_that_disagree_are_refused(rules: Rules) -> None:
    driver = Driver(rules, (1500, 1500, 1700, 1500, 1500, 1500))
    error = driver.refusal(Arm("test", True, "key", MID))
    assert isinstance(error, PositionUnknown)
    assert error.strut == "S3"
    assert driver.feed(Arm("test", True, "key")) == ()
    assert driver.state.lease is not None
    assert driver.state.lease.token == "key"


def test_homing_energises_one_strut_at_a_time_where_it_is_and_then_goes_slowly(rules: Rules) -> None:
    start = (1800, 1500, 1500, 1400, 1500, 1500)
    rules = replace(rules, pacing=Pacing(energise_pause_s=0.3, homing_speed_m_s=0.008))
    driver = Driver(rules, start)
    driver.feed(Arm("test", True, "key"))
    times = []
    while driver.state.mode is Mode.HOMING:
        if any(isinstance(effect, Send) for effect in driver.tick()):
            times.append(driver.time_s)
    sent = driver.sent()
    assert [frame.struts for frame in sent[:6]] == [(0,), (1,), (2,), (3,), (4,), (5,)]
    assert all(frame.kind is Kind.ENERGISE and frame.pulses_us == start for frame in sent[:6])
    assert min(np.diff(times[:7])) >= 0.3 - 1e-9
    pulses = np.array([start, *(frame.pulses_us for frame in sent[6:])])
    assert all(frame.kind is Kind.HOME and len(frame.struts) == 6 for frame in sent[6:])
    assert np.abs(np.diff(pulses, axis=0)).max() <= 0.008 * 0.05 * 1e4 + 1
    assert tuple(pulses[-1]) == (1500,) * 6
    assert driver.state.mode is Mode.ARMED


def test_homing_through_a_bad_shape_is_refused(rules: Rules) -> None:
    driver = Driver(replace(rules, shape_check=lambda lengths: "slack"), (1600,) * 6)
    assert isinstance(driver.refusal(Arm("test", True, "key")), ShapeError)


def test_nobody_else_can_arm(armed: Driver) -> None:
    error = armed.refusal(Arm("other", True, "other key", MID))
    assert isinstance(error, StateError)
    assert "test holds the lease" in str(error)


def test_a_commander_silent_while_homing_loses_the_lease(driver: Driver) -> None:
    driver.feed(Arm("test", True, "key", MID))
    driver.tick()
    driver.time_s += 1.01
    driver.feed(Tick())
    assert (driver.state.mode, driver.state.lease) == (Mode.HOLD, None)
    held = driver.sent()[-1]
    assert held.kind is Kind.HOLD
    assert held.struts == (0,), "only what has power may be sent a pulse"


# ---- moving ---------------------------------------------------------------------------------------------------------


def test_a_motion_is_sent_in_short_frames_and_ends_on_its_last_knot(armed: Driver) -> None:
    armed.move(0.01, 1.0)
    while armed.state.motion is not None:
        armed.tick()
    frames = armed.sent()
    assert len(frames) == 20
    assert {frame.duration_ms for frame in frames} == {55}
    assert frames[-1].pulses_us == (1600, 1500, 1500, 1500, 1500, 1500)
    assert armed.effects[-1] == Finished(1, MotionOutcome.DONE, "")
    assert armed.state.mode is Mode.ARMED


def test_the_board_has_had_its_time_when_a_motion_is_done(armed: Driver) -> None:
    armed.move(0.001, 0.05)
    armed.tick()
    assert armed.sent()[-1].pulses_us[0] == 1510
    assert not armed.tick(0.05)
    assert armed.tick(0.01) == (Finished(1, MotionOutcome.DONE, ""),)


def test_a_late_frame_is_the_newest_due_one_and_the_stale_ones_are_dropped(armed: Driver) -> None:
    armed.move(0.01, 1.0)
    armed.tick()
    armed.tick(0.12)
    assert [frame.pulses_us[0] for frame in armed.sent()] == [1505, 1517]
    assert armed.sent()[-1].duration_ms == 55, "one pulse more than the speed limit, by rounding"


def test_a_frame_is_never_more_than_one_at_the_speed_limit_ahead_of_the_board(armed: Driver) -> None:
    armed.move(0.04, 2.0)
    for after_s in (0.05, 0.05, 0.09, 0.01, 0.05, 0.002, 0.05):
        armed.tick(after_s)
    sent = armed.sent()
    assert {frame.duration_ms for frame in sent} == {55}
    assert max(np.diff([1500, *(frame.pulses_us[0] for frame in sent)])) <= 12


def test_a_very_late_frame_goes_no_farther_than_a_frame_and_the_path_is_kept(armed: Driver) -> None:
    armed.move(0.04, 4.0)
    armed.tick()
    armed.tick(0.9)
    first, late = armed.sent()
    assert late.pulses_us[0] - first.pulses_us[0] == 12, "one frame at the speed limit, and a pulse"
    assert late.duration_ms == 55
    armed.tick()
    assert armed.sent()[-1].pulses_us[0] - late.pulses_us[0] == 5
    while armed.state.motion is not None:
        armed.tick()
    assert armed.sent()[-1].pulses_us[0] == 1900


def test_a_congested_port_gets_no_new_frame(armed: Driver) -> None:
    armed.move()
    armed.tick()
    assert armed.tick(congested=True) == ()
    armed.tick()
    assert [frame.pulses_us[0] for frame in armed.sent()] == [1505, 1515]


@pytest.mark.parametrize(
    ("lease", "age_s", "kind"),
    [("", 0.0, LeaseError), ("wrong", 0.0, LeaseError), ("key", 0.51, StaleError), ("key", -0.6, StaleError),
     ("key", float("nan"), StaleError)],
)  # fmt: skip
def test_a_command_without_lease_or_too_old_moves_nothing(armed: Driver, lease: str, age_s: float, kind: type[Refused]) -> None:
    trajectory = Trajectory([1.0], [MID])
    assert isinstance(armed.refusal(Execute(trajectory, lease, age_s, 1)), kind)
    assert armed.tick() == ()


def test_a_command_outside_the_limits_moves_nothing(armed: Driver) -> None:
    error = armed.refusal(Execute(Trajectory([10.0], [[MID_M + 0.046, *MID[1:]]]), "key", 0.0, 1))
    assert isinstance(error, LimitError)
    assert armed.tick() == ()


def test_a_second_command_waits_for_the_first(armed: Driver) -> None:
    armed.move()
    assert isinstance(armed.refusal(Execute(Trajectory([1.0], [MID]), "key", 0.0, 2)), StateError)


def test_a_command_while_homing_is_refused(driver: Driver) -> None:
    driver.feed(Arm("test", True, "key", MID))
    assert isinstance(driver.refusal(Execute(Trajectory([1.0], [MID]), "key", 0.0, 1)), StateError)


# ---- ending ---------------------------------------------------------------------------------------------------------


def test_cancel_holds_and_the_holder_may_go_on(armed: Driver) -> None:
    armed.move()
    armed.tick()
    armed.time_s += 0.02
    effects = armed.feed(Hold("cancelled", 1))
    assert armed.state.mode is Mode.HOLD
    assert effects == (
        Send(Kind.HOLD, (0, 1, 2, 3, 4, 5), (1502, 1500, 1500, 1500, 1500, 1500), 55),
        Finished(1, MotionOutcome.HELD, "cancelled"),
    )
    assert armed.tick() == ()
    armed.move()
    assert armed.state.mode is Mode.ARMED


def test_cancelling_an_ended_motion_does_nothing(armed: Driver) -> None:
    assert armed.feed(Hold("cancelled", 1)) == ()
    assert armed.state.mode is Mode.ARMED


def test_a_silent_commander_ends_the_motion_and_loses_the_lease(armed: Driver) -> None:
    armed.move(0.04, 4.0)
    armed.tick()
    armed.time_s += 1.01
    effects = armed.feed(Tick())
    assert [effect.kind for effect in effects if isinstance(effect, Send)] == [Kind.HOLD]
    assert armed.state.mode is Mode.HOLD
    assert "test was silent" in armed.state.reason
    assert isinstance(armed.refusal(Prove("key")), LeaseError)
    assert isinstance(armed.refusal(Execute(Trajectory([1.0], [MID]), "key", 0.0, 2)), LeaseError)
    armed.feed(Arm("next", True, "new key"))
    assert armed.state.mode is Mode.HOMING


def test_the_lease_is_judged_on_the_wall_clock(armed: Driver) -> None:
    now = Now(armed.time_s + 100.0, armed.time_s + 0.9)
    state, _ = armed.supervisor.step(armed.state, Tick(), now)
    assert state.mode is Mode.ARMED


def test_disarm_needs_the_lease_and_holds(armed: Driver) -> None:
    armed.move()
    armed.tick()
    assert isinstance(armed.refusal(Disarm("wrong")), LeaseError)
    effects = armed.feed(Disarm("key"))
    assert isinstance(effects[0], Send)
    assert effects[0].kind is Kind.HOLD
    assert (armed.state.mode, armed.state.lease, armed.state.homed) == (Mode.DISARMED, None, False)


def test_stop_latches_and_only_reset_leaves(armed: Driver) -> None:
    armed.move()
    armed.tick()
    armed.time_s += 0.033
    effects = armed.feed(Stop())
    assert isinstance(effects[0], Send)
    assert effects[0].pulses_us == (1503, 1500, 1500, 1500, 1500, 1500), "where the board is after 33 of 55 ms"
    assert effects[1] == Finished(1, MotionOutcome.FAULT, "stop pressed")
    for event in (Arm("x", True, "k", MID), Disarm("key"), Execute(Trajectory([1.0], [MID]), "key", 0.0, 2)):
        error = armed.refusal(event)
        assert isinstance(error, FaultLatched)
        assert "stop pressed" in str(error)
    assert armed.tick(10.0) == ()
    armed.feed(LinkDown("gone"))
    assert armed.state.reason == "stop pressed", "the first fault is the one to tell"
    armed.feed(Reset())
    assert armed.state.mode is Mode.DISARMED


def test_a_lost_link_latches_and_sends_nothing(armed: Driver) -> None:
    armed.move()
    armed.tick()
    assert armed.feed(LinkDown("gone")) == (Finished(1, MotionOutcome.FAULT, "gone"),)
    assert armed.state.mode is Mode.FAULT
    assert not any(armed.state.energised), "the board may have lost its power"
    assert armed.state.pulses_us[0] == 1505, "it ends its last frame, nobody has told it otherwise"


def test_an_internal_failure_latches_and_holds(armed: Driver) -> None:
    effects = armed.feed(Stop("bug"))
    assert isinstance(effects[0], Send)
    assert armed.state.mode is Mode.FAULT


# ---- duty -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def loaded(rules: Rules) -> Driver:
    """Under power at mid stroke, beside a judge that finds S2 loaded wherever S1 is out by more than 5 mm."""
    driver = Driver(replace(rules, loads=lambda lengths_m: (False, lengths_m[0] > MID_M + 5e-3, *(False,) * 4)))
    driver.arm()
    driver.move(0.02, 2.0)
    while driver.state.motion is not None:
        driver.tick()
    return driver


def used_s(driver: Driver) -> np.ndarray:
    return driver.state.duty.used_s(driver.time_s, driver.supervisor.rules.limits.duty_window_s)


ENDS = {
    "armed and idle": [],
    "held": [Hold("cancelled")],
    "given back": [Disarm("key")],
    "stopped": [Stop()],
    "reset": [Stop(), Reset()],
}


@pytest.mark.parametrize("how", ENDS)
def test_a_strut_that_is_held_under_load_runs_in_every_state(loaded: Driver, how: str) -> None:
    for event in ENDS[how]:
        loaded.feed(event)
    before_s = used_s(loaded)
    for _ in range(100):
        loaded.tick(0.1)
    assert used_s(loaded) - before_s == pytest.approx([0, 10.0, 0, 0, 0, 0])


def test_a_strut_without_power_does_not_run(loaded: Driver) -> None:
    loaded.feed(LinkDown("gone"))
    before_s = used_s(loaded)
    loaded.tick(10.0)
    assert (used_s(loaded) == before_s).all()


def test_a_strut_that_moves_under_load_is_counted_once(loaded: Driver) -> None:
    before_s = used_s(loaded)
    loaded.feed(Execute(Trajectory([2.0], [[MID_M + 0.02, MID_M + 0.02, *MID[2:]]]), "key", 0.0, 2))
    for _ in range(40):
        loaded.tick()
    assert used_s(loaded) - before_s == pytest.approx([0, 2.0, 0, 0, 0, 0])


def test_the_way_back_may_overtake_whatever_duty_and_supply_are(rules: Rules) -> None:
    driver = Driver(replace(rules, limits=Limits(duty_window_s=10.0)))
    driver.arm()
    driver.move(0.02, 1.6)
    driver.tick()
    driver.feed(Supply(6000))
    further = Execute(Trajectory([2.2], [[MID_M + 0.04, *MID[1:]]]), "key", 0.0, 2)
    assert isinstance(driver.refusal(Overtake(further, 1, 0.3)), DutyError)
    short = Execute(Trajectory([0.1], [[MID_M + 0.006, *MID[1:]]]), "key", 0.0, 2)
    assert isinstance(driver.refusal(Overtake(short, 1, 0.3)), SupplyError)
    back = Execute(Trajectory([1.0], [MID]), "key", 0.0, 2)
    (finished,) = driver.feed(Overtake(back, 1, 0.3))
    assert isinstance(finished, Finished)
    assert finished.outcome is MotionOutcome.OVERTAKEN
    while driver.state.motion is not None:
        driver.tick()
    assert driver.state.pulses_us == driver.supervisor.rules.calibration.pulses_us(list(MID))


def test_a_motion_may_be_overtaken_within_a_hair_of_one_of_its_knots(armed: Driver) -> None:
    armed.feed(Execute(Trajectory([0.2, 1.0], [[MID_M + 0.002, *MID[1:]], [MID_M + 0.01, *MID[1:]]]), "key", 0.0, 1))
    for number, from_s in enumerate((0.2 + 1e-13, 0.2 - 1e-13, 1e-13), start=2):
        back = Execute(Trajectory([1.0], [MID]), "key", 0.0, number)
        (finished,) = armed.feed(Overtake(back, number - 1, from_s))
        assert isinstance(finished, Finished)
