# SPDX-License-Identifier: Apache-2.0
"""Which robot knowledge is about. A port's name says nothing: `/dev/rfcomm0` is every robot's."""

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

from hardware_bridge.boards.board import Board
from hardware_bridge.calibration.pulse_map import Calibration
from hardware_bridge.prototype_client.handshake import Handshake


@dataclass(frozen=True)
class Identity:
    """One robot, as it is driven.

    Attributes:
        robot: its name, from its calibration; of a virtual prototype its instance; empty: nobody knows which one it is.
        calibration: hash of its calibration; empty while that is measured.
        board: the board's spec.
        link: of a virtual prototype, where it lives; empty: a real robot.
    """

    robot: str
    calibration: str
    board: str
    link: str = ""

    @property
    def is_known(self) -> bool:
        """Whether it can be told from other robots."""
        return bool(self.robot)

    def __str__(self) -> str:
        """For people."""
        name = f"robot {self.robot!r}" if self.robot else "a robot without a name"
        who = f"the virtual prototype {self.robot[:8]}" if self.link else name
        measured = f"with calibration {self.calibration[:8]}" if self.calibration else "while it was calibrated"
        return f"{who} {measured} on board {self.board}"


def identity_of(port: str, calibration: Calibration, board: Board, handshake: Handshake | None) -> Identity:
    """Which robot is behind a port: by its calibration's word, or the virtual prototype's (`handshake` None: a real port)."""
    if handshake is None:
        return Identity(calibration.robot or "", calibration.hash, board.spec)
    return Identity(handshake.instance, calibration.hash, board.spec, canonical_link(port))


def canonical_link(port: str) -> str:
    """The one spelling of a link's path; the link itself is not followed."""
    link = Path(port)
    return str(link.parent.resolve() / link.name)


NAMELESS = Identity("", "", "")
"""Every real robot whose calibration does not name it."""


def record_path(directory: Path, what: str, identity: Identity) -> Path:
    """Where the record of something about a robot is kept: one file a robot, whatever its calibration and board."""
    if identity.link:
        kind, name = "prototype", identity.link
    elif identity.robot:
        kind, name = "robot", identity.robot
    else:
        return directory / f"{what}-nameless.json"
    slug = re.sub(r"[^A-Za-z0-9._]+", "-", name).strip("-.")[-40:]
    return directory / f"{what}-{kind}-{slug}-{hashlib.sha256(name.encode()).hexdigest()[:12]}.json"
