# SPDX-License-Identifier: Apache-2.0
"""What somebody at a terminal is told of long work: how long it takes, and what Ctrl-C keeps."""

import os
import signal
import subprocess
import sys
import time

import pytest

from sim_core import build_model, load_prototype
from tensegrity_lab.terminal.forecast import say_forecast
from tensegrity_lab.terminal.leaving import leaves_at_once, uninterrupted
from tensegrity_lab.terminal.progress import duration_text

COMPUTES = """
import sys
from tensegrity_lab.terminal.progress import bars
with bars("rolls", "everything that was written"):
    print("begun", flush=True)
    while True:
        try:
            sum(range(1_000_000))
        except KeyboardInterrupt:
            print("an exception can be lost", flush=True)
"""


def test_ctrl_c_always_leaves_and_says_what_is_kept():
    process = subprocess.Popen([sys.executable, "-c", COMPUTES], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n"
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "interrupted: everything that was written" in err
    assert out == ""
    assert time.monotonic() - began < 5.0


def test_outside_of_long_work_ctrl_c_is_what_it_was():
    before = signal.getsignal(signal.SIGINT)
    with leaves_at_once("nothing"):
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize(
    ("seconds", "text"), [(5, "5 s"), (89, "89 s"), (95, "2 min"), (3600, "1 h 00 min"), (20061, "5 h 34 min")]
)
def test_durations_are_for_people(seconds, text):
    assert duration_text(seconds) == text


def test_the_forecast_is_measured_here(capsys):
    say_forecast("a study", 1000, build_model(load_prototype()))
    said = capsys.readouterr().err
    assert said.startswith("a study: 1000 rolls, about ")
    assert "rolls/s here; Ctrl-C leaves at any time" in said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_while_things_are_put_away_is_remembered(number):
    with uninterrupted() as came:
        assert not came
        os.kill(os.getpid(), number)
        assert came == [number]


def test_afterwards_ctrl_c_interrupts_again():
    with uninterrupted():
        pass
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
