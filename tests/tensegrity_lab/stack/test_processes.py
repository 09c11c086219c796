# SPDX-License-Identifier: Apache-2.0
"""What waits while processes are being put away."""

import os
import signal

import pytest

from tensegrity_lab.stack.processes import Uninterrupted


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_things_are_put_away_is_remembered(number):
    with Uninterrupted() as quiet:
        assert not quiet.interrupted
        os.kill(os.getpid(), number)
        assert quiet.interrupted


def test_afterwards_ctrl_c_interrupts_again():
    with Uninterrupted():
        pass
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
