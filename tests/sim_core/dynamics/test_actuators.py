# SPDX-License-Identifier: Apache-2.0
"""Actuators under load: each effect alone, its size by hand, and what must hold for any command and load."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sim_core.dynamics.actuators import (
    FILE,
    SPECS,
    ActuatorParameters,
    Actuators,
    at_rest,
    lengths_m,
    load_actuators,
    require_actuators,
    step,
)
from sim_core.errors import ParameterError
from sim_core.structure.parameter_file import SOURCES

STAND_IN = load_actuators()
STIFF = replace(STAND_IN, supply_resistance_ohm=0.0)
"""With a supply that does not sag."""
MID_M, DT_S = 0.234, 0.01
MID = np.full(6, MID_M)


def driven(p: ActuatorParameters, commanded_m, force_n: float, time_s: float, start_m=MID) -> Actuators:
    """Actuators that follow one command under one force, from rest under that force."""
    forces = np.full(6, force_n)
    state = at_rest(p, start_m, forces)
    for _ in range(round(time_s / DT_S)):
        state = step(p, state, np.broadcast_to(commanded_m, 6), forces, MID_M, DT_S)
    return state


@pytest.mark.parametrize(
    ("compression_n", "speed_m_s"),
    [(0.0, 0.020), (25.0, 0.015), (50.0, 0.010), (99.0, 0.0002), (-60.0, 0.020)],
)
def test_the_speed_falls_in_a_straight_line_with_the_load_against_it(compression_n, speed_m_s):
    longer = driven(STIFF, MID_M + 0.05, -compression_n, 1.0)
    assert longer.screw_m - MID_M == pytest.approx(np.full(6, speed_m_s), rel=1e-9)
    shorter = driven(STIFF, MID_M - 0.05, compression_n, 1.0)
    assert MID_M - shorter.screw_m == pytest.approx(np.full(6, speed_m_s), rel=1e-9)


def test_it_stalls_at_the_stall_force_and_draws_the_stall_current():
    stalled = driven(STIFF, MID_M + 0.01, -100.0, 0.5)
    assert stalled.stalled.all()
    assert not stalled.sliding.any()
    assert (stalled.screw_m == MID).all()
    assert stalled.current_a == pytest.approx(np.full(6, 1.3))


def test_it_stalls_against_a_stop():
    at_stop = driven(STIFF, MID_M + 0.06, 0.0, 4.0)
    assert at_stop.screw_m == pytest.approx(np.full(6, MID_M + 0.05))
    assert at_stop.stalled.all()
    assert at_stop.current_a == pytest.approx(np.full(6, 1.3))


def test_an_error_within_the_dead_band_is_left_alone():
    assert (driven(STIFF, MID_M + 0.0003, -20.0, 1.0).screw_m == MID).all()
    there = driven(STIFF, MID_M + 0.01, -20.0, 2.0)
    assert np.abs(there.screw_m - MID_M - 0.01).max() <= 0.0003
    assert (there.current_a == 0.0).all(), "a load below the back-drive force costs nothing to hold"


def test_the_load_rests_on_one_side_of_the_play():
    for force_n, shift_m in ((0.0, 0.0), (0.5, 0.00005), (30.0, 0.0001), (-30.0, -0.0001)):
        state = at_rest(STAND_IN, MID, np.full(6, force_n))
        assert lengths_m(STAND_IN, state) - MID == pytest.approx(np.full(6, shift_m))


def test_a_load_that_turns_takes_up_the_whole_play_within_the_load_time():
    state = at_rest(STAND_IN, MID, np.full(6, -30.0))
    for _ in range(30):
        state = step(STAND_IN, state, MID, np.full(6, 30.0), MID_M, DT_S)
    assert lengths_m(STAND_IN, state) - MID == pytest.approx(np.full(6, 0.0001))


def test_without_power_it_holds_up_to_its_back_drive_force_and_then_slides_with_the_load():
    off = np.full(6, np.nan)
    assert (driven(STIFF, off, -46.0, 1.0).screw_m == MID).all()
    slid = driven(STIFF, off, -69.0, 1.0)
    assert slid.sliding.all()
    assert slid.screw_m - MID_M == pytest.approx(np.full(6, -0.005)), "half more than it holds: half the slide speed"
    assert driven(STIFF, off, 69.0, 1.0).screw_m - MID_M == pytest.approx(np.full(6, 0.005))
    assert (slid.current_a == 0.0).all()


def test_under_power_it_holds_more_and_pays_for_it():
    held = driven(STIFF, MID_M, -96.0, 1.0)
    assert (held.screw_m == MID).all()
    assert held.current_a == pytest.approx(np.full(6, 0.1 + 1.2 * 0.5))
    assert driven(STIFF, MID_M, -150.0, 0.01).sliding.all()


def test_six_loaded_motors_pull_the_supply_down_and_are_slower_for_it():
    alone = np.full(6, np.nan)
    alone[0] = MID_M + 0.05
    one, six = driven(STAND_IN, alone, -50.0, 1.0), driven(STAND_IN, MID_M + 0.05, -50.0, 1.0)
    assert one.supply_v == pytest.approx(7.4 - 0.12 * one.current_a.sum())
    assert 6.7 < six.supply_v < one.supply_v < 7.4
    assert six.screw_m[0] < one.screw_m[0] < MID_M + 0.010


def test_six_stalled_motors_on_a_weak_battery_break_the_supply_down():
    weak = replace(STAND_IN, supply_resistance_ohm=0.4)
    assert driven(weak, MID_M + 0.05, -99.0, 1.0).supply_v < weak.brown_out_v
    assert driven(STAND_IN, MID_M + 0.05, -99.0, 1.0).supply_v > STAND_IN.brown_out_v


def test_strength_is_each_actuators_own():
    strength = np.array([0.5, 1.0, 1.0, 1.0, 1.0, 2.0])
    state = at_rest(STIFF, MID, np.zeros(6))
    state = step(STIFF, state, MID + 0.05, np.zeros(6), MID_M, 0.1, strength)
    assert state.screw_m - MID_M == pytest.approx(0.002 * strength)


lengths = arrays(float, 6, elements=st.floats(0.17, 0.30) | st.just(np.nan))
forces = arrays(float, 6, elements=st.floats(-300.0, 300.0))


@given(st.lists(st.tuples(lengths, forces), min_size=1, max_size=30))
def test_whatever_is_asked_and_pulls_nothing_jumps_or_leaves_its_stroke(history):
    state = at_rest(STAND_IN, MID, np.zeros(6))
    for commanded_m, forces_n in history:
        before = state.screw_m.copy()
        after = step(STAND_IN, state, commanded_m, forces_n, MID_M, DT_S)
        assert np.array_equal(state.screw_m, before), "nothing that is given is changed"
        assert np.isfinite(after.screw_m).all()
        assert np.isfinite(after.current_a).all()
        assert np.abs(after.screw_m - before).max() <= 2 * STAND_IN.no_load_speed_m_s * DT_S + 1e-12
        assert np.abs(after.screw_m - MID_M).max() <= STAND_IN.stroke_m + 1e-12
        assert 0.0 <= after.supply_v <= STAND_IN.supply_open_v
        assert (after.current_a <= STAND_IN.stall_current_a + 1e-12).all()
        state = after


# ---- the file -------------------------------------------------------------------------------------------------------


def document() -> dict:
    return yaml.safe_load(FILE.path.read_text(encoding="utf-8"))


def test_every_number_has_a_unit_and_a_source_and_none_claims_to_be_measured():
    rows = {name: row for name, row in document().items() if name not in ("schema", "name")}
    assert rows.keys() == SPECS.keys()
    assert all(row["source"] == "stand-in" and row["note"] for row in rows.values())
    assert "stand-in" in SOURCES


def test_names_choose_actuators(tmp_path):
    assert require_actuators("ideal") is None
    assert require_actuators("stand-in") == STAND_IN
    mine = tmp_path / "mine.yaml"
    mine.write_text(FILE.path.read_text(encoding="utf-8").replace("value: 100.0", "value: 200.0"), encoding="utf-8")
    assert require_actuators(str(mine)) == replace(STAND_IN, stall_n=200.0)
    with pytest.raises(ParameterError, match=r"cannot read actuators file nonesuch: .*; give ideal, stand-in or a YAML file"):
        require_actuators("nonesuch")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"stall_n": None}, "stall_n must be"),
        (
            {"stall_n": {"value": -1.0, "unit": "N", "source": "measured"}},
            r"stall_n = -1.0: valid is a number in \[0.1, 100000\] N",
        ),
        ({"stall_n": {"value": 1.0, "unit": "kg", "source": "measured"}}, "unit 'kg'; valid is 'N'"),
        ({"stall_n": {"value": 1.0, "unit": "N", "source": "guess"}}, "source 'guess'; valid are paper"),
        ({"stall_n": {"value": float("nan"), "unit": "N", "source": "measured"}}, "valid is a number"),
        ({"speed": {}}, "unknown: speed"),
        ({"schema": 2}, "schema 2 is not known"),
        ({"no_load_current_a": {"value": 9.0, "unit": "A", "source": "measured"}}, "valid is no_load_current_a or more"),
    ],
)
def test_an_impossible_file_is_refused_with_what_is_valid(tmp_path, change, problem):
    mine = tmp_path / "mine.yaml"
    mine.write_text(yaml.safe_dump(document() | change), encoding="utf-8")
    with pytest.raises(ParameterError, match=problem) as caught:
        load_actuators(mine)
    assert str(caught.value).startswith(str(mine))
    assert "\n" not in str(caught.value)
