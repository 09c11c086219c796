# SPDX-License-Identifier: Apache-2.0
"""What servos are told, on boards that interpolate: never faster than the limit, and where they are when told to stop."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.errors import StateFileError, TrajectoryError
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.limits import Limits, Pacing
from hardware_bridge.safety.supervisor_messages import Arm, Disarm, Mode, Tick
from hardware_bridge.safety.trajectory import Trajectory
from tests.hardware_bridge.emulated import Rig
from tests.hardware_bridge.helpers import MID, MID_M
from tests.scale import examples

BOARDS = ("lsc", "ssc32", "maestro")
BAUDS = {"lsc": 9600, "ssc32": 115200, "maestro": 115200}
CALIBRATION = load_calibration()
ODD = replace(
    CALIBRATION, struts=(replace(CALIBRATION.struts[0], direction=-1, us_per_mm=7.3, trim_us=17), *CALIBRATION.struts[1:])
)
CALM = Pacing(energise_pause_s=0.0)
RULES = Rules(ODD, pacing=CALM)


def ups(rules: Rules) -> np.ndarray:
    """us per m, (6,)."""
    return np.array([1.0 / strut.quantum_m for strut in rules.calibration.struts])


def frame_s(rules: Rules) -> float:
    return float(np.ceil(rules.pacing.period_s * rules.pacing.overlap * 1e3 - 1e-3)) * 1e-3


def reach_us(rules: Rules) -> np.ndarray:
    """One frame at the speed limit, and one pulse, (6,)."""
    return rules.limits.speed_m_s * ups(rules) * frame_s(rules) + 1.0 + 1e-6


def check_speeds(rig: Rig) -> None:
    """No servo is ever told to go faster than the limit; a pulse a frame is rounding."""
    limit = rig.rules.limits.speed_m_s * ups(rig.rules) + 1.0 / frame_s(rig.rules)
    slowest = 25.0 if rig.lines.spec == "maestro" else 0.0  # a Maestro's unit
    assert (rig.speeds_us_s() <= np.maximum(limit, slowest) + 1e-6).all()
    assert (rig.most_ahead_us(rig.rules.limits.speed_m_s * ups(rig.rules)) <= 2 * reach_us(rig.rules)).all()
    assert set(rig.lines.durations_ms) <= {round(frame_s(rig.rules) * 1e3)}


def armed(spec: str, rules: Rules = RULES, baud: int = 0) -> Rig:
    rig = Rig(spec, rules, baud)
    rig.arm()
    return rig


speeds = st.floats(-1.0, 1.0) | st.sampled_from([-1.0, 1.0, 0.0])
legs = st.lists(
    st.tuples(st.sampled_from([0.001, 0.01, 0.05, 0.055, 0.13, 0.4, 1.1]), st.tuples(*[speeds] * 6)), min_size=1, max_size=12
)
jitter = st.lists(st.sampled_from([0.05] * 6 + [0.051, 0.049, 0.06, 0.097, 0.003, 0.3]), min_size=1, max_size=60)


def path_of(rules: Rules, start_m: np.ndarray, path: list[tuple[float, tuple[float, ...]]], jump: float) -> Trajectory | None:
    """Legs at parts of the speed limit, within the stroke, with a jump of up to a quantum at the first."""
    at_m, time_s, times, rows = start_m + jump / ups(rules), 1e-9, [1e-9], [start_m + jump / ups(rules)]
    for leg_s, parts in path:
        at_m = np.clip(at_m + rules.limits.speed_m_s * leg_s * np.array(parts), MID_M - 0.04, MID_M + 0.04)
        time_s += leg_s
        times.append(time_s)
        rows.append(at_m)
    try:
        return Trajectory(times, rows)
    except TrajectoryError:
        return None


@pytest.mark.parametrize("baud", [False, True])
@pytest.mark.parametrize("spec", BOARDS)
@settings(max_examples=examples(25), deadline=None)
@given(data=st.data())
def test_at_any_moment_of_any_motion_stop_is_where_the_board_is(spec: str, baud: bool, data: st.DataObject) -> None:
    rig = armed(spec, RULES, BAUDS[spec] if baud else 0)
    limit_us = reach_us(RULES)
    for _ in range(data.draw(st.integers(1, 3))):
        start_m = np.array(rig.engine.lengths_m())
        trajectory = path_of(RULES, start_m, data.draw(legs), data.draw(st.sampled_from([0.0, 0.0, 0.9, -0.9])))
        if trajectory is None or not rig.accepts(trajectory):
            continue
        for after_s in data.draw(jitter):
            rig.tick(after_s)
        if data.draw(st.booleans()):
            at_us = rig.hold(data.draw(st.floats(0.0, 0.06)))
            held_s = rig.lines.now_s
            assert (rig.run_on(held_s) <= limit_us).all()
            if not baud:
                assert np.abs(np.array(rig.sent[-1].pulses_us) - at_us).max() <= 0.51, "what is held is where the board is"
        for _ in range(data.draw(st.integers(0, 4))):
            rig.tick(0.05)
    at_us = rig.stop(data.draw(st.floats(0.0, 0.06)))
    assert (rig.run_on(rig.lines.now_s) <= limit_us).all()
    assert rig.kept.pulses.pulses_us == rig.sent[-1].pulses_us == rig.engine.state.pulses_us
    if not baud:
        assert (rig.run_on(rig.lines.now_s) <= 0.51).all()
        assert np.abs(np.array(rig.sent[-1].pulses_us) - at_us).max() <= 0.51
    check_speeds(rig)


@pytest.mark.parametrize("spec", BOARDS)
def test_the_found_case_runs_no_frame_ahead_and_stops_within_one(spec: str) -> None:
    """19.9 mm/s, as fast as is permitted, sampled every 10 ms, with a frame loop that is often late."""
    rules = Rules(CALIBRATION, pacing=CALM)
    rig = armed(spec, rules)
    times = np.arange(1, 201) * 0.01
    rig.execute(Trajectory(times, MID_M + np.outer(0.0199 * times, [1, -1, 1, 0, 0, 0])))
    for number in range(35):
        rig.tick(0.07 if number % 3 else 0.05)
    rig.stop(0.02)
    assert rig.run_on(rig.lines.now_s).max() <= 12.0
    check_speeds(rig)


@pytest.mark.parametrize("spec", BOARDS)
def test_many_small_motions_gain_no_pulse_each(spec: str) -> None:
    rules = Rules(CALIBRATION, Limits(speed_m_s=0.002), CALM)
    rig = armed(spec, rules)
    began_s, done = rig.lines.now_s, 0
    for _ in range(150):
        aim = np.array(rig.engine.lengths_m()) + 1e-4 * np.eye(6)[0]
        if rig.accepts(Trajectory([1e-9], [aim])):
            done += 1
        rig.tick(0.05)
        rig.tick(0.06)
    assert done > 10
    gained_m = rig.engine.lengths_m()[0] - MID_M
    assert gained_m <= 0.002 * (rig.lines.now_s - began_s) + 2e-4
    check_speeds(rig)


@pytest.mark.parametrize("spec", BOARDS)
def test_cancel_and_go_on_again_and_again_gains_nothing(spec: str) -> None:
    rules = Rules(CALIBRATION, pacing=CALM)
    rig = armed(spec, rules)
    began_s = rig.lines.now_s
    for _ in range(60):
        aim = np.array(rig.engine.lengths_m()) + 1e-3 * (np.eye(6)[0] - np.eye(6)[1])
        assert rig.accepts(Trajectory([0.05], [aim]))
        rig.tick(0.003)
        rig.hold(0.001)
    assert rig.engine.lengths_m()[0] - MID_M <= 0.02 * (rig.lines.now_s - began_s) + 1.2e-3
    check_speeds(rig)


@pytest.mark.parametrize("spec", BOARDS)
@settings(max_examples=examples(15), deadline=None)
@given(ticks=st.integers(0, 60), after_s=st.floats(0.0, 0.06), again=st.booleans())
def test_stop_while_homing_is_where_the_board_is(spec: str, ticks: int, after_s: float, again: bool) -> None:
    rules = Rules(CALIBRATION, pacing=Pacing(energise_pause_s=0.0, homing_speed_m_s=0.02))
    rig = Rig(spec, rules)
    far_m = (0.25, 0.22, 0.24, 0.234, 0.23, 0.26)
    rig.engine.apply(Arm("test", True, "key", far_m))
    for _ in range(7 + ticks):
        rig.tick(0.05)
    at_us = rig.hold(after_s)
    assert np.abs(np.array(rig.sent[-1].pulses_us) - at_us).max() <= 0.51
    assert rig.run_on(rig.lines.now_s).max() <= 0.51
    if again:  # and at once home again, from there
        rig.engine.apply(Disarm("key"))
        rig.arm((None,) * 6)
        assert rig.engine.state.mode is Mode.ARMED
    check_speeds(rig)


@pytest.mark.parametrize(
    ("limits", "pacing", "slope"),
    [
        (Limits(speed_m_s=0.1, step_m=0.01), Pacing(period_s=0.5, energise_pause_s=0.0), 10.0),
        (Limits(speed_m_s=0.1, step_m=0.002), Pacing(period_s=0.03, energise_pause_s=0.0), 10.0),
        (Limits(speed_m_s=0.001), Pacing(energise_pause_s=0.0), 1.0),
        (Limits(speed_m_s=0.02, step_m=0.0002), Pacing(energise_pause_s=0.0), 1.0),
        (Limits(), Pacing(overlap=2.0, energise_pause_s=0.0), 10.0),
        (Limits(), Pacing(overlap=1.0, energise_pause_s=0.0), 50.0),
    ],
)
def test_at_the_ends_of_every_range_motions_end_and_stops_hold(limits: Limits, pacing: Pacing, slope: float) -> None:
    struts = tuple(replace(strut, us_per_mm=slope, stroke_mm=(-9.9, 9.9)) for strut in CALIBRATION.struts)
    rules = Rules(replace(CALIBRATION, struts=struts), limits, pacing)
    rig = armed("lsc", rules)
    speed_m_s = min(limits.speed_m_s, limits.step_m / pacing.period_s)
    motion = rig.execute(Trajectory([0.003 / speed_m_s], [[MID_M + 0.003, MID_M - 0.003, *MID[2:]]]))
    for _ in range(3000):
        rig.tick(pacing.period_s)
        if motion.result() is not None:
            break
    result = motion.result()
    assert result is not None
    assert result.success
    rig.execute(Trajectory([0.003 / speed_m_s], [MID]))
    for _ in range(5):
        rig.tick(pacing.period_s * 1.3)
    rig.stop(0.4 * pacing.period_s)
    assert rig.run_on(rig.lines.now_s).max() <= 0.51
    check_speeds(rig)


def test_what_waits_in_the_port_is_not_put_behind_another_frame(tmp_path: Path) -> None:
    rig = Rig("lsc", Rules(CALIBRATION, pacing=CALM), 9600)
    rig.arm()
    rig.execute(Trajectory([2.0], [[MID_M + 0.03, *MID[1:]]]))
    for _ in range(10):
        rig.tick(0.05)
    frames = len(rig.lines.durations_ms)
    rig.tick(0.01)
    assert len(rig.lines.durations_ms) == frames, "the line has still to carry the frame before"
    rig.tick(0.04)
    assert len(rig.lines.durations_ms) == frames + 1


def test_a_frame_that_was_not_sent_leaves_what_is_known_of_the_board(tmp_path: Path) -> None:
    """The bars of `stop` keep a frame back after the supervisor has counted it."""
    rig = Rig("lsc", Rules(CALIBRATION, pacing=CALM))
    rig.arm()
    rig.execute(Trajectory([2.0], [[MID_M + 0.03, *MID[1:]]]))
    for _ in range(10):
        rig.tick(0.05)
    before = rig.engine.state
    with rig.engine.barred():
        rig.lines.now_s += 0.05
        rig.engine.apply(Tick())
        assert rig.engine.state == before
        at_us = rig.stop()
    assert np.abs(np.array(rig.sent[-1].pulses_us) - at_us).max() <= 0.51


def test_a_full_disk_does_not_keep_a_hold_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig("lsc", Rules(CALIBRATION, pacing=CALM))
    rig.arm()
    rig.execute(Trajectory([2.0], [[MID_M + 0.03, *MID[1:]]]))
    for _ in range(10):
        rig.tick(0.05)

    def full(*_: object, **__: object) -> None:
        raise StateFileError("last.json", "no space left", "the last pulses")

    monkeypatch.setattr(rig.kept.pulses, "save", full)
    rig.tick(0.05)
    assert rig.engine.state.mode is Mode.FAULT
    assert "no space left" in rig.engine.state.reason
    assert rig.sent[-1].kind == "hold"
    assert rig.run_on(rig.lines.now_s).max() <= 0.51


def test_a_hold_that_is_elsewhere_than_the_board_is_put_right_by_the_last_gate(tmp_path: Path) -> None:
    rig = Rig("lsc", Rules(CALIBRATION, pacing=CALM))
    rig.arm()
    rig.execute(Trajectory([2.0], [[MID_M + 0.03, *MID[1:]]]))
    for _ in range(10):
        rig.tick(0.05)
    wrong = replace(rig.engine.state, pulses_us=(1900, *(1500,) * 5), last_frame=None)
    rig.engine.state = wrong
    at_us = rig.stop(0.01)
    assert np.abs(np.array(rig.sent[-1].pulses_us) - at_us).max() <= 0.51
    assert rig.engine.state.pulses_us == rig.sent[-1].pulses_us


def test_the_last_gate_knows_the_board_by_itself(tmp_path: Path) -> None:
    """Whatever the supervisor believes, a strut that is not there yet is not sent on."""
    rig = Rig("lsc", Rules(CALIBRATION, pacing=CALM))
    rig.arm()
    rig.execute(Trajectory([2.0], [[MID_M + 0.03, *MID[1:]]]))
    for _ in range(10):
        rig.tick(0.05)
    motion = rig.engine.state.motion
    assert motion is not None  # it forgets that the last frame is not over, and when it was
    rig.engine.state = replace(rig.engine.state, last_frame=None, motion=replace(motion, ticked_s=0.0))
    rig.tick(0.001)
    assert rig.engine.state.mode is Mode.FAULT
    assert "speed" in rig.engine.state.reason
    check_speeds(rig)
