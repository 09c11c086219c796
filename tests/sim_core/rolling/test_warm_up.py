# SPDX-License-Identifier: Apache-2.0
"""Compiled code outlives the process that compiled it, also in a checkout that was never used before. No clock decides."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import sim_core

CODE = """
import json
from sim_core.rolling.warm_up import Stage, _Watch, is_warm, warm_up
from numba.core import event

before = is_warm()
told = []
done = warm_up([Stage.ROBOT], lambda name, count: told.append(name))
used = _Watch(lambda name, count: None)
with event.install_listener("numba:compile", used):
    from sim_core.dynamics.model import build_model
    from sim_core.structure.parameters import load_prototype
    from sim_core.dynamics.robot import Robot
    robot = Robot.resting_on(build_model(load_prototype()), "TO1")
    robot.advance(2)
    robot.footing(), robot.cable_forces_n(), robot.body_pose(), robot.digest(), robot.clearance_m()
names = [row.name for row in done]
print(json.dumps([before, names, told, [row.own_s for row in done], [row.name for row in used.done], is_warm()]))
"""


def run(parent):
    environ = {"PYTHONPATH": str(parent), "PATH": os.environ["PATH"]}
    done = subprocess.run([sys.executable, "-c", CODE], env=environ, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    """The package's sources without anything compiled, as in a fresh clone."""
    parent = tmp_path_factory.mktemp("clone")
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(sim_core.__file__).parent, parent / "sim_core", ignore=ignore)
    return parent


@pytest.mark.slow
def test_a_fresh_clone_compiles_once_and_its_second_run_nothing(fresh):
    warm_before, done, told, own_s, used, warm = run(fresh)
    assert not warm_before
    assert warm
    assert "vfife.advance" in done
    assert sorted(told) == sorted(done)
    assert all(seconds >= 0.0 for seconds in own_s)
    assert used == [], "the stage left out what a robot needs"
    warm_before, done, told, _, used, _ = run(fresh)
    assert (warm_before, done, told, used) == (True, [], [], [])
