# SPDX-License-Identifier: Apache-2.0
"""Port and pairing: is it there, may it be opened, who holds it, does a board answer."""

import grp
import os
import shutil
import stat
import subprocess
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np

from hardware_bridge.boards.board import Board
from hardware_bridge.errors import BridgeError, PortBusy
from hardware_bridge.imu.sensor_port import SensorPort
from hardware_bridge.link.board_link import first_answer
from hardware_bridge.link.transport import SerialTransport
from sim_core.errors import ParameterError
from tensegrity_lab.commissioning.checks import Finding, Health
from tensegrity_lab.commissioning.imu_mounting import felt_up

ANSWER_LIMIT_S = 1.0
SENSOR_S = 1.0
BRIDGE, DRIVER = "lib/tensegrity_robot/hardware_bridge", "lib/tensegrity_robot/imu_driver"
BLUETOOTHCTL_LIMIT_S = 5.0


def check_port(port: str, baud: int, board: Board) -> Iterator[Finding]:
    """A port by path or URL. The query that is sent moves nothing."""
    if "://" not in port:
        there = _check_there(port)
        yield there
        if there.health is not Health.FINE:
            return
        allowed = _check_allowed(port)
        yield allowed
        if allowed.health is not Health.FINE:
            return
    transport = SerialTransport(port, baud)
    try:
        transport.open()
    except PortBusy as error:
        yield _busy(port, error, BRIDGE)
        return
    except BridgeError as error:
        yield Finding("link", Health.MEND, str(error), "see the remedy in that line")
        return
    try:
        yield _ask(transport, board)
    finally:
        transport.close()


def check_sensor(port: str) -> Iterator[Finding]:
    """An inertial sensor: whether it measures, fast enough, and feels gravity."""
    if "://" not in port:
        there = _check_there(port, "sensor")
        if there.health is Health.FINE:
            there = _check_allowed(port, "sensor")
        if there.health is not Health.FINE:
            yield there
            return
    try:
        with closing(SensorPort(port)) as sensor:
            up = felt_up(sensor, SENSOR_S)
            rate_hz, bad = sensor.measurements / SENSOR_S, sensor.bad_bytes
    except PortBusy as error:
        yield _busy(port, error, DRIVER)
    except BridgeError as error:
        yield Finding("sensor", Health.MEND, str(error), "see the remedy in that line")
    except ParameterError as error:
        yield Finding("sensor", Health.MEND, f"{port}: {error}", "set it up with its maker's program, and let it rest")
    else:
        told = f"{rate_hz:.0f} measurements a second, {np.linalg.norm(up):.2f} m/s^2 at rest, {bad} bad bytes"
        yield Finding("sensor", Health.FINE, told)


def check_bluetooth(port: str, sys: Path = Path("/sys")) -> Iterator[Finding]:
    """Adapter and pairing, for an rfcomm port. `sys`: of the kernel."""
    what = "pairing"
    if not Path(port).name.startswith("rfcomm"):
        yield Finding(what, Health.SKIPPED, "not a Bluetooth port")
        return
    blocked = [row for row in (sys / "class/rfkill").glob("*") if _text(row / "type") == "bluetooth" and _text(row / "soft") == "1"]
    if blocked:
        yield Finding(what, Health.MEND, "Bluetooth is switched off", "run: rfkill unblock bluetooth")
    elif not list((sys / "class/bluetooth").glob("hci*")):
        yield Finding(what, Health.MEND, "there is no Bluetooth adapter", "plug one in, or switch it on in the machine's firmware")
    elif shutil.which("bluetoothctl") is None:
        yield Finding(what, Health.MEND, "bluetoothctl is not installed", "on Debian or Ubuntu: sudo apt install bluez")
    else:
        yield _paired()


def _paired() -> Finding:
    pair = "in bluetoothctl: scan on, pair MAC (HC-05 and HC-06: PIN 1234), trust MAC"
    try:
        words = ["bluetoothctl", "devices", "Paired"]
        answer = subprocess.run(words, capture_output=True, text=True, timeout=BLUETOOTHCTL_LIMIT_S, check=False).stdout
    except (OSError, subprocess.TimeoutExpired):
        return Finding("pairing", Health.MEND, "bluetoothctl does not answer", "run: sudo systemctl start bluetooth")
    devices = [line.removeprefix("Device ") for line in answer.splitlines() if line.startswith("Device ")]
    if not devices:
        return Finding("pairing", Health.MEND, "no device is paired", pair)
    return Finding("pairing", Health.FINE, f"paired: {'; '.join(devices)}")


def _check_there(port: str, what: str = "port") -> Finding:
    if not os.path.exists(port):  # noqa: PTH110 (no error where it may not be looked at)
        name = Path(port).name
        mend = "plug the board in and look at: ls /dev/tty*"
        if name.startswith("rfcomm"):
            mend = f"switch the robot on, then: sudo rfcomm bind {name.removeprefix('rfcomm') or 0} MAC 1"
        return Finding(what, Health.MEND, f"{port} does not exist", mend)
    if not stat.S_ISCHR(Path(port).stat().st_mode):
        return Finding(what, Health.MEND, f"{port} is no serial port", "give a tty, such as /dev/rfcomm0 or /dev/ttyUSB0")
    return Finding(what, Health.FINE, f"{port} exists")


def _check_allowed(port: str, what: str = "permissions") -> Finding:
    if os.access(port, os.R_OK | os.W_OK):
        return Finding(what, Health.FINE, f"{port} may be read and written")
    try:
        group = grp.getgrgid(Path(port).stat().st_gid).gr_name
    except (OSError, KeyError):
        group = "dialout"
    mend = f"run: sudo usermod -aG {group} $USER, then log out and in again"
    return Finding(what, Health.MEND, f"{port} may not be opened by this user", mend)


def _busy(port: str, error: PortBusy, ours: str) -> Finding:
    """A process of ours that holds its own port is as it should be."""
    for pid, name in _holders(port):
        if any(word.endswith(ours) for word in name.split()):
            return Finding("link", Health.FINE, f"{Path(ours).name} has it (process {pid}); its health is on /diagnostics")
        return Finding("link", Health.MEND, f"{port} is held by process {pid}, {name}", f"end that program: kill {pid}")
    return Finding("link", Health.MEND, str(error), f"see who holds it: fuser {port}")


def _holders(port: str) -> Iterator[tuple[int, str]]:
    """Processes that have the port open, as far as this user may see."""
    device = os.path.realpath(port)
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if any(os.path.realpath(link) == device for link in (folder / "fd").iterdir()):
                yield int(folder.name), (folder / "cmdline").read_text().replace("\0", " ").strip()
        except OSError:
            continue


def _ask(transport: SerialTransport, board: Board) -> Finding:
    try:
        answer = first_answer(transport, board, ANSWER_LIMIT_S)
        if answer is not None and answer.errors:
            told = f"the board answers, with errors: {', '.join(answer.errors)}"
            return Finding("link", Health.MEND, told, "check supply and wiring; asking has cleared them on the board")
        if answer is not None:
            supply = "" if answer.battery_mv is None else f": servo supply {answer.battery_mv / 1e3:.2f} V"
            return Finding("link", Health.FINE, f"the board answers{supply}")
    except BridgeError as error:
        return Finding("link", Health.MEND, str(error), "check power and range, then look again")
    told = f"{transport.port} opens, but no board answers within {ANSWER_LIMIT_S:g} s"
    mend = "switch the board's supply on, check its baud rate"
    if not board.quirks.always_answers:
        mend += "; some of its kind never answer: the bridge arms such a one with silent_board:=true"
    return Finding("link", Health.MEND, told, mend)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8").strip()
    except OSError:
        return ""
