# SPDX-License-Identifier: Apache-2.0
"""Small vibrations of the robot at rest: natural frequencies of the linearised model, and of a simulated free vibration."""

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import eig
from scipy.optimize import brentq
from scipy.signal.windows import blackmanharris

from sim_core.dynamics import vfife as k
from sim_core.dynamics.model import Model, build_model
from sim_core.dynamics.robot import Robot
from sim_core.dynamics.stability import ground_stiffness, mass_diagonal, stiffness
from sim_core.errors import ModelError
from sim_core.structure.arrays import Array
from sim_core.structure.parameters import Prototype
from sim_core.structure.topology import JOINTS, POINTS_PER_JOINT

REFERENCE_FACE = "TC6"


class Modes(NamedTuple):
    """Natural modes, lowest first.

    Attributes:
        frequency_hz: (6P,).
        shape: (6P, 6P), columns: displacement and rotation of each particle, mass-normalised.
    """

    frequency_hz: Array
    shape: Array


def resting_modes(robot: Robot) -> Modes:
    """Modes about the robot's present rest, the contact points that touch the ground sticking (linear springs).

    Raises:
        ModelError: a direction has no stiffness, so that this is no stable rest.
    """
    e, model = robot.model.elements, robot.model
    frames = robot.frames()
    touching = np.flatnonzero(robot.contact_points_m()[:, 2] < 0.0)
    total = stiffness(robot.rows()[0], model.par, model.assembly)
    total += ground_stiffness(e, frames, touching)
    _add_turning_of_arms(total, robot, frames, touching)
    scale = 1.0 / np.sqrt(mass_diagonal(e))
    values, vectors = eig(scale[:, None] * total * scale[None, :])
    order = np.argsort(values.real)
    squares = values.real[order]
    if squares[0] <= 0.0:
        raise ModelError(f"the rest is not stable: the softest mode has omega² = {squares[0]:.3g} 1/s²; is the self-stress slack?")
    return Modes(np.sqrt(squares) / (2.0 * np.pi), scale[:, None] * vectors.real[:, order])


def _add_turning_of_arms(total: Array, robot: Robot, frames: Array, touching: Iterable[int]) -> None:
    """Geometric stiffness of the ground's forces: as a joint turns, so do the arms at which they act. M = r × F, δr = δφ × r."""
    e, layout = robot.model.elements, robot.model.layout
    stretch = robot.rows()[0][layout.contacts :].reshape(-1, k.CONTACT_ROWS)[:, k.U : k.U + 2]
    height = robot.contact_points_m()[:, 2]
    normal, tangential = e.ground_stiffness_n_m
    for point in touching:
        joint = point // POINTS_PER_JOINT
        arm = frames[joint] @ e.contact_point_m[point]
        force = np.append(-tangential * stretch[point], -normal * height[point])
        turn = slice(6 * joint + 3, 6 * joint + 6)
        total[turn, turn] += (force @ arm) * np.eye(3) - np.outer(arm, force)


def first_frequency_hz(model: Model) -> float:
    """Lowest natural frequency at rest on TC6, feet sticking."""
    return float(resting_modes(Robot.resting_on(model, REFERENCE_FACE)).frequency_hz[0])


def vibrated_frequency_hz(model: Model, seconds: float = 40.0, amplitude_m: float = 2e-5) -> float:
    """The same frequency from a simulated free vibration.

    The robot is set moving in its first mode, without mass damping, and the largest peak of the spectrum is read (Blackman–Harris
    window, parabola through the logarithm of the peak).
    """
    prototype = replace(model.prototype, mass_damping_ratio=0.0)
    free = build_model(prototype, replace(model.elements, zeta_1_s=0.0))
    robot = Robot.resting_on(free, REFERENCE_FACE)
    modes = resting_modes(robot)
    shape = modes.shape[:, 0].reshape(-1, 6)
    node = int(np.argmax(np.abs(shape[:JOINTS, :3]).max(axis=1)))
    axis = int(np.argmax(np.abs(shape[node, :3])))
    robot.push(shape[:, :3] * (2.0 * np.pi * modes.frequency_hz[0] * amplitude_m / np.abs(shape[:, :3]).max()))
    every = free.steps_per_second // 100
    rate = free.steps_per_second / every
    track = np.empty(int(seconds * rate))
    for i in range(len(track)):
        robot.advance(every)
        track[i] = robot.joints_m()[node, axis]
    power = np.abs(np.fft.rfft((track - track.mean()) * blackmanharris(len(track)), 8 * len(track)))
    power[: int(0.5 * 8 * len(track) / rate)] = 0.0  # below 0.5 Hz: drift
    peak = int(power.argmax())
    a, b, c = np.log(power[peak - 1 : peak + 2])
    return float((peak + 0.5 * (a - c) / (a - 2 * b + c)) * rate / (8 * len(track)))


def calibrated(prototype: Prototype, frequency_hz: float) -> Prototype:
    """The prototype with the stiffness of all ropes scaled until its first frequency is the wanted one.

    The ropes' stretch is kept, so the prestress scales alike. The frequency also sets the mass damping.

    Raises:
        ModelError: no stiffness within a factor of thirty gives that frequency.
    """

    def scaled(log_factor: float) -> Prototype:
        factor = float(np.exp(log_factor))
        return replace(
            prototype,
            first_frequency_hz=frequency_hz,
            tendon_stiffness_n_m=prototype.tendon_stiffness_n_m * factor,
            box_rope_stiffness_n_m=prototype.box_rope_stiffness_n_m * factor,
        )

    def off(log_factor: float) -> float:
        return float(np.log(first_frequency_hz(build_model(scaled(log_factor))) / frequency_hz))

    low, high = -np.log(30.0), np.log(30.0)
    guess = -2.0 * off(0.0)  # frequency goes with the root of stiffness
    span = (max(low, guess - 0.3), min(high, guess + 0.3))
    if span[0] >= span[1] or off(span[0]) * off(span[1]) > 0.0:
        raise ModelError(
            f"no rope stiffness within a factor of 30 of {prototype.tendon_stiffness_n_m:.4g} N/m "
            f"gives a first frequency of {frequency_hz:g} Hz with these masses"
        )
    return scaled(brentq(off, *span, xtol=1e-6))
