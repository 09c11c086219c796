# SPDX-License-Identifier: Apache-2.0
"""Of what others publish the bag keeps what the stack itself may say, and not what a flood says."""

from hardware_bridge.recording.bag_quota import BURST_S, BYTES_PER_S, MESSAGES_PER_S, MOST_BYTES, Quota


def kept(quota, size, rate_hz, seconds, since_s=0.0):
    """How many messages of a steady stream are kept."""
    return sum(quota.takes(size, since_s + number / rate_hz) for number in range(round(rate_hz * seconds)))


def test_everything_that_the_stack_says_is_kept():
    twin, markers = Quota(), Quota()
    assert kept(twin, 900, 200.0, 30.0) == 6000
    assert kept(markers, 10_000, 20.0, 30.0) == 600
    assert twin.dropped == markers.dropped == 0


def test_a_flood_costs_no_more_than_its_quota():
    quota = Quota()
    count = kept(quota, 100, 70_000.0, 8.0)
    assert count <= MESSAGES_PER_S * (8.0 + BURST_S) + 1
    assert quota.dropped == 560_000 - count


def test_a_flood_of_large_messages_neither():
    assert kept(Quota(), 100_000, 1000.0, 8.0) * 100_000 <= BYTES_PER_S * (8.0 + BURST_S) + 100_000


def test_one_message_that_is_too_large_is_dropped_alone():
    quota = Quota()
    assert not quota.takes(MOST_BYTES + 1, 0.0)
    assert quota.takes(100, 0.0)


def test_after_a_flood_the_next_honest_message_is_kept_soon():
    quota = Quota()
    kept(quota, 100, 70_000.0, 8.0)
    assert quota.takes(900, 8.0 + 1.1 / MESSAGES_PER_S + 0.001)


def test_a_clock_that_has_not_moved_gives_nothing():
    quota = Quota()
    assert sum(quota.takes(10, 5.0) for _ in range(10_000)) == MESSAGES_PER_S * BURST_S
