# SPDX-License-Identifier: Apache-2.0
"""The doctor finds what is not well and says how to mend it."""

import io
import json
import os
import subprocess
import sys
import tty

import pytest

from hardware_bridge.boards.lsc import Lsc
from hardware_bridge.boards.registry import parse_board
from hardware_bridge.calibration.calibration_file import Unfinished, load_calibration, write_calibration
from hardware_bridge.virtual_prototype.boards.registry import emulate
from sim_core.names import STRUT_NAMES
from tensegrity_lab.commissioning.checks import Health, check_calibration, check_computer, check_folder, check_home, check_network
from tensegrity_lab.commissioning.port_checks import check_bluetooth, check_port
from tests.hardware_bridge.conftest import Running
from tests.hardware_bridge.helpers import Wire


def doctor(tmp_path, *words):
    environ = {**os.environ, "SIXSTRUT_STATE_DIR": str(tmp_path / "state"), "SIXSTRUT_BAGS": str(tmp_path / "bags")}
    words = [sys.executable, "-m", "sixstrut_cli", "doctor", *words]
    return subprocess.run(words, capture_output=True, text=True, timeout=60, check=False, env=environ)


@pytest.fixture
def wire():
    wire = Wire()
    yield wire
    wire.cut()


def test_a_machine_without_a_robot_is_fine(tmp_path):
    result = doctor(tmp_path, "--json")
    assert result.returncode == 0, result.stdout
    health = {finding["what"]: finding["health"] for finding in json.loads(result.stdout)}
    assert {"python", "packages", "workspace", "bags", "state", "network"} <= {
        what for what, how in health.items() if how == "fine"
    }
    assert health["port"] == health["calibration"] == health["pairing"] == "skipped"


def test_a_real_port_without_a_board_or_a_calibration_is_to_be_mended(tmp_path, wire):
    result = doctor(tmp_path, "--port", wire.port)
    assert result.returncode == 4
    lines = result.stdout.splitlines()
    assert any(line.startswith("MEND  link") and "no board answers" in line for line in lines)
    assert any(line.startswith("MEND  calibration") for line in lines)
    assert sum(line.strip().startswith("→") for line in lines) >= 2, "each with its remedy"
    assert not wire.moves()


def test_a_board_that_answers_is_fine(monkeypatch):
    wire = Wire(answers=True)
    monkeypatch.setattr("hardware_bridge.link.board_link.time.sleep", lambda seconds: wire.listen())
    *_, link = check_port(wire.port, 9600, Lsc())
    wire.cut()
    assert (link.health, link.told) == (Health.FINE, "the board answers: servo supply 7.40 V")


@pytest.mark.parametrize("spec", ["lsc", "ssc32", "maestro", "maestro:device=12:crc"])
def test_every_emulated_board_answers_the_doctor_and_another_one_does_not(tmp_path, spec):
    running = Running(tmp_path / "prototype", 1.0, emulate(spec))
    try:
        board = parse_board(spec)
        *_, link = check_port(str(running.link), board.quirks.usual_baud, board)
        assert link.health is Health.FINE, link
        assert link.told.startswith("the board answers")
        other = parse_board("ssc32" if spec == "lsc" else "lsc")
        *_, link = check_port(str(running.link), other.quirks.usual_baud, other)
        assert link.health is Health.MEND, link
    finally:
        running.kill()


@pytest.mark.parametrize(
    ("port", "told", "mend"),
    [
        ("/dev/rfcomm7", "/dev/rfcomm7 does not exist", "sudo rfcomm bind 7 MAC 1"),
        ("/dev/ttyUSB99", "/dev/ttyUSB99 does not exist", "plug the board in"),
        ("/", "/ is no serial port", "give a tty"),
    ],
)
def test_a_port_that_is_none_says_what_to_do(port, told, mend):
    (finding,) = check_port(port, 9600, Lsc())
    assert (finding.health, finding.told) == (Health.MEND, told)
    assert mend in finding.mend


def test_a_port_that_may_not_be_opened_names_the_group(wire, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    _, permissions = check_port(wire.port, 9600, Lsc())
    assert permissions.health is Health.MEND
    assert permissions.mend.startswith("run: sudo usermod -aG ")


def test_a_port_that_another_program_holds_names_the_program(wire):
    import serial

    with serial.Serial(wire.port, exclusive=True):
        *_, link = check_port(wire.port, 9600, Lsc())
    assert link.health is Health.MEND
    assert "is held by process" in link.told
    assert "kill" in link.mend


@pytest.mark.parametrize(
    ("files", "told"),
    [
        ({}, "there is no Bluetooth adapter"),
        ({"class/rfkill/rfkill0/type": "bluetooth\n", "class/rfkill/rfkill0/soft": "1\n"}, "Bluetooth is switched off"),
    ],
)
def test_bluetooth_that_cannot_work_is_to_be_mended(tmp_path, files, told):
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    (finding,) = check_bluetooth("/dev/rfcomm0", tmp_path)
    assert (finding.health, finding.told) == (Health.MEND, told)


@pytest.mark.parametrize(
    ("answer", "health", "told"),
    [
        ("", Health.MEND, "no device is paired"),
        ("Device 00:11:22:33:44:55 HC-05\n", Health.FINE, "paired: 00:11:22:33:44:55 HC-05"),
    ],
)
def test_pairing_is_what_bluetoothctl_says(tmp_path, monkeypatch, answer, health, told):
    (tmp_path / "class/bluetooth/hci0").mkdir(parents=True)
    program = tmp_path / "bin" / "bluetoothctl"
    program.parent.mkdir()
    program.write_text(f"#!/bin/sh\nprintf '{answer}'\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=os.pathsep)
    (finding,) = check_bluetooth("/dev/rfcomm0", tmp_path)
    assert (finding.health, finding.told) == (health, told)


def test_calibrations_good_broken_and_unfinished(tmp_path):
    file = tmp_path / "mine.yaml"
    assert check_calibration(None, real=True).health is Health.MEND
    assert check_calibration(None, real=False).health is Health.SKIPPED
    assert "cannot be read" in check_calibration(file, real=True).told
    default = load_calibration()
    struts = dict(zip(STRUT_NAMES, default.struts, strict=True))
    write_calibration(file, 0.234, struts)
    assert "names no robot" in check_calibration(file, real=False).told
    nameless = check_calibration(file, real=True)
    assert nameless.health is Health.MEND
    assert f'add a line such as robot: "blue one" to {file}' in nameless.mend
    write_calibration(file, 0.234, struts, "blue one")
    named = check_calibration(file, real=True)
    assert named.health is Health.FINE
    assert named.told.startswith("robot 'blue one', ")
    part = Unfinished(file)
    part.mid_stroke_length_m = 0.234
    part.save()
    finding = check_calibration(file, real=True)
    assert finding.health is Health.MEND
    assert f"./sixstrut calibrate {file}" in finding.mend


def test_a_full_disk_and_a_folder_that_is_none(tmp_path):
    assert check_folder("bags", tmp_path / "bags" / "deep", 1, "X").health is Health.FINE
    full = check_folder("bags", tmp_path, 10**18, "X")
    assert full.health is Health.MEND
    assert "make room" in full.mend
    (tmp_path / "file").write_text("")
    assert check_folder("bags", tmp_path / "file" / "bags", 1, "X").health is Health.MEND


def test_a_wider_network_is_told(monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    assert check_network().told == "this machine only, on loopback"
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    assert "other machines may find and command the robot" in check_network().told


def test_the_ports_far_end_gone_is_no_traceback(tmp_path):
    near, far = os.openpty()
    tty.setraw(far)
    name = os.ttyname(far)
    os.close(far)
    os.close(near)
    result = doctor(tmp_path, "--port", name)
    assert result.returncode == 4
    assert "Traceback" not in result.stderr


def test_a_network_that_cannot_work_and_a_home_that_is_none_are_to_be_mended(monkeypatch, tmp_path):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    finding = check_network()
    assert (finding.health, finding.told) == (Health.MEND, "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF: no node finds another")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert check_home().health is Health.FINE
    (tmp_path / ".ros").touch()  # as a folder that another user made there
    assert check_home().health is Health.MEND
    monkeypatch.setenv("HOME", "nowhere")
    assert check_home().told == "HOME is 'nowhere': a temporary folder is used"


def test_a_busy_computer_and_a_terminal_without_arrows_are_told_and_are_no_fault(monkeypatch):
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0})
    monkeypatch.setattr("os.getloadavg", lambda: (9.0, 0.0, 0.0))
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(io.BytesIO(), encoding="latin-1"))
    finding = check_computer()
    assert finding.health is Health.FINE
    assert finding.told.startswith("1 processor; the terminal's encoding is latin-1: letters that it lacks become others, or ?")
    assert finding.told.endswith("this computer is busy (load 9.0 on 1 processors)")
    assert "--real-time" in finding.mend


def test_a_discovery_server_is_named(monkeypatch):
    monkeypatch.setenv("ROS_DISCOVERY_SERVER", "192.0.2.7:11811")
    assert check_network().told == "ROS_DISCOVERY_SERVER=192.0.2.7:11811: no node finds another unless that server runs"
