# SPDX-License-Identifier: Apache-2.0
"""The supervisor's vocabulary: its state, the events it takes and the effects it answers with. Values only."""

from dataclasses import dataclass, field
from enum import StrEnum

from hardware_bridge.safety.duty_cycle import Duty
from hardware_bridge.safety.trajectory import Trajectory
from sim_core.names import STRUT_NAMES

NONE_KNOWN: tuple[None, ...] = (None,) * len(STRUT_NAMES)
NONE_ENERGISED = (False,) * len(STRUT_NAMES)


HOMING_NUMBER = 0
"""The number of the motion that homing is; commanded motions count from 1."""


class Mode(StrEnum):
    """The supervisor's states."""

    DISARMED = "DISARMED"
    HOMING = "HOMING"
    ARMED = "ARMED"
    HOLD = "HOLD"
    FAULT = "FAULT"


class Kind(StrEnum):
    """Why a frame is sent."""

    ENERGISE = "energise"
    HOME = "home"
    MOVE = "move"
    HOLD = "hold"


class MotionOutcome(StrEnum):
    """How a motion ended."""

    DONE = "done"
    HELD = "held"
    FAULT = "fault"
    OVERTAKEN = "overtaken"


@dataclass(frozen=True)
class Now:
    """One instant, in [s]: on the robot's clock, which paces motion, and the wall's steady one, which judges life."""

    robot_s: float
    wall_s: float


@dataclass(frozen=True)
class Lease:
    """The right to command. `proven_wall_s`: last proof of its holder's life."""

    token: str
    holder: str
    proven_wall_s: float


@dataclass(frozen=True)
class Motion:
    """A path being sent.

    Attributes:
        number: identity of the motion; homing has `HOMING_NUMBER`.
        path: from the lengths at its acceptance on.
        progress_s: path time of the newest frame.
        ticked_s: robot time at which that frame was made; None before the first.
    """

    number: int
    path: Trajectory
    progress_s: float = 0.0
    ticked_s: float | None = None


@dataclass(frozen=True)
class LastFrame:
    """The newest frame that moved or held something: since then the board goes on to the pulses sent.

    Attributes:
        from_us: where its outputs were then, in [us].
        sent_s: robot time.
        moves_s: how long each takes to its pulse, in [s].
        paced_us: where they would have been then if they had never gone faster than the limit: what may be sent is tied to this
            too, so that no chain of motions gains a pulse with each.
    """

    from_us: tuple[float, ...]
    sent_s: float
    moves_s: tuple[float, ...]
    paced_us: tuple[float, ...]


@dataclass(frozen=True)
class State:
    """All that the supervisor knows.

    Attributes:
        mode: the state's name.
        reason: why, for people; empty if nothing needs saying.
        pulses_us: last sent (or confirmed) pulse of each strut; None where nobody knows.
        unknown_why: why nobody knows, for people.
        energised: which struts have been sent a pulse since the port was opened, and so hold.
        lease: the current one, if any.
        homed: homing has ended well since the last arm.
        motion: what is being sent, if anything.
        energising: while homing, how many struts have been energised.
        resume_s: robot time at which homing goes on.
        last_frame: see `LastFrame`.
        duty: how long each strut has run lately.
        ticked_s: robot time until which holding is counted; None before the first tick.
        supply_mv: servo supply as the board last told it, in [mV]; None where it never did.
    """

    mode: Mode = Mode.DISARMED
    reason: str = ""
    pulses_us: tuple[int | None, ...] = NONE_KNOWN
    energised: tuple[bool, ...] = NONE_ENERGISED
    lease: Lease | None = None
    homed: bool = False
    motion: Motion | None = None
    energising: int = 0
    resume_s: float = 0.0
    last_frame: LastFrame | None = None
    duty: Duty = field(default_factory=Duty)
    ticked_s: float | None = None
    supply_mv: int | None = None
    unknown_why: str = ""


# ---- events ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Arm:
    """Asks for the lease and for homing. `token` becomes the lease; a confirmed length may be None (see record)."""

    holder: str
    lifted_and_clear: bool
    token: str
    confirmed_lengths_m: tuple[float | None, ...] = NONE_KNOWN


@dataclass(frozen=True)
class Disarm:
    """Gives the lease back."""

    lease: str


@dataclass(frozen=True)
class Prove:
    """The lease's holder lives."""

    lease: str


@dataclass(frozen=True)
class Execute:
    """Asks for a motion; `stamp_age_s` is the wall age of the asking by now, with what judging it took."""

    trajectory: Trajectory
    lease: str
    stamp_age_s: float
    number: int


@dataclass(frozen=True)
class Overtake:
    """Asks for a motion that replaces the one that is running, without a stop between.

    Attributes:
        asked: the new motion, as `Execute` has it.
        running: number of the motion to be replaced.
        from_s: path time of that one at which the new one begins; until then the old path is kept.
    """

    asked: Execute
    running: int
    from_s: float


@dataclass(frozen=True)
class Hold:
    """Ends the motion where it is. `number`: only if this motion is the current one; None: any."""

    reason: str
    number: int | None = None


@dataclass(frozen=True)
class Stop:
    """Stop pressed, or anything else that must latch."""

    reason: str = "stop pressed"


@dataclass(frozen=True)
class LinkDown:
    """The port failed, or the board fell silent."""

    reason: str


@dataclass(frozen=True)
class Supply:
    """The board told its supply, in [mV]; None: it is not known any more."""

    millivolts: int | None


@dataclass(frozen=True)
class Reset:
    """Leaves FAULT."""


@dataclass(frozen=True)
class Tick:
    """Time has passed. `congested`: the port still holds bytes, so a new frame would only queue behind them."""

    congested: bool = False


Event = Arm | Disarm | Prove | Execute | Overtake | Hold | Stop | LinkDown | Supply | Reset | Tick


# ---- effects --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Send:
    """Make one frame: `struts` (indices from 0) to their entries of the six `pulses_us` within `duration_ms`."""

    kind: Kind
    struts: tuple[int, ...]
    pulses_us: tuple[int, ...]
    duration_ms: int


@dataclass(frozen=True)
class Finished:
    """A motion ended."""

    number: int
    outcome: MotionOutcome
    reason: str


Effect = Send | Finished
