# SPDX-License-Identifier: Apache-2.0
"""SIGKILL at random moments: no message that was told as written is lost, and what is recovered reads in order."""

import pytest

from tests.hardware_bridge.killing import kill_while_writing

pytestmark = [pytest.mark.soak, pytest.mark.timeout(1800)]

KILLS = 200


def test_no_acknowledged_message_is_lost(tmp_path, figure):
    acknowledged = recovered = 0
    for seed in range(KILLS):
        left = kill_while_writing(tmp_path, seed)
        assert len(left.by_mcap) >= left.acknowledged, f"kill {seed}"
        assert left.by_mcap == left.by_rosbags == list(range(len(left.by_mcap))), f"kill {seed}"
        acknowledged += left.acknowledged
        recovered += len(left.by_mcap)
        (tmp_path / f"{seed}.mcap").unlink()
    figure("recorders killed; messages acknowledged, recovered, lost", f"{KILLS}; {acknowledged}, {recovered}, 0")
