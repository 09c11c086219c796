"""Compiles every kernel once, into numba's cache beside the sources: `python -m sim_core.warm_up`."""

from __future__ import annotations

from sim_core.compiled_cache import use_own_folder
from sim_core.model import build_model
from sim_core.parameters import load_prototype
from sim_core.robot import Robot


def is_warm() -> bool:
    """Whether compiled kernels of these very sources are there already."""
    return any(use_own_folder().rglob("kernel.advance*.nbc"))


def warm_up() -> None:
    """Run everything that a single robot needs compiled, briefly."""
    robot = Robot(build_model(load_prototype()))
    robot.advance(1)
    robot.clearance_m()


if __name__ == "__main__":
    warm_up()
