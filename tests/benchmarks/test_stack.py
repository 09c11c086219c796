# SPDX-License-Identifier: Apache-2.0
"""What `bench --stack` makes of times it was given, and what it prints. No clock decides."""

import json
import math
import os
from dataclasses import replace
from pathlib import Path

import pytest

from tests.benchmarks.stack import demo_usage, live_stack, metrics, recording, report, start_up
from tests.benchmarks.stack.process_usage import Sampler

MS = 1_000_000
BAG = Path(__file__).parents[2] / "bags" / "example"


def test_a_spread_is_median_99th_percentile_and_worst():
    assert metrics.spread([float(value) for value in range(101)]) == (101, 50.0, 99.0, 100.0)
    nothing = metrics.spread([])
    assert nothing.times == 0
    assert math.isnan(nothing.p50_ms)


def test_unevenness_is_the_distance_from_the_period_either_way():
    assert metrics.uneven_ms([0, 5 * MS, 11 * MS, 15 * MS], 0.005) == pytest.approx([0.0, 1.0, 1.0])


def test_a_twin_is_judged_by_its_own_stamps_and_by_what_was_heard():
    ticks = [(number * 5 * MS, number * 5 * MS + (3 * MS if number == 2 else 0)) for number in range(5)]
    cost = live_stack.twin_cost("at rest", 200.0, ticks, 0.1)
    assert cost.published_hz == pytest.approx(200.0)
    assert (cost.uneven.times, cost.uneven.worst_ms) == (4, pytest.approx(0.0))
    assert cost.heard.worst_ms == pytest.approx(3.0)


def test_heartbeats_are_no_writes():
    writes = [(10, False), (20, True), (30, False), (40, False), (50, True)]
    assert metrics.first_write_ns(writes, 11) == 30
    assert metrics.last_write_ns(writes, 11) == 40
    assert metrics.first_write_ns(writes, 41) is None
    assert metrics.last_write_ns(writes, 41) is None


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (["/venv/bin/python", "/ws/install/tensegrity_robot/lib/tensegrity_robot/twin", "--ros-args"], "twin"),
        (["/venv/bin/python", "-m", "hardware_bridge.virtual_prototype", "--link", "/tmp/twin"], "virtual_prototype"),
        (["/bin/sh", "-c", "true"], ""),
    ],
)
def test_processes_are_known_by_their_command_lines(command, name):
    assert demo_usage.name_of(command) == name


def test_a_process_is_seen_with_its_memory_and_the_sum_comes_last():
    with Sampler(lambda: {"this": os.getpid()}) as sampler:
        sampler.look(share=True)
        sampler.begin()
        sampler.look()
    this, whole = sampler.usages(1.0)
    assert (this.process, whole.process) == ("this", "all")
    assert this.starting_s > 0.0
    assert whole.rss_mb == this.rss_mb > 1.0
    assert this.pss_mb > 1.0


def test_a_process_that_is_gone_does_not_end_the_watch():
    sampler = Sampler(lambda: {"gone": 2**22 + 1})
    sampler.begin()
    assert [usage.process for usage in sampler.usages(1.0)] == ["gone", "all"]


def test_a_twin_s_word_about_its_start_is_read(tmp_path):
    log = tmp_path / "twin.log"
    log.write_text("[INFO] [1.5] [twin]: twin (follow) stands on TC6\n")
    assert start_up.published_s(log) is None
    log.write_text(log.read_text() + "[INFO] [1.6] [twin]: first state published 0.87 s after the process began\n")
    assert start_up.published_s(log) == 0.87


def test_the_recorder_alone_loses_nothing_silently(tmp_path):
    plan = metrics.Plan(messages=300, burst=200)
    found = recording.measure(BAG, tmp_path, plan)
    assert (found.messages, found.burst) == (300, 200)
    assert found.recorded == found.accepted
    assert found.lost == (10 if found.fault else 0)  # a disk that keeps up is no fault


@pytest.fixture
def whole():
    spread = metrics.spread([0.5, 1.5])
    compiled = metrics.Compilation((metrics.Compiling("one robot", 4.0, 3.9, 25, (("kernel.forces", 0.5),)),), 5.0, 4.5)
    return metrics.StackReport(
        "a processor",
        2,
        "3.12",
        "rclpy 7",
        (0.1, 1.0),
        metrics.QUICK,
        (metrics.TwinCost("follows, at rest", 200.0, 199.9, spread, spread, 0.15),),
        (metrics.Latency("stop → frame that holds", "waits for nothing", spread, 0, (0.5, 1.5)),),
        metrics.Load(450.0, 200.0, 8),
        metrics.Capacity(100, 5e4, 20.0, 0.5, 10, 7.0, 9, 0.1, 20_000, 25_000, 10, 25_000, "full"),
        (metrics.Usage("twin", 1.5, 0.25, 200.0, 100.0), metrics.Usage("all", 1.5, 0.25, 200.0, 100.0)),
        metrics.StartUp(
            compiled,
            compiled,
            (metrics.FirstState(0.9, 1.2, 0.8), metrics.FirstState(1.1, 3.4, 0.8)),
            metrics.FirstState(5.0, 6.0, 4.0),
        ),
    )


def test_the_page_holds_every_figure(whole):
    text = report.as_markdown(whole, "images/x.png")
    assert "| follows, at rest | 199.9 | 1.00 | 1.49 | 1.50 | 1.00 | 1.49 | 15 % | 2 |" in text
    assert "| stop → frame that holds | 1.00 | 1.49 | 1.50 | 2 | 0 | waits for nothing |" in text
    assert "recorded 450 messages/s, 200 kB/s; at most 8 of 20000 waited" in text
    assert "| twin | 1.5 | 25 % | 200 | 100 |" in text
    assert "| one robot | 4.0 | 3.9 | 25 | kernel.forces 0.5 |" in text
    assert "first state 1.00 s (median of 2, worst 1.10 s)" in text
    assert "![" in text
    assert "![" not in report.as_markdown(whole, None)


def test_it_is_also_json_and_a_picture(whole, tmp_path):
    document = json.loads(report.as_json(replace(whole, load=(float("nan"), 1.0))))
    assert document["twins"][0]["uneven"] == [2, 1.0, pytest.approx(1.49), 1.5]
    assert document["load"] == [None, 1.0]
    report.draw(whole, tmp_path / "images" / "x.png")
    assert (tmp_path / "images" / "x.png").stat().st_size > 10_000
