# SPDX-License-Identifier: Apache-2.0
"""What is said of faulty sensors, and how well a mounting is found: hidden robots on level ground, virtual."""

import math
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context

import numpy as np

from hardware_bridge.virtual_prototype.inertial_sensor import MOUNTED_OFF_RAD, RATE_NOISE_RAD_S, InertialSensor, turned_about
from sim_core.dynamics.model import Model, build_model
from sim_core.dynamics.robot import Robot
from sim_core.gaits.library import gait_of, load_library
from sim_core.sensing.face_filter import box_share
from sim_core.sensing.mounting import found_mounting
from sim_core.structure.parameters import load_prototype
from sim_core.structure.rotations import unit
from sim_core.structure.topology import FACES, NEIGHBOURS
from sim_core.uncertainty.perturbation_law import perturb
from tensegrity_lab.commissioning.imu_mounting import FACES as FELT
from tensegrity_lab.reports.markdown import table
from tests.benchmarks.imu.measure import words_and_faces
from tests.sensed_robot import Sample, SensedRobot

FELT_SAMPLES = 200
SHAKEN_M_S2 = 0.05
Spoil = Callable[[Sample], Sample | None]


@cache
def _nominal() -> Model:
    return build_model(load_prototype())


def _missing(robot: SensedRobot, begins_s: float, rng: np.random.Generator) -> Spoil:
    """Three seconds without a measurement."""
    return lambda sample: None if begins_s < sample[0] < begins_s + 3.0 else sample


def _frozen(robot: SensedRobot, begins_s: float, rng: np.random.Generator) -> Spoil:
    """The same figures from then on."""
    kept: list[Sample] = []

    def spoil(sample: Sample) -> Sample:
        if sample[0] > begins_s:
            kept.append(sample)
        return (sample[0], *kept[0][1:]) if kept else sample

    return spoil


def _late(robot: SensedRobot, begins_s: float, rng: np.random.Generator) -> Spoil:
    """One second late, always."""
    past: list[Sample] = []

    def spoil(sample: Sample) -> Sample:
        past.append(sample)
        return (sample[0], *past[max(0, len(past) - 100)][1:])

    return spoil


def _turned(robot: SensedRobot, begins_s: float, rng: np.random.Generator) -> Spoil:
    """It slips by 30 to 90 degrees about any axis."""
    turn = turned_about(unit(rng.standard_normal(3)), math.radians(rng.uniform(30.0, 90.0)))
    return lambda sample: (sample[0], turn @ sample[1], turn @ sample[2]) if sample[0] > begins_s else sample


def _elsewhere(robot: SensedRobot, begins_s: float, rng: np.random.Generator) -> Spoil:
    """It falls out and lies still, as it was."""
    kept: list[Sample] = []

    def spoil(sample: Sample) -> Sample:
        if sample[0] <= begins_s:
            return sample
        kept.append(sample)
        rate, up = RATE_NOISE_RAD_S * rng.standard_normal(3), kept[0][2] + SHAKEN_M_S2 * rng.standard_normal(3)
        return sample[0], rate, up

    return spoil


def _wrong(robot: SensedRobot, begins_s: float, rng: np.random.Generator) -> Spoil:
    """Any figures, within a sensor's range."""
    return lambda sample: (sample[0], *rng.uniform(-1.0, 1.0, (2, 3)) * [[5.0], [40.0]]) if sample[0] > begins_s else sample


FAULTS = {
    "no measurement for 3 s": _missing,
    "one second late": _late,
    "frozen": _frozen,
    "turned by 30 to 90°": _turned,
    "fallen out, lying still": _elsewhere,
    "random figures": _wrong,
}


def spoilt(job: tuple[str, int]) -> tuple[str, int, int]:
    """One roll with a fault that begins at any time before it or in it: the fault, wrong words, words in all."""
    name, seed = job
    rng, shelf = np.random.default_rng([seed, len(name)]), load_library("robust")
    start = str(rng.choice(list(FACES)))
    robot = SensedRobot(_nominal(), start, seed)
    robot.spoil = FAULTS[name](robot, robot.time_s + float(rng.uniform(0.0, 8.0)), rng)
    robot.wait(1.0)
    fitting = [p for p in shelf.primitives if p.roll_class.source[:2] == start[:2]]
    robot.roll(gait_of(fitting[rng.integers(len(fitting))], start, str(rng.choice(NEIGHBOURS[start]))).policy)
    robot.wait(3.0)
    return name, words_and_faces(robot)[0], len(robot.words)


def mounted(seed: int) -> float:
    """By how much a found mounting is off, in degrees, of a hidden robot that is put on six faces."""
    model, felt = perturb(_nominal(), 0.1, seed), {}
    for face in FELT:
        sensor = InertialSensor(Robot.resting_on(model, face), seed, MOUNTED_OFF_RAD)
        felt[face] = np.mean([sensor.measure()[1] for _ in range(FELT_SAMPLES)], axis=0)
    found = found_mounting(_nominal(), felt, box_share(_nominal())).rotation
    return math.degrees(math.acos(min(1.0, 0.5 * float(np.trace(found.T @ sensor.mounting)) - 0.5)))


def tables(rolls: int, robots: int, processes: int, seed: int) -> str:
    """Faults, so many rolls each; and mountings of so many robots."""
    jobs = [(name, seed + number) for name in FAULTS for number in range(rolls)]
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        told = list(pool.map(spoilt, jobs, chunksize=8))
        off = np.array(list(pool.map(mounted, range(seed, seed + robots), chunksize=4)))
    rows = [
        [
            name,
            f"{rolls}",
            f"{sum(wrong for own, wrong, _ in told if own == name)}",
            f"{sum(n for own, _, n in told if own == name)}",
        ]
        for name in FAULTS
    ]
    worst = f"median {np.median(off):.2f}°, 95 % {np.quantile(off, 0.95):.2f}°, worst {off.max():.2f}°"
    return "\n".join([
        table(["fault", "rolls", "wrong words", "words"], rows),
        f"\nA mounting found from {len(FELT)} faces, on {robots} hidden robots, is off by: {worst}.",
    ])  # fmt: skip
