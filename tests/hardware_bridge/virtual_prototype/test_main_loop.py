# SPDX-License-Identifier: Apache-2.0
"""The bridge against the virtual prototype over its real pty, with a body without physics (see `StillBody`)."""

import contextlib
import os
import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hardware_bridge.boards.lsc import Lsc
from hardware_bridge.boards.registry import parse_board
from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.driver.bridge import Bridge
from hardware_bridge.errors import PositionUnknown, PrototypeError, TimeScaleError
from hardware_bridge.prototype_client.handshake import observer_path, read_handshake
from hardware_bridge.prototype_client.observation import Observation, decode_observation
from hardware_bridge.prototype_client.observer_client import ObserverClient
from hardware_bridge.safety.supervisor_messages import Mode, MotionOutcome
from hardware_bridge.safety.trajectory import Trajectory
from hardware_bridge.virtual_prototype.boards.registry import emulate
from hardware_bridge.virtual_prototype.main_loop import VirtualPrototype
from tests.hardware_bridge.driver.test_bridge import armed, there_and_back
from tests.hardware_bridge.helpers import MID, MID_M, StillBody, wait_for

Start = Callable[..., "object"]
Make = Callable[..., Bridge]


def test_a_motion_reaches_the_body_as_it_was_sent(start_prototype: Callable, make_bridge: Make) -> None:
    running = start_prototype(time_scale=4.0)
    bridge = make_bridge(str(running.link))
    bridge.open()
    assert bridge.snapshot().time_scale == 4.0
    assert bridge.snapshot().virtual_port
    target = MID_M + np.array([0.01, -0.01, 0.02, -0.02, 0.003, 0.0])
    with armed(bridge) as lease:
        assert bridge.execute(Trajectory([2.0], [target]), lease).wait(20.0)
        wait_for(lambda: np.allclose(running.body.lengths_m, target), "the body at its target")
    lengths = np.array([MID, *(lengths for _, lengths in running.body.history)])
    steps = np.diff([time_s for time_s, _ in running.body.history])
    assert np.abs(np.diff(lengths, axis=0)).max() < 0.002, "short steps only"
    assert (steps > 0).all()
    wait_for(lambda: bridge.snapshot().battery_mv == 7400, "a battery reply")


def test_a_bridge_of_another_time_scale_is_refused(start_prototype: Callable, make_bridge: Make) -> None:
    running = start_prototype(time_scale=4.0)
    with pytest.raises(TimeScaleError, match="runs at 4"):
        make_bridge(str(running.link), time_scale=1.0).open()


def test_killing_the_prototype_is_a_lost_link_and_a_new_one_is_another_robot(start_prototype: Callable, make_bridge: Make) -> None:
    running = start_prototype(time_scale=4.0)
    bridge = make_bridge(str(running.link))
    bridge.open()
    with armed(bridge) as lease:
        handle = bridge.execute(there_and_back(0.02, 10.0), lease)
        wait_for(lambda: handle.progress().fraction > 0.02, "motion")
        running.kill()
        assert handle.wait(20.0)
    result = handle.result()
    assert result is not None
    assert result.outcome is MotionOutcome.FAULT
    start_prototype(time_scale=4.0)
    bridge.reset()
    assert bridge.snapshot().link_ok
    assert bridge.snapshot().mode is Mode.DISARMED
    with pytest.raises(PositionUnknown):
        bridge.arm("test", True)


def test_a_link_has_one_owner(start_prototype: Callable) -> None:
    running = start_prototype()
    device = os.readlink(running.link)
    with pytest.raises(PrototypeError, match="another one lives there"):
        start_prototype()
    assert os.readlink(running.link) == device


def test_a_stale_link_is_replaced_and_a_file_is_not(start_prototype: Callable, tmp_path: Path) -> None:
    (tmp_path / "prototype").symlink_to("/dev/pts/9999")
    running = start_prototype()
    assert os.readlink(running.link) != "/dev/pts/9999"
    (tmp_path / "mine").write_text("precious")
    with pytest.raises(PrototypeError, match="no link of ours"):
        start_prototype(name="mine")
    assert (tmp_path / "mine").read_text() == "precious"


def test_nothing_but_the_lock_is_left_behind(start_prototype: Callable, tmp_path: Path) -> None:
    running = start_prototype()
    assert read_handshake(str(running.link)) is not None
    assert observer_path(running.link).exists()
    running.kill()
    assert [path.name for path in tmp_path.iterdir()] == ["prototype.lock"]


def test_the_line_is_raw_and_outlives_its_clients(start_prototype: Callable) -> None:
    running = start_prototype()
    for pulse in (1501, 1505, 1517, 1519):  # their low bytes hold a newline's, a return's and flow control's kin
        descriptor = os.open(running.link, os.O_RDWR | os.O_NOCTTY)
        os.write(descriptor, Lsc().encode_move([pulse] * 6, range(1, 7), 0x0D0A // 2))
        os.close(descriptor)
        want = MID_M + (pulse - 1500) * 1e-4
        wait_for(lambda want=want: np.allclose(running.body.lengths_m, want), f"{pulse} us")


def test_observations_come_in_lines_to_several_clients(start_prototype: Callable) -> None:
    running = start_prototype(time_scale=4.0)
    seen: list[list[Observation]] = [[], []]
    clients = [ObserverClient(str(observer_path(running.link)), each.append) for each in seen]
    wait_for(lambda: min(map(len, seen)) >= 20, "twenty observations each")
    for client in clients:
        client.close()
    for each in seen:
        gaps = np.diff([observation.robot_time_ns for observation in each]) / 1e6
        assert np.median(gaps) == pytest.approx(50.0, abs=1.0)
        assert each[0].joints_m.shape == (12, 3)
        assert each[0].face == "TC6"


def test_a_client_that_does_not_read_holds_up_nobody(start_prototype: Callable) -> None:
    running = start_prototype(time_scale=100.0)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as lazy:
        lazy.connect(str(observer_path(running.link)))
        wait_for(lambda: running.body.time_s > 60.0, "a minute of robot time")
        lazy.settimeout(10.0)
        data = b""
        while data.count(b"\n") < 50:
            data += lazy.recv(4096)
        for line in data.split(b"\n")[:-1]:
            decode_observation(line)


def test_an_observers_client_comes_back_with_the_observer(start_prototype: Callable) -> None:
    running = start_prototype()
    connections: list[bool] = []
    client = ObserverClient(str(observer_path(running.link)), lambda observation: None, connections.append)
    with contextlib.closing(client):
        wait_for(lambda: connections == [True], "the observer")
        running.kill()
        wait_for(lambda: connections == [True, False], "its end")
        start_prototype()
        wait_for(lambda: connections == [True, False, True], "the next one")


def test_a_body_that_falls_behind_says_so_once_each_time(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    prototype = VirtualPrototype(tmp_path / "prototype", StillBody(), load_calibration(), emulate("lsc"))
    with contextlib.closing(prototype):
        for lag_s in (0.0, 3.0, 4.0, 1.0, 3.0, 0.0, 2.5):
            prototype._tell_lag(lag_s)
    assert [record.args for record in caplog.records] == [(3.0,), (2.5,)]


def test_observations_tell_how_late_orders_were_taken(tmp_path: Path) -> None:
    prototype = VirtualPrototype(tmp_path / "prototype", StillBody(), load_calibration(), emulate("lsc"), 50.0)
    seen: list[Observation] = []
    with contextlib.closing(prototype):
        client = ObserverClient(str(observer_path(tmp_path / "prototype")), seen.append)
        with contextlib.closing(client):

            def told() -> list[float]:
                prototype.turn()
                return [observation.late_s for observation in seen]

            wait_for(told, "the first observation")
            prototype._served_s -= 7.0  # as if the computer had had no time for it since then
            wait_for(lambda: max(told()) > 7.0, "an observation that tells of it")
            wait_for(lambda: told()[-1] < 7.0, "those after it, which do not")


def test_the_board_tells_the_sagging_supply_and_resets_when_it_breaks_down(
    start_prototype: Callable, make_bridge: Make, caplog: pytest.LogCaptureFixture
) -> None:
    running = start_prototype(time_scale=4.0, board=emulate("ssc32"))
    running.body.supply_v = 6.5
    wait_for(lambda: running.board.battery_mv == 6500, "the voltage")
    bridge = make_bridge(str(running.link), board=parse_board("ssc32"), liveness_period_s=0.05, liveness_limit_s=1.0)
    bridge.open()
    with armed(bridge):
        running.body.brown_out = True
        wait_for(lambda: bridge.snapshot().mode is Mode.FAULT, "the fault")
    assert "reset or brown-out" in bridge.snapshot().reason
    assert "the supply broke down under the motors' load" in caplog.text
