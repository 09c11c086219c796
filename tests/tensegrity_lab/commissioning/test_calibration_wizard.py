# SPDX-License-Identifier: Apache-2.0
"""Calibrating as a person does it: at a real terminal, with the virtual prototype's struts to look at."""

import subprocess
import sys

import pytest

from hardware_bridge.calibration.calibration_file import Unfinished, load_calibration
from hardware_bridge.safety.limits import Limits
from hardware_bridge.saved_state.duty_record import DutyRecord
from hardware_bridge.saved_state.last_pulses import LastPulses
from hardware_bridge.saved_state.robot_identity import Identity
from tests.hardware_bridge.helpers import Wire, attended
from tests.tensegrity_lab.terminal import DOWN, ENTER, LEFT, PAGE_DOWN, PAGE_UP, RIGHT, UP, Terminal

NAMED = ("--robot", "blue one")
WORDS = ("--virtual", "--time-scale", "6", *NAMED)


@pytest.fixture
def wire():
    """A board that only listens."""
    wire = Wire()
    yield wire
    wire.cut()


@pytest.fixture
def answering():
    """A board that answers, as long as the test lasts."""
    with attended(answers=True) as wire:
        yield wire


@pytest.fixture
def sit_down(tmp_path):
    """Starts `calibrate` at a terminal, as often as wanted."""
    terminals = []

    def start(*words):
        environ = {"SIXSTRUT_STATE_DIR": str(tmp_path / "state")}
        terminals.append(Terminal("calibrate", str(tmp_path / "mine.yaml"), *words, environ=environ, folder=tmp_path))
        return terminals[-1]

    yield start
    for terminal in terminals:
        terminal.close()


def strut(person, name):
    """One strut, the offered lengths taken; up to its last Enter."""
    number = int(name[1])
    person.says(f"{name}, strut {number} of 6")
    person.says(f"Channel of {name} on the board [{number}]:")
    person.press(ENTER)
    person.says("Enter when all is clear")
    person.press(ENTER)
    person.says("Press l if it got longer")
    person.press("l")
    person.says("Make it shorter")
    person.press(*[PAGE_DOWN] * 8, UP, DOWN)
    person.says(f"{name}: 1150 us\n  {name}: 1160 us\n  {name}: 1150 us")
    person.press(ENTER)
    person.says("End point.")
    person.says("]:")
    person.press(ENTER)
    person.says("Make it longer")
    person.press(*[PAGE_UP] * 15)
    person.says(f"{name}: 1900 us")
    person.press(ENTER)
    person.says("End point.")
    person.says("]:")
    person.press(ENTER)
    person.says("It is back near mid stroke.")
    person.says("]:")
    person.press(ENTER)
    person.says("Trim: bring it to exactly 234 mm")
    person.press(RIGHT, LEFT, ENTER)


@pytest.mark.slow
def test_a_person_walks_through_six_struts_leaves_and_comes_back(sit_down, tmp_path):
    person = sit_down(*WORDS[:-2])
    person.says("Name of this robot, as it shall be known and had best be written on it:")
    person.press("x" * 41, ENTER)
    person.says("is no name; type 1 to 40 characters")
    person.press("blue one", ENTER)
    person.says("Length of a strut at mid stroke, node to node, in mm [234]:")
    person.press(ENTER)
    strut(person, "S1")
    person.says("S2, strut 2 of 6")
    assert person.leaves() == 130
    person.says("Left. What is done is kept; go on with the same command")
    assert not (tmp_path / "mine.yaml").exists()
    assert list(Unfinished(tmp_path / "mine.yaml").struts) == ["S1"]

    person = sit_down(*WORDS[:-1], "red one")
    person.says("is of robot 'blue one': go on with --robot 'blue one', or remove it to begin anew")
    assert person.ends() == 1
    person = sit_down(*WORDS[:-2])
    person.says("Done already: S1; going on from")
    for name in ("S2", "S3", "S4", "S5", "S6"):
        strut(person, name)
    person.says("robot 'blue one', calibration")
    person.says("Written:")
    assert person.ends() == 0
    calibration = load_calibration(tmp_path / "mine.yaml")
    assert calibration.robot == "blue one"
    for each in calibration.struts:
        assert each.direction == 1
        assert each.us_per_mm == pytest.approx(10.0, rel=0.06), "the prototype's own, perturbed and pressed"
        assert each.pulse_at_zero_us + each.trim_us == pytest.approx(1500, abs=15)
        assert each.pulse_us == (1150, 1900)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.yaml"], "practice leaves nothing of robots behind"


@pytest.mark.parametrize("board", ["ssc32", pytest.param("maestro:crc", marks=pytest.mark.slow)])
def test_the_other_boards_are_walked_the_same_way(sit_down, tmp_path, board):
    person = sit_down(*WORDS, "--board", board)
    person.says("[234]:")
    person.press(ENTER)
    strut(person, "S1")
    person.says("S2, strut 2 of 6")
    assert person.leaves() == 130
    (measured,) = Unfinished(tmp_path / "mine.yaml").struts.values()
    assert measured.us_per_mm == pytest.approx(10.0, rel=0.06)
    assert measured.pulse_us == (1150, 1900)


def test_readings_that_make_no_sense_begin_the_strut_again(sit_down):
    person = sit_down(*WORDS)
    person.says("[234]:")
    person.press("a lot", ENTER)
    person.says("'a lot' is no number from 0 to 1000")
    person.says("[234]:")
    person.press("234,0", ENTER)
    person.says("Channel of S1")
    person.press(ENTER)
    person.says("all is clear")
    person.press(ENTER)
    person.says("r to see it again")
    person.press("?", "r")
    person.says("r to see it again")
    person.press("s")  # the wrong way round
    person.says("Make it shorter")
    person.press(*[DOWN] * 2, ENTER)
    person.says("End point.")
    person.says("]:")
    person.press(ENTER)
    person.says("Make it longer")
    person.press(*[UP] * 4, ENTER)
    person.says("End point.")
    person.says("]:")
    person.press(ENTER)
    person.says("the ends must be 10 mm or more apart; measure again")
    person.says("Once more, S1 from the start.")
    person.says("Channel of S1")
    assert person.leaves() == 130


def test_without_a_terminal_it_says_so():
    words = [sys.executable, "-m", "sixstrut_cli", "calibrate", "--virtual"]
    result = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 1
    assert result.stderr == "error: standard input is no terminal: run this command in one, it asks for keys\n"


def test_a_missing_port_is_one_line(sit_down):
    person = sit_down("--port", "/dev/does_not_exist", *NAMED)
    person.says("error: port /dev/does_not_exist: does not exist; start the virtual prototype, or power the robot")
    assert person.ends() == 1


def test_a_real_board_that_nobody_knows_is_asked_about_and_its_robot_is_known_afterwards(sit_down, tmp_path, answering):
    """On a pty of ours, so to the command a real port: rest is the operator's word, and what is moved is remembered."""
    person = sit_down("--port", answering.port, *NAMED)
    person.says("Nobody knows how long the actuators of robot 'blue one' have run lately.")
    person.says("For how many seconds have they rested, for certain:")
    person.press("60", ENTER)
    person.says("count as spent for another")
    assert person.ends() == 1
    assert answering.moves() == []

    person = sit_down("--port", answering.port, *NAMED)
    person.says("for certain:")
    person.press("900", ENTER)
    person.says("[234]:")
    person.press(ENTER)
    person.says("Channel of S1")
    person.press(ENTER)
    person.says("all is clear")
    person.press(ENTER)
    person.says("r to see it again")
    assert person.leaves() == 130
    blue = Identity("blue one", "", "lsc")
    assert LastPulses(tmp_path / "state", blue).load([1]) == (1550,)
    used_s = DutyRecord(tmp_path / "state", blue, Limits()).load(0.0, 1.0).used_s(0.0, Limits().duty_window_s)
    assert used_s[0] > 5.0
    assert not used_s[1:].any()

    person = sit_down("--port", answering.port, *NAMED)
    person.says("Channel of S1")
    person.press(ENTER)
    person.says("It now goes to 1550 us, where it was last sent")
    assert person.leaves() == 130


@pytest.mark.slow
def test_a_silent_board_is_not_moved_without_the_word(sit_down, wire):
    person = sit_down("--port", wire.port, *NAMED)
    person.says("the board (lsc) has never answered on")
    person.says("if it cannot answer, give --silent-board")
    assert person.ends() == 1
    person = sit_down("--port", wire.port, *NAMED, "--silent-board")
    person.says("For how many seconds have they rested, for certain:")
    person.press("0", ENTER)
    person.says("count as spent for another 600 s")
    assert person.ends() == 1
    assert wire.moves() == []
