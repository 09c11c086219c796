# SPDX-License-Identifier: Apache-2.0
"""The simulated robot with actuators that feel their load, without a board."""

from dataclasses import replace

import numpy as np
import pytest

from hardware_bridge.virtual_prototype.body import ActuatedBody, SimulatedBody
from sim_core.dynamics.actuators import ActuatorParameters, load_actuators

STAND_IN = load_actuators()
MID_M = 0.234


def body(parameters: ActuatorParameters = STAND_IN, perturbation: float = 0.05) -> ActuatedBody:
    return ActuatedBody("TC6", perturbation, 3, parameters)


def drive(robot: SimulatedBody, strokes_m: np.ndarray, time_s: float) -> None:
    """Every 10 ms the lengths again, as the board's outputs are looked at."""
    end_s = robot.time_s + time_s
    while robot.time_s + 0.01 <= end_s:
        robot.set_targets(MID_M + strokes_m)
        robot.advance_to(robot.time_s + 0.01 + 1e-9)


def strut_lengths_m(robot: SimulatedBody) -> np.ndarray:
    joints = robot.observe().joints_m
    return np.linalg.norm(joints[0::2] - joints[1::2], axis=1)


def test_without_a_pulse_it_stands_as_it_stood() -> None:
    robot = body()
    before = robot.observe()
    drive(robot, np.full(6, np.nan), 3.0)
    after = robot.observe()
    assert after.face == before.face == "TC6"
    assert np.abs(after.joints_m - before.joints_m).max() < 0.001
    assert robot.supply_v == 7.4


def test_it_gets_where_it_is_sent_later_than_an_ideal_one_and_comes_to_rest() -> None:
    real, ideal = body(), SimulatedBody("TC6", 0.05, 3)
    start_m = strut_lengths_m(real)
    strokes_m = np.array([0.015, -0.015, 0.01, 0.0, 0.0, -0.01])
    for robot in (real, ideal):
        drive(robot, strokes_m, 0.5)
    longer = strut_lengths_m(real) - start_m
    assert longer[0] < (strut_lengths_m(ideal) - start_m)[0] < 0.0085
    assert real.supply_v is not None
    assert real.supply_v < 7.4
    for robot in (real, ideal):
        drive(robot, strokes_m, 5.0)
    assert strut_lengths_m(real) == pytest.approx(strut_lengths_m(ideal), abs=0.0008), "but for dead band and play"
    assert real.observe().settled
    assert real.observe().face == "TC6"


def test_the_same_seed_is_the_same_robot() -> None:
    one, two = body(), body()
    for robot in (one, two):
        drive(robot, np.array([0.02, 0.0, 0.0, -0.02, 0.0, 0.0]), 1.0)
    assert np.array_equal(one.observe().joints_m, two.observe().joints_m)


def test_too_weak_actuators_leave_a_strut_short() -> None:
    weak = body(replace(STAND_IN, stall_n=20.0))
    drive(weak, np.array([0.02, 0.0, 0.0, 0.0, 0.0, 0.0]), 3.0)
    assert strut_lengths_m(weak)[0] < MID_M + 0.005


def test_a_weak_supply_browns_out_and_says_so_once() -> None:
    robot = body(replace(STAND_IN, supply_resistance_ohm=3.0))
    assert not robot.take_brown_out()
    drive(robot, np.full(6, 0.01), 0.3)
    assert robot.take_brown_out()
    drive(robot, np.full(6, np.nan), 0.1)
    robot.take_brown_out()
    drive(robot, np.full(6, np.nan), 0.1)
    assert not robot.take_brown_out()
