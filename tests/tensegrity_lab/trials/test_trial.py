# SPDX-License-Identifier: Apache-2.0
"""Sessions as an experimenter runs them: real processes, real bytes, real bags; killed at any moment and gone on with."""

import csv
import fcntl
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from hardware_bridge.recording.bag_on_disk import bags_in
from tensegrity_lab.session_data.bag_messages import lines_in_bag
from tensegrity_lab.session_data.ledger import LEDGER, Ledger
from tensegrity_lab.session_data.ledger_line import Event, Outcome, text_of
from tests.sixstrut_cli.test_commands import sixstrut
from tests.tensegrity_lab.terminal import CTRL_C, ENTER, Terminal

PLAN = ("--library", "robust", "--primitives", "1,21", "--gaits", "TC6-TO5,TO5-TC6", "--order-seed", "1")
VIRTUAL = ("--virtual", "--time-scale", "4")


def begin(folder: Path, *words: str) -> subprocess.Popen[str]:
    """`sixstrut trial` as a process."""
    command = [sys.executable, "-m", "sixstrut_cli", "trial", str(folder), *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)


def finished(process: subprocess.Popen[str], limit_s: float = 200) -> str:
    try:
        return process.communicate(timeout=limit_s)[0]
    finally:
        kill(process, all_of_it=True)


def kill(process: subprocess.Popen[str], all_of_it: bool) -> None:
    """SIGKILL to the program, or, as when the power fails, to all its processes at once."""
    if process.poll() is not None:
        return
    family = psutil.Process(process.pid).children(recursive=True) if all_of_it else []
    for member in (psutil.Process(process.pid), *family):
        member.kill()
    process.wait()


def begun_and_a_little(process: subprocess.Popen[str], ledger: Path, lines: int, wait_s: float) -> None:
    """Waits until the ledger has grown by so many lines and a moment more, or the program has ended; fails after a limit."""

    def count() -> int:
        return ledger.read_bytes().count(b"\n") if ledger.exists() else 1

    end, wanted = time.monotonic() + 120, count() + lines
    while count() < wanted and process.poll() is None:
        assert time.monotonic() < end, "the ledger does not grow"
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout=0.02)
    with suppress(subprocess.TimeoutExpired):
        process.wait(timeout=wait_s)


def bags_of(folder: Path) -> list[Path]:
    return bags_in(folder / "bags")


@pytest.mark.slow
@pytest.mark.ros
@pytest.mark.timeout(600)
def test_killed_at_random_moments_and_gone_on_with_no_trial_is_lost_or_repeated(tmp_path):
    folder, rng = tmp_path / "session", random.Random(4)
    words = [*PLAN, "--repeats", "2", *VIRTUAL]
    before = b""
    for power_cut in (False, True, False):
        process = begin(folder, *words)
        begun_and_a_little(process, folder / LEDGER, rng.choice((1, 1, 2, 3)), rng.uniform(0.0, 1.5))
        kill(process, power_cut)
        process.communicate()
        now = (folder / LEDGER).read_bytes()
        assert now.startswith(before), "nothing is ever overwritten"
        before, words = now, [*VIRTUAL]
    printed = finished(begin(folder, *words), limit_s=200)
    assert "4 of 4 virtual trials are done" in printed, printed

    ledger = Ledger(folder)
    standing = ledger.standing()
    assert Counter(line.gait for line in standing.valid) == Counter(dict.fromkeys(gaits(), 1))
    assert sorted(standing.trials) == list(range(1, standing.last_number + 1))
    assert standing.open is None
    ended = [line for line in ledger.lines if line.event is Event.TRIAL]
    assert all(line.reason.startswith("the session was killed") for line in ended if line.outcome is Outcome.VOID)
    assert not list((folder / "bags").rglob("*.journal"))
    in_bags = [text_of(line) for bag in bags_of(folder) for line in lines_in_bag(bag)]
    assert Counter(in_bags) == Counter(text_of(line) for line in ended), "one record a trial in the bags, the ledger's own"

    again = sixstrut("trial", str(folder), *VIRTUAL)
    assert again.returncode == 0
    assert "nothing: the session is complete" in again.stdout
    assert len(Ledger(folder).lines) == len(ledger.lines)
    foreign_readers_agree(folder, ended)
    replays_trial_by_trial(folder, ended)


def gaits():
    return [(p, s, t, n) for n in (1, 2) for p, s, t in (("P1", "TC6", "TO5"), ("P21", "TO5", "TC6"))]


def foreign_readers_agree(folder, ended):
    """rosbags knows nothing of us; it reads every record, and each at the place that the record names."""
    numbers = {}
    for bag in bags_of(folder):
        with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            chosen = [c for c in reader.connections if c.topic == "/recorded/bridge/trial"]
            for connection, _, data in reader.messages(chosen):
                record = reader.deserialize(data, connection.msgtype)
                numbers[record.number] = record
            began = reader.start_time
            asked = [c for c in reader.connections if c.topic == "/recorded/bridge/asked"]
            times = [(at - began) * 1e-9 for _, at, _ in reader.messages(asked)]
            for line in ended:
                if line.bag == bag.name and line.outcome is Outcome.SUCCESS:
                    until_s = line.bag_offset_s + line.wall_s
                    assert any(line.bag_offset_s <= at <= until_s for at in times), "the roll is asked for where the record says"
    assert sorted(numbers) == [line.number for line in ended]
    assert all(numbers[line.number].virtual_robot and str(numbers[line.number].outcome) == line.outcome for line in ended)
    with (folder / LEDGER).open(encoding="utf-8", newline="") as file:
        table = [row for row in csv.DictReader(file) if row["event"] == "trial"]
    assert [int(row["number"]) for row in table] == sorted(numbers)


def replays_trial_by_trial(folder, ended):
    """The twin, told no face, from what was sent alone; and what if the floor were ice?"""
    won = next(line for line in reversed(ended) if line.outcome is Outcome.SUCCESS)
    words = ("replay", str(folder / "bags" / won.bag), "--trial", str(won.number), "--json")
    result = sixstrut(*words, "--ensemble", "8")
    (told,) = json.loads(result.stdout)["trials"]
    assert result.returncode == (0 if told["agrees"] else 4)
    assert told["number"] == won.number
    assert told["twin_faces"][0] == won.source
    assert told["agrees"] == (told["twin_actuated"] == told["twin_returned"] == won.target)
    assert told["odds"]["members"] == 8
    assert told["largest_m"] < 0.3, "twin and record are laid over each other"
    ice = sixstrut(*words, "--set", "mu_s=0.02", "--set", "mu_k=0.01")
    (slid,) = json.loads(ice.stdout)["trials"]
    assert slid["largest_m"] != told["largest_m"]
    wrong = sixstrut(*words, "--set", "friction=1")
    assert wrong.returncode == 1
    assert "unknown parameter 'friction'" in wrong.stderr
    missing = sixstrut("replay", str(folder / "bags" / won.bag), "--trial", "99")
    assert "trial 99 is not in this bag: it holds trials" in missing.stderr


@pytest.mark.slow
@pytest.mark.ros
@pytest.mark.timeout(600)
def test_a_person_judges_by_one_key_undoes_leaves_and_comes_back(tmp_path):
    words = ("trial", str(tmp_path / "s"), "--experimenter", "Ada", "--judge", "hand", *PLAN, "--repeats", "2", *VIRTUAL)
    person = Terminal(*words, folder=tmp_path)
    try:
        person.says("Lift the robot, keep hands clear", limit_s=200)
        person.press(ENTER)
        person.says("Does it stand on TC6", limit_s=200)
        person.press("y")
        person.says("Does it stand on TO5")
        person.press("u", "n")
        person.says("Where does it stand now?")
        person.press("2")  # on TO5 after all
        person.says("Does it stand on TC6")
        person.press("v")
        person.says("Why does it not count?")
        person.press("1")
        person.says("Where does it stand now?")
        person.press("3")
        person.says("Does it stand on TO5")
        person.press(CTRL_C)
        assert person.ends() == 130
    finally:
        person.close()
    assert "go on:  ./sixstrut trial s --virtual" in person.text
    assert "trial 1 (P21 TO5→TC6, success) is revoked" in person.text
    standing = Ledger(tmp_path / "s").standing()
    told = [(line.experimenter, line.number, line.outcome, line.reason) for line in standing.trials.values()]
    assert told == [
        ("Ada", 2, "failure", "not on the target after actuation"),
        ("Ada", 3, "void", "touched or misplaced"),
        ("Ada", 4, "void", "the experimenter ended the session in the middle of it"),
    ]
    assert standing.revoked == {1}
    lines = [line for bag in bags_of(tmp_path / "s") for line in lines_in_bag(bag)]
    assert [(line.event, line.number) for line in lines if line.number < 4] == [
        ("trial", 1),
        ("revoke", 1),
        ("trial", 2),
        ("trial", 3),
    ]


@pytest.mark.slow
def test_the_plan_is_shown_first_with_order_duty_and_time(tmp_path):
    words = ("trial", str(tmp_path / "s"), "--primitives", "1-4,21-24", "--order-seed", "9", "--robot", "ours", "--plan")
    result = sixstrut(*words, "--port", "/dev/none")
    assert result.returncode == 0, result.stderr
    assert "192 trials: 192 gaits, 1 of each; order by seed 9" in result.stdout
    assert "struts may run 20 % of the time" in result.stdout
    assert "trials on ours" in result.stdout
    assert "virtual" not in result.stdout
    again = sixstrut("trial", str(tmp_path / "s"), "--plan", "--primitives", "1-5", "--order-seed", "8")
    assert again.returncode == 1
    assert "has primitives '1-4,21-24', not '1-5'; order_seed 9, not 8: leave these options out to go on" in again.stderr


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ((), "is no session yet: to begin one, give --virtual, or --port PORT --calibration FILE"),
        (("--virtual", "--primitives", "77"), "valid are numbers 1 to 40"),
        (("--virtual", "--gaits", "some"), "valid are all, proper, improper, reference, or pairs"),
        (("--virtual", "--library", "none"), "shipped are: continuous, improved"),
        (("--virtual", "--board", "arduino"), "lsc, ssc32, or maestro"),
        (("--port", "/dev/none", "--perturbation", "0.1"), "--perturbation is of a virtual prototype"),
        (("--port", "/dev/none", "--calibration", "/dev/none.yaml"), "/dev/none.yaml"),
        (("--port", "/dev/none"), "standard input is no terminal"),
    ],
)
def test_bad_input_gets_one_line_that_says_what_is_valid(words, complaint, tmp_path):
    result = sixstrut("trial", str(tmp_path / "s"), *words)
    assert result.returncode == 1
    assert complaint in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "s").exists(), "nothing is made before the plan is valid"


@pytest.mark.parametrize("words", [("--port", "/dev/none"), ("--virtual", "--judge", "hand"), ("--port", "/dev/none", "--plan")])
def test_chains_that_nobody_observes_are_refused_before_anything_starts(words, tmp_path):
    cycles = ("--library", "continuous", "--primitives", "C1", "--gaits", "TC6-TO5-TC3")
    result = sixstrut("trial", str(tmp_path / "s"), *cycles, *words)
    assert result.returncode == 1
    assert "here a person judges: choose primitives" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "s").exists()


def test_a_folder_of_something_else_is_left_as_it_is(tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    assert "holds letter.txt and no session" in sixstrut("trial", str(tmp_path), "--virtual").stderr
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


@pytest.mark.slow
def test_a_session_that_runs_is_not_run_twice(tmp_path):
    (tmp_path / "s").mkdir()
    with (tmp_path / "s" / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        lock.write(f"{os.getpid()}\n")
        lock.flush()
        result = sixstrut("trial", str(tmp_path / "s"), "--virtual")
    assert result.returncode == 1
    assert f"is being run by process {os.getpid()}" in result.stderr


@pytest.mark.slow
@pytest.mark.ros
@pytest.mark.timeout(600)
def test_a_virtual_session_counts_chains_as_trials_with_the_rolls_they_made(tmp_path):
    folder = tmp_path / "s"
    chains = ["TC6-TO5-TC3-TO4-TC4", "TC6-TO5-TC3-TO10-TC1"]
    words = ("--library", "continuous", "--primitives", "C1", "--gaits", ",".join(chains), "--order-seed", "1")
    printed = finished(
        begin(folder, *words, "--virtual", "--perturbation", "0.02", "--actuators", "ideal", "--time-scale", "8"), 400
    )
    assert "2 of 2 virtual trials are done" in printed, printed
    assert "2 chains, 1 of each" in printed
    assert "at 2 times real time" in printed, "an observer's word is late, faster than that"
    valid = Ledger(folder).standing().valid
    assert sorted(line.chain for line in valid) == sorted(chains)
    for line in valid:  # whether a chain is made is the cycle's matter, not this test's
        whole = line.outcome is Outcome.SUCCESS
        assert (line.rolls == 4 and line.observed_face == line.target) if whole else (line.rolls <= 4 and line.reason), printed
        assert line.chain.startswith("-".join(line.faces[: line.rolls + 1])), printed
    in_bags = [(line.chain, line.rolls) for bag in bags_of(folder) for line in lines_in_bag(bag)]
    assert sorted(in_bags) == sorted((line.chain, line.rolls) for line in valid)
    replayed = sixstrut("replay", str(folder / "bags" / valid[0].bag), "--trial", str(valid[0].number), "--json")
    (told,) = json.loads(replayed.stdout)["trials"]
    assert (told["chain"], told["twin_faces"][0]) == (valid[0].chain, "TC6")
    odds = sixstrut("odds", str(folder))
    assert "left out: 2 chain(s)" in odds.stderr


@pytest.mark.slow
@pytest.mark.ros
@pytest.mark.timeout(600)
def test_interrupted_in_mid_roll_the_trial_is_void_and_the_bag_closed(tmp_path):
    process = begin(tmp_path / "s", *PLAN, *VIRTUAL)
    path = tmp_path / "s" / LEDGER
    try:
        while not (path.exists() and "\nbegin,1," in path.read_text(encoding="utf-8")):
            assert process.poll() is None, process.communicate()[0]
    finally:
        os.killpg(process.pid, signal.SIGINT)
    printed = finished(process)
    assert process.returncode == 130, printed
    assert "trial 1: P21 TO5→TC6 void: the experimenter ended the session" in printed, printed
    assert "go on:" in printed
    (bag,) = bags_of(tmp_path / "s")
    (line,) = lines_in_bag(bag)
    assert line.outcome is Outcome.VOID


@pytest.mark.slow
@pytest.mark.ros
@pytest.mark.timeout(300)
def test_a_dumb_latin_1_terminal_is_asked_in_lines(tmp_path):
    words = ("trial", str(tmp_path / "s"), "--judge", "hand", *PLAN, *VIRTUAL)
    person = Terminal(*words, folder=tmp_path, environ={"TERM": "dumb", "PYTHONIOENCODING": "latin-1"})
    try:
        person.says("[Enter arm", limit_s=200)
        assert "\x1b" not in person.text
        person.press("q")
        assert person.ends() == 130
    finally:
        person.close()
