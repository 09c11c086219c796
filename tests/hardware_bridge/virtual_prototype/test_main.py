# SPDX-License-Identifier: Apache-2.0
"""The prototype as its user starts it: a process, with the simulated robot."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from hardware_bridge.driver.bridge import Bridge
from hardware_bridge.prototype_client.handshake import observer_path
from hardware_bridge.prototype_client.observation import Observation
from hardware_bridge.prototype_client.observer_client import ObserverClient
from hardware_bridge.safety.trajectory import Trajectory
from hardware_bridge.virtual_prototype.__main__ import main
from tests.hardware_bridge.driver.test_bridge import armed
from tests.hardware_bridge.helpers import MID, wait_for

Run = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def run() -> Iterator[Run]:
    processes: list[subprocess.Popen[str]] = []

    def start(link: Path, *options: str) -> subprocess.Popen[str]:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
        command = [sys.executable, "-m", "hardware_bridge.virtual_prototype", "--link", str(link), *options]
        process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
            start_new_session=True,
        )
        processes.append(process)
        return process

    yield start
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate()


def ready(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline()


@pytest.mark.slow
def test_a_simulated_robot_follows_the_bridge_and_is_seen(run: Run, tmp_path: Path, make_bridge: Callable[..., Bridge]) -> None:
    link = tmp_path / "prototype"
    process = run(link, "--seed", "3", "--time-scale", "4", "--face", "TC4")
    assert ready(process) == f"virtual prototype ready: {link} (lsc, perturbation 5 %, seed 3, time scale 4)\n"
    seen: list[Observation] = []
    client = ObserverClient(str(observer_path(link)), seen.append)
    wait_for(lambda: bool(seen) and seen[-1].settled, "a settled robot", 60.0)
    assert seen[-1].face == "TC4"
    before = seen[-1].joints_m
    bridge = make_bridge(str(link))
    bridge.open()
    with armed(bridge) as lease:
        assert bridge.execute(Trajectory([2.0], [[0.244, *MID[1:]]]), lease).wait(60.0)
        length = np.linalg.norm(before[0] - before[1])
        wait_for(lambda: np.linalg.norm(seen[-1].joints_m[0] - seen[-1].joints_m[1]) > length + 0.008, "a longer strut")
    client.close()
    bridge.close()
    process.terminate()
    assert process.wait(20.0) == 0


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_cleanly(run: Run, tmp_path: Path, number: signal.Signals) -> None:
    link = tmp_path / "prototype"
    process = run(link)
    assert ready(process).startswith("virtual prototype ready")
    process.send_signal(number)
    assert process.wait(20.0) == 0
    assert not link.is_symlink()
    assert not observer_path(link).exists()


@pytest.mark.slow
def test_a_second_one_is_refused_and_a_killed_one_replaced(run: Run, tmp_path: Path) -> None:
    link = tmp_path / "prototype"
    first = run(link)
    assert ready(first)
    second = run(link)
    _, error = second.communicate(timeout=60)
    assert second.returncode == 1
    assert error == f"virtual prototype {link}: another one lives there; stop it, or give another --link\n"
    first.kill()
    first.wait()
    third = run(link)
    assert ready(third).startswith("virtual prototype ready")


@pytest.mark.parametrize(
    "options",
    [
        ["--face", "TC9"],
        ["--time-scale", "0"],
        ["--perturbation", "nan"],
        ["--baud", "1"],
        ["--board", "x"],
        ["--seed", "x"],
        ["--maestro-home", "3000"],
        ["--maestro-timeout", "0"],
    ],
)
def test_bad_options_are_refused_by_name(options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(options)
    assert caught.value.code == 2
    assert options[0] in capsys.readouterr().err


def test_actuators_that_do_not_exist_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        assert main(["--link", str(tmp_path / "prototype"), "--actuators", "nonesuch"]) == 1
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    error = capsys.readouterr().err
    assert "give ideal, stand-in or a YAML file" in error
    assert error.count("\n") == 1


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        assert main(["--link", str(tmp_path / "file" / "prototype")]) == 1
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    error = capsys.readouterr().err
    assert "give --link in a folder of your own" in error
    assert error.count("\n") == 1
