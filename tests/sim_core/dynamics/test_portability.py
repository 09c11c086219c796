# SPDX-License-Identifier: Apache-2.0
"""The same bits on every x86-64 processor: a plain one is imitated by switching the vector units off."""

import os
import subprocess
import sys

import pytest

PROGRAM = """
from sim_core.gaits.library import load_library
from sim_core.dynamics.model import build_model
from sim_core.structure.parameters import load_prototype
from sim_core.uncertainty.perturbation_law import perturb
from sim_core.structure.policy import lengths_of
from sim_core.dynamics.robot import Robot
import pytest
model = build_model(load_prototype())
robot = Robot.resting_on(perturb(model, 0.1, 3), "TO5")
robot.set_targets(lengths_of(model.prototype, load_library("robust").gaits("TO5", "TC6")[0].policy))
robot.advance(2000)
print(model.hash, robot.digest())
"""
PLAIN = {
    "NUMBA_CPU_NAME": "x86-64",
    "NUMBA_CPU_FEATURES": "",
    "OPENBLAS_CORETYPE": "Nehalem",
    "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_ICL X86_V3 X86_V4",
}


def bits(extra):
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", PROGRAM], env={**os.environ, **extra}, capture_output=True, text=True, check=True
    )
    return run.stdout.split()


@pytest.mark.slow
def test_model_and_motion_have_the_same_bits_without_vector_units():
    assert bits(PLAIN) == bits({})
