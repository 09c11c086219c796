# SPDX-License-Identifier: Apache-2.0
"""The report: every number in its page and tables follows from the ledgers, and from nothing else."""

import base64
import csv
import re
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.writer import Writer
from rclpy.serialization import serialize_message
from scipy import stats

from hardware_bridge.recording.message_definitions import ShareSchemas
from sim_core.files.yaml_reader import yaml_text
from sim_core.studies.binomial_intervals import rate_of
from tensegrity_lab.errors import SessionError
from tensegrity_lab.reports.robustness_report import spread
from tensegrity_lab.reports.trial_analysis import Group
from tensegrity_lab.reports.trial_report import TrialReport, summary_of
from tensegrity_lab.session_data.bag_messages import lines_in_bag, message_of
from tensegrity_lab.session_data.ledger import LEDGER, Ledger, read_lines
from tensegrity_lab.session_data.ledger_line import Event, Outcome
from tests.sixstrut_cli.test_commands import sixstrut
from tests.tensegrity_lab.trials.sessions import add, begun, cyclic, planned, try_all, with_chains

PLAN = planned("1-3,21-22")
EXAMPLE = Path(__file__).parents[3] / "bags" / "example"


def rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """Every seventh trial fails."""
    folder = begun(tmp_path_factory.mktemp("s") / "good", PLAN)
    try_all(folder, {index: Outcome.FAILURE if index % 7 == 3 else Outcome.SUCCESS for index in range(len(PLAN))})
    return folder


@pytest.fixture(scope="module")
def bad(tmp_path_factory):
    """Mirrored gaits fail, some trials are void, one is revoked, half is not done yet."""
    folder = begun(tmp_path_factory.mktemp("s") / "bad", PLAN, robot="virtual two")
    ledger = Ledger(folder.path)
    for index, slot in enumerate(PLAN[: len(PLAN) // 2]):
        if index % 10 == 0:
            add(ledger, slot, Outcome.VOID, "virtual two")
        last = add(ledger, slot, Outcome.SUCCESS if slot.proper or index % 4 == 0 else Outcome.FAILURE, "virtual two")
    ledger.append(replace(last, event=Event.REVOKE))
    return folder


@pytest.fixture(scope="module")
def written(good, bad, tmp_path_factory):
    """What the command leaves and says."""
    target = tmp_path_factory.mktemp("report")
    result = sixstrut("report", str(good.path), "--against", str(bad.path), "-o", str(target))
    assert result.returncode == 0, result.stderr
    return target, result.stdout


def test_rates_and_intervals_follow_from_the_trials_alone(written):
    target, _ = written
    trials = [row for row in rows(target / "trials.csv") if row["revoked"] == "false" and row["outcome"] in ("success", "failure")]
    told = rows(target / "primitives.csv")
    assert {row["group"] for row in told} == {"a", "b"}
    for row in told:
        own = [t["outcome"] == "success" for t in trials if (t["group"], t["primitive"]) == (row["group"], row["primitive"])]
        interval = stats.binomtest(sum(own), len(own)).proportion_ci(method="exact")
        assert (int(row["successes"]), int(row["trials"])) == (sum(own), len(own))
        assert (float(row["low"]), float(row["high"])) == pytest.approx(tuple(interval))


def recorded(bag, lines, definition=str):
    """A folder as rosbag2 records trials. `definition`: changes the records'."""
    bag.mkdir()
    with (bag / "recorded_0.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "rosbag2")
        name = "tensegrity_interfaces/msg/TrialRecord"
        kind = writer.register_schema(name, "ros2msg", definition(ShareSchemas().schema_text(name)).encode())
        channel = writer.register_channel("/bridge/trial", "cdr", kind)
        for at, line in enumerate(lines):
            writer.add_message(channel, at, serialize_message(message_of(line)), at)
        writer.finish()
    information = {"version": 9, "storage_identifier": "mcap", "relative_file_paths": ["recorded_0.mcap"]}
    (bag / "metadata.yaml").write_text(yaml_text({"rosbag2_bagfile_information": information}), encoding="utf-8")
    return bag


@pytest.mark.slow
@pytest.mark.ros
def test_a_recording_of_rosbag2_with_the_trials_is_reported_as_the_session(bad, tmp_path):
    bag = recorded(tmp_path / "recorded", read_lines(bad.path / LEDGER)[0])
    ours, theirs = Group([bad.path]), Group([bag])
    assert (theirs.names, theirs.rates, theirs.label) == (ours.names, ours.rates, ours.label)
    result = sixstrut("report", str(bag))
    assert result.returncode == 0, result.stderr
    assert len(rows(tmp_path / "recorded_report" / "trials.csv")) == len(ours.sessions[0].lines)
    empty = sixstrut("report", str(EXAMPLE))
    assert (empty.returncode, "holds no trials" in empty.stderr) == (1, True)


@pytest.mark.ros
def test_a_policy_in_two_stages_is_in_the_bag_as_it_was(bad, tmp_path):
    line = next(line for line in read_lines(bad.path / LEDGER)[0] if line.event is Event.TRIAL)
    policies = tuple(range(-6, 6)), line.policy_mm
    written = [replace(line, policy_mm=policy) for policy in policies]
    assert tuple(line.policy_mm for line in lines_in_bag(recorded(tmp_path / "recorded", written))) == policies


def test_tests_follow_from_the_rates(written):
    target, printed = written
    rates = {g: [float(row["rate"]) for row in rows(target / "primitives.csv") if row["group"] == g] for g in "ab"}
    told = {(row["group"], row["test"].split(",")[0]): row for row in rows(target / "tests.csv")}
    expected = stats.mannwhitneyu(rates["a"], rates["b"], method="asymptotic")
    assert float(told["a, b", "Mann-Whitney U"]["statistic"]) == expected.statistic
    assert float(told["a, b", "Mann-Whitney U"]["p"]) == pytest.approx(expected.pvalue)
    assert f"U = {expected.statistic:g}" in printed
    assert float(told["b", "proper against improper"]["p"]) < 1e-3
    assert float(told["a", "proper against improper"]["p"]) > 0.05
    assert ("a", "Kolmogorov-Smirnov") in told


def test_void_and_revoked_trials_are_shown_and_do_not_count(written, bad):
    target, _ = written
    trials = [row for row in rows(target / "trials.csv") if row["group"] == "b"]
    assert sum(row["outcome"] == "void" for row in trials) == 6
    assert [row["revoked"] for row in trials].count("true") == 1
    assert len(Group([bad.path]).lines) == len(PLAN) // 2 - 1


def test_the_page_is_one_file_says_virtual_and_replays_every_trial(written, good):
    target, printed = written
    page = (target / "report.html").read_text(encoding="utf-8")
    assert "These are virtual trials" in page
    assert "These are virtual trials" in printed
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    pictures = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert len(pictures) == 4
    assert all(base64.b64decode(picture).startswith(b"\x89PNG") for picture in pictures)
    assert f"./sixstrut replay {good.bags}/a.mcap --trial 5" in page
    assert "treats the 24 different gaits of a primitive as exchangeable" in page, "intervals say what they take for granted"
    assert "paper, improved model" in page
    for name in ("figure8.png", "gaits_a.png", "gaits_b.png", "odds.png"):
        assert (target / name).read_bytes().startswith(b"\x89PNG")


def test_the_same_sessions_give_the_same_tables(written, good, bad, tmp_path):
    target, _ = written
    TrialReport([good.path], [bad.path], "").write(tmp_path)
    for name in ("primitives.csv", "gaits.csv", "tests.csv", "trials.csv"):
        assert (tmp_path / name).read_bytes() == (target / name).read_bytes()


def test_sessions_on_several_prototypes_are_bootstrapped_by_prototype(good, bad, tmp_path):
    group = Group([good.path, bad.path])
    assert group.robots == ["virtual one", "virtual two"]
    interval = group.by_prototype()
    rates = [Group([folder.path]).overall.value for folder in (good, bad)]
    assert (interval.low, interval.high) == pytest.approx((min(rates), max(rates)))
    page = TrialReport([good.path, bad.path], [], "").write(tmp_path).read_text(encoding="utf-8")
    assert "2 prototypes; all trials, bootstrapped by prototype" in page
    assert "needs a second group" in page


def test_one_trial_is_enough_and_none_is_a_clear_error(tmp_path):
    folder = begun(tmp_path / "new", PLAN)
    try_all(folder, {0: Outcome.VOID})
    result = sixstrut("report", str(folder.path))
    assert result.returncode == 1
    remedy = f"run `./sixstrut trial {folder.path}` first"
    assert result.stderr.startswith(f"error: no trial of {folder.path} has an outcome yet: {remedy}")
    add(Ledger(folder.path), PLAN[0], Outcome.SUCCESS)
    report = TrialReport([folder.path], [], "")
    assert report.groups[0].counts == (1, 1, 1, 1)
    assert report.write(tmp_path / "report").exists()


def test_what_is_no_session_or_does_not_belong_together_is_refused(good, tmp_path):
    with pytest.raises(SessionError, match="is not a session of trials"):
        Group([tmp_path])
    with pytest.raises(SessionError, match="given twice"):
        Group([good.path, good.path])
    real = begun(tmp_path / "real", PLAN, robot="ours", virtual=False)
    try_all(real, {0: Outcome.SUCCESS})
    with pytest.raises(SessionError, match="do not belong together"):
        Group([good.path, real.path])


# ---- chains


@pytest.fixture(scope="module")
def chained(tmp_path_factory):
    """Two chains made, one missed its fourth roll, one made all and did not stay; one is void; and three rolls."""
    plan = with_chains("reference", repeats=2) + planned("1-3", "reference")
    folder = begun(tmp_path_factory.mktemp("s") / "chained", plan)
    ledger = Ledger(folder.path)
    for slot, rolls in zip(plan, (12, 12, 3, 12), strict=False):
        add(ledger, slot, Outcome.SUCCESS if slot in plan[:2] else Outcome.FAILURE, rolls=rolls)
    add(ledger, plan[0], Outcome.VOID, rolls=8)
    for slot in plan[4:]:
        add(ledger, slot, Outcome.SUCCESS)
    return folder


@pytest.mark.slow
def test_chains_are_counted_whole_and_by_their_rolls_and_nowhere_else(chained, tmp_path):
    name = f"continuous {cyclic().hash[:4]} C1"  # the rolls are of another library
    result = sixstrut("report", str(chained.path), "-o", str(tmp_path))
    assert result.returncode == 0, result.stderr
    assert f"chains by {name}: 2 of 4" in result.stdout
    assert "rolls 39 of 40" in result.stdout, "what was begun: all that were made, and the one that missed"
    assert "all trials: 3 of 3" in result.stdout
    table = {row["of"]: (row["cycle"], row["successes"], row["trials"]) for row in rows(tmp_path / "chains.csv")}
    assert table == {"chains": (name, "2", "4"), "rolls": (name, "39", "40")}
    assert {row["primitive"].split()[-1] for row in rows(tmp_path / "primitives.csv")} == {"P1", "P2", "P3"}
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "chains made" in page
    assert "failure, 3 of 12 rolls" in page
    trials = rows(tmp_path / "trials.csv")
    assert [row["rolls"] for row in trials] == ["12", "12", "3", "12", "8", "1", "1", "1"]
    assert trials[0]["chain"].count("-") == 12


def test_a_session_of_chains_alone_is_reported_too(tmp_path):
    plan = with_chains("TC6-TO5-TC3")
    add(Ledger(begun(tmp_path / "s", plan).path), plan[0], Outcome.SUCCESS)
    report = TrialReport([tmp_path / "s"], [], "")
    assert summary_of(report).splitlines()[:2] == [
        "(a) continuous, virtual: chains alone",
        f"    chains by C1: {spread(rate_of(1, 1))}; rolls {spread(rate_of(2, 2))}",
    ]
    page = report.write(tmp_path / "out").read_text(encoding="utf-8")
    assert "Chains" in page
    assert "Figure 8" not in page
    assert not (tmp_path / "out" / "primitives.csv").exists()


@pytest.mark.ros
def test_a_chain_s_record_reads_back_from_a_bag_and_records_of_before_are_single_rolls(chained, tmp_path):
    lines = read_lines(chained.path / LEDGER)[0]
    again = lines_in_bag(recorded(tmp_path / "now", lines))
    assert [(line.chain, line.rolls, line.gait) for line in again] == [(line.chain, line.rolls, line.gait) for line in lines]

    def before(text):
        fields = ("string chain", "uint32 rolls", "int8[6] via_mm")
        assert sum(line.startswith(fields) for line in text.splitlines()) == 3
        return "\n".join(line for line in text.splitlines() if not line.startswith(fields))

    old = lines_in_bag(recorded(tmp_path / "before", lines, before))
    assert [(line.chain, line.rolls) for line in old] == [("", 0)] * len(lines)
    assert [replace(line, wall_s=0.0, battery_v=0.0, robot_s=0.0) for line in old] == [
        replace(line, wall_s=0.0, battery_v=0.0, robot_s=0.0, chain="", rolls=0) for line in lines
    ]
