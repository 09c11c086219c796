# SPDX-License-Identifier: Apache-2.0
"""What is remembered of one robot, and that only one bridge at a time remembers it."""

from pathlib import Path

from hardware_bridge.link.port_lock import lock_robot
from hardware_bridge.safety.limits import Limits
from hardware_bridge.saved_state.duty_record import DutyRecord
from hardware_bridge.saved_state.last_pulses import LastPulses
from hardware_bridge.saved_state.robot_identity import Identity


class Records:
    """Held until `close`.

    Attributes:
        identity: whose.
        pulses: where its struts were sent last.
        duty: how long they have run lately.
    """

    def __init__(self, directory: Path, identity: Identity, limits: Limits, port: str) -> None:
        """Raises PortBusy: another bridge drives a robot of that name now."""
        self.identity = identity
        self.pulses = LastPulses(directory, identity)
        self.duty = DutyRecord(directory, identity, limits)
        self._lock = lock_robot(str(self.pulses.path), identity.robot, port) if identity.is_known else None

    def close(self) -> None:
        """Lets go of the robot."""
        if self._lock is not None:
            self._lock.release()
