# SPDX-License-Identifier: Apache-2.0
"""The stack's own benchmark on real processes, with a twin at 200 Hz; and what such a twin must not lose: its bits."""

from collections import defaultdict

import pytest

from hardware_bridge.recording.bag_reader import read_session
from tensegrity_lab.bags.replay import replay
from tests.benchmarks.stack import live_stack, start_up
from tests.benchmarks.stack.metrics import Plan

pytestmark = [pytest.mark.ros, pytest.mark.slow]
PLAN = Plan(rate_hz=200.0, seconds=1.0, goals=3, cancels=2, stops=1)


@pytest.fixture(scope="module")
def measured(tmp_path_factory, domain):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        yield live_stack.run(PLAN, tmp_path_factory.mktemp("fast"), (), lambda what: None)


def test_every_figure_is_measured(measured):
    assert [twin.doing for twin in measured.twins] == ["follows, at rest", "follows, struts moving", "is the robot"]
    assert all(twin.uneven.times > 0 and twin.cpu > 0.0 for twin in measured.twins)
    assert [latency.spread.times + latency.dropped for latency in measured.latencies] == [3, 2, 1]
    assert all(time_ms > 0.0 for latency in measured.latencies for time_ms in latency.times_ms)
    assert measured.load.messages_per_s > 0.0
    assert measured.load.kb_per_s > 0.0


def test_a_twin_at_200_hz_loses_no_event_and_replays_to_its_bits(measured):
    session = read_session(measured.bag)
    found = replay(session)
    assert found.live_states > 30
    assert found.same_states == found.live_states
    states = list(session.of("twin/state"))
    assert "0 events lost" in states[-1].detail


def test_between_events_it_shows_the_same_state_under_new_stamps(measured):
    digests, stamps = defaultdict(set), []
    for state in read_session(measured.bag).of("twin/state"):
        digests[state.first_seq, state.last_seq, state.step].add(state.digest)
        stamps.append((state.header.stamp.sec, state.header.stamp.nanosec))
    assert len(stamps) > len(digests)
    assert {len(found) for found in digests.values()} == {1}
    assert stamps == sorted(set(stamps))


def test_a_twin_tells_when_its_first_state_was_out(tmp_path, domain, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    first = start_up.first_state(tmp_path, tmp_path / "cache")
    assert first.published_s > 0.0
    assert first.heard_s > 0.0


def test_a_twin_that_has_to_compile_says_so_once(processes, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    first = processes.node("twin")
    first.says("first state published")
    assert "compiling the solver" in first.output
    second = processes.node("twin")
    second.says("first state published")
    assert "compiling the solver" not in second.output
