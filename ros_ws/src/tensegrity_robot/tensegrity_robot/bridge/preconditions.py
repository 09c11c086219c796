# SPDX-License-Identifier: Apache-2.0
"""What must hold beside the supervisor's limits before the robot is armed or moved: a log, a calibration, struts that follow."""

import time

from hardware_bridge.calibration.calibration_file import load_calibration
from hardware_bridge.driver.remote_bridge import RemoteBridge
from hardware_bridge.errors import Refused
from hardware_bridge.recording.log_watch import LogWatch
from hardware_bridge.safety.supervisor_messages import Mode
from hardware_bridge.safety.trajectory import Trajectory
from tensegrity_robot.bridge.observer import Observing

UNCALIBRATED = (
    "a real port, but the calibration is the virtual prototype's: measure the robot's own with `./sixstrut calibrate` and start "
    "the bridge with calibration:=FILE"
)


class MotionConditions:
    """The conditions of one open bridge.

    Args:
        watch: of the bag; None: not recording.
        library_hash: of the library in the bag; empty: not recording.
    """

    def __init__(self, bridge: RemoteBridge, observing: Observing, watch: LogWatch | None, library_hash: str):
        self._bridge = bridge
        self._observing = observing
        self.watch = watch
        self._library_hash = library_hash
        self._held_for = ""

    def require_armable(self) -> None:
        """Raises Refused: this robot must not be armed now, and why."""
        self._require_log()
        prototypes_own = self._bridge.rules.calibration.struts == load_calibration().struts  # also as a copy, unedited
        if prototypes_own and not self._bridge.snapshot().virtual_port:
            raise Refused(UNCALIBRATED)

    def require_movable(self, trajectory: Trajectory, library_hash: str) -> None:
        """Raises Refused: this motion must not begin, and why. The way back to mid stroke is always open.

        What the supervisor refuses anyhow is left to it: its reason comes first. `library_hash`: of the motion; empty: none.
        """
        snapshot = self._bridge.snapshot()
        if snapshot.mode not in (Mode.ARMED, Mode.HOLD) or self._bridge.returns(trajectory):
            return
        self._require_log()
        if library_hash and self._library_hash and library_hash != self._library_hash:
            raise Refused(
                f"the motion comes from library {library_hash}, this session's bag holds library {self._library_hash}: start "
                "bridge and planner with the same library"
            )
        if stalled := self._observing.stalled(snapshot):
            raise Refused(stalled)

    def attend(self) -> str:
        """Look at the log; a motion that runs when it fails is held, once. Returns what it was held for, or nothing."""
        trouble = self.watch.look(time.monotonic()) if self.watch is not None else ""
        before, self._held_for = self._held_for, trouble
        if not trouble or before or not self._bridge.snapshot().moving:
            return ""
        self._bridge.hold(trouble)
        return trouble

    def _require_log(self) -> None:
        if self.watch is not None and self.watch.look(time.monotonic()):
            raise Refused(self.watch.trouble)
