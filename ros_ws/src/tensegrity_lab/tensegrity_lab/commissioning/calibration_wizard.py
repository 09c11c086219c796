# SPDX-License-Identifier: Apache-2.0
"""The walk through six struts: what is asked, shown and done, key by key."""

from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hardware_bridge.calibration.calibration_file import LONGEST_NAME, Unfinished, load_calibration, robot_name, write_calibration
from hardware_bridge.calibration.pulse_map import Calibration, StrutCalibration
from hardware_bridge.calibration.two_point_fit import NOMINAL_PULSE_US, Measured, check_straight, fit, pulse_at_mm
from hardware_bridge.driver.jogger import Jogger
from hardware_bridge.errors import CalibrationError, DutyError
from sim_core.names import STRUT_NAMES
from tensegrity_lab.terminal.keys import DOWN, ENTER, LEFT, PAGE_DOWN, PAGE_UP, RIGHT, UP, pressed

Seen = Callable[[str], float | None]
"""Length of a strut in mm as somebody else sees it now (the virtual prototype's observer), to be offered; None: nobody does."""

TEST_STEP_US = 50
_STEPS_US = {UP: 10, DOWN: -10, PAGE_UP: 50, PAGE_DOWN: -50, RIGHT: 1, LEFT: -1}
_JOG = "Up/Down 10 us, PgUp/PgDn 50 us, Right/Left 1 us; Enter when there"


def ask_robot(file: Path, given: str, console: Console) -> str:
    """The robot's name: the given one, the unfinished calibration's, or as a person types it; a finished one's is offered.

    Raises:
        CalibrationError: it is no name, or the unfinished calibration is another robot's.
    """
    unfinished = Unfinished(file)
    if given:
        name = robot_name(given, "--robot")
        if unfinished.robot not in (None, name):
            problem = f"is of robot {unfinished.robot!r}: go on with --robot {unfinished.robot!r}, or remove it to begin anew"
            raise CalibrationError(str(unfinished.path), problem)
        return name
    if unfinished.robot is not None:
        return unfinished.robot
    finished = measured_before(file)
    offered = None if finished is None else finished.robot
    shown = "" if offered is None else f" {escape(f'[{offered}]')}"
    while True:
        text = console.input(f"Name of this robot, as it shall be known and had best be written on it{shown}: ").strip()
        try:
            return robot_name(text or offered, "")
        except CalibrationError:
            console.print(f"[red]{escape(repr(text))} is no name; type 1 to {LONGEST_NAME} characters.[/]", highlight=False)


def measured_before(file: Path) -> Calibration | None:
    """The finished calibration in a file; None: there is none that can be used."""
    try:
        return load_calibration(file)
    except CalibrationError:
        return None


class Walk:
    """One calibration from its first question to its file. What is done is kept after every strut."""

    def __init__(self, file: Path, robot: str, jogger: Jogger, seen: Seen, console: Console):
        """Raises CalibrationError: there is an unfinished calibration that cannot be understood."""
        self._file = file
        self._robot = robot
        self._jogger = jogger
        self._seen = seen
        self._console = console
        self._unfinished = Unfinished(file)

    def run(self) -> Calibration:
        """All struts that are not done yet, then the file.

        Raises:
            CalibrationError, TransportError, LinkLost, StateFileError, DutyError.
            KeyboardInterrupt, EOFError: interrupted; what is done is kept.
        """
        self._say(
            "[bold]Lift the robot, hang no load on the strut that is measured, keep hands clear of the others, and have the "
            "switch of the servo supply within reach.[/] Ctrl-C leaves at any moment; the same command goes on from there."
        )
        self._ask_rest()
        done = self._unfinished
        done.robot = self._robot
        if done.mid_stroke_length_m is None:
            done.mid_stroke_length_m = self._number("Length of a strut at mid stroke, node to node, in mm", 234.0) * 1e-3
            done.save()
        elif done.struts:
            self._say(f"Done already: {', '.join(done.struts)}; going on from {done.path}.")
        for name in STRUT_NAMES:
            while name not in done.struts:
                try:
                    done.struts[name] = self._strut(name, 1e3 * done.mid_stroke_length_m)
                except CalibrationError as error:
                    self._say(f"[red]{error}[/]\nOnce more, {name} from the start.")
            done.save()
        calibration = write_calibration(self._file, done.mid_stroke_length_m, done.struts, self._robot)
        self._jogger.becomes(calibration.hash)
        done.remove()
        self._show(calibration, done.struts)
        return calibration

    def _ask_rest(self) -> None:
        """Raises DutyError: the actuators may have run until lately; they must rest first."""
        if not self._jogger.history_is_known:
            self._say(f"Nobody knows how long the actuators of robot {escape(repr(self._robot))} have run lately.")
            self._jogger.rested(self._number("For how many seconds have they rested, for certain", None, 1e7))
            self._jogger.require_rest(0)

    def _go(self, name: str, channel: int, pulse_us: int) -> int:
        return self._jogger.go(STRUT_NAMES.index(name), channel, pulse_us)

    def _strut(self, name: str, mid_mm: float) -> StrutCalibration:
        self._say(f"\n[bold]{name}[/], strut {STRUT_NAMES.index(name) + 1} of {len(STRUT_NAMES)}")
        channel = self._channel(name)
        known = self._jogger.pulse_us(channel)
        pulse = NOMINAL_PULSE_US if known is None else known
        where = "at full speed, from wherever it is" if known is None else "where it was last sent"
        self._say(f"It now goes to {pulse} us, {where}: a board ignores the time of a first move. Enter when all is clear.")
        self._keys(ENTER)
        self._go(name, channel, pulse)
        longer = self._direction(name, channel, pulse)
        self._say(f"Make it [bold]shorter[/] with Down, to 2 mm before its stop. {_JOG}.")
        short = self._end(name, channel, longer)
        self._say(f"Make it [bold]longer[/] with Up, to 2 mm before its stop. {_JOG}.")
        long = self._end(name, channel, longer)
        self._go(name, channel, pulse_at_mm(name, short, long, mid_mm))
        middle = self._measured(name, channel, "It is back near mid stroke.")
        check_straight(name, short, long, middle)
        self._say(f"Trim: bring it to exactly {mid_mm:g} mm. {_JOG}.")
        zero_us = self._jog(name, channel, longer)
        return fit(name, channel, short, long, zero_us)

    def _channel(self, name: str) -> int:
        taken = {strut.channel: other for other, strut in self._unfinished.struts.items()}
        while True:
            channel = round(self._number(f"Channel of {name} on the board", STRUT_NAMES.index(name) + 1))
            if channel not in taken:
                return channel
            self._say(f"[red]Channel {channel} is {taken[channel]}'s; give each strut its own.[/]")

    def _direction(self, name: str, channel: int, pulse_us: int) -> int:
        """+1 if a longer pulse lengthens the strut, as a person sees it."""
        while True:
            self._go(name, channel, pulse_us + TEST_STEP_US)
            self._say(f"It went {TEST_STEP_US} us up. Press [bold]l[/] if it got longer, [bold]s[/] if shorter, r to see it again.")
            key = self._keys("l", "s", "r")
            if key != "r":
                return 1 if key == "l" else -1
            self._go(name, channel, pulse_us)

    def _end(self, name: str, channel: int, longer: int) -> Measured:
        self._jog(name, channel, longer)
        return self._measured(name, channel, "End point.")

    def _jog(self, name: str, channel: int, longer: int) -> int:
        with pressed() as keys:
            while (key := keys.next()) != ENTER:
                present = self._jogger.pulse_us(channel)
                if key in _STEPS_US and present is not None:
                    try:
                        now = self._go(name, channel, present + longer * _STEPS_US[key])
                        self._console.print(f"  {name}: {now} us", highlight=False)
                    except DutyError as error:
                        self._say(f"[red]{error}[/]")
        pulse = self._jogger.pulse_us(channel)
        assert pulse is not None
        return pulse

    def _measured(self, name: str, channel: int, what: str) -> Measured:
        pulse = self._jogger.pulse_us(channel)
        assert pulse is not None
        return Measured(pulse, self._number(f"{what} Length of {name} now, node to node, in mm", self._seen(name)))

    def _number(self, question: str, default: float | None, largest: float = 1000.0) -> float:
        offered = "" if default is None else f" \\[{default:g}]"
        while True:
            text = self._console.input(f"{question}{offered}: ").strip()
            if not text and default is not None:
                return float(f"{default:g}")
            try:
                value = float(text.replace(",", "."))
            except ValueError:
                value = float("nan")
            if 0.0 <= value <= largest:
                return value
            self._say(f"[red]{escape(repr(text))} is no number from 0 to {largest:.0f}; type one, such as 233.5.[/]")

    def _keys(self, *valid: str) -> str:
        with pressed() as keys:
            while (key := keys.next()) not in valid:
                continue
        return key

    def _say(self, text: str) -> None:
        self._console.print(text, highlight=False)

    def _show(self, calibration: Calibration, struts: dict[str, StrutCalibration]) -> None:
        title = escape(f"robot {calibration.robot!r}, calibration {calibration.hash[:12]}")
        table = Table("strut", "channel", "mid stroke [us]", "slope [us/mm]", "longer pulse", "stroke [mm]", title=title)
        for name, strut in struts.items():
            low_mm, high_mm = strut.stroke_mm
            middle_us = strut.pulse_at_zero_us + strut.trim_us
            way = "lengthens" if strut.direction > 0 else "shortens"
            table.add_row(name, str(strut.channel), str(middle_us), f"{strut.us_per_mm:.2f}", way, f"{low_mm:g} to {high_mm:g}")
        self._console.print(table)
