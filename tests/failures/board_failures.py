# SPDX-License-Identifier: Apache-2.0
"""Rows about the boards: what is left of a motion when the link dies, and what becomes of a reset."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from hardware_bridge.boards.registry import BOARDS, parse_board
from hardware_bridge.prototype_client.fault_client import TO_BOARD
from hardware_bridge.prototype_client.handshake import observer_path
from hardware_bridge.prototype_client.observation import Observation
from hardware_bridge.prototype_client.observer_client import ObserverClient
from sim_core.structure.topology import STRUTS as STRUT_ENDS
from tensegrity_interfaces.msg import BridgeState
from tensegrity_lab.stack.processes import wait_until
from tests.failures.rig import MID, Rig, Setup, stretched
from tests.failures.scenario import Evidence, expect

DEATHS = 2
SPEED_M_S = 0.014
"""A little less than a gait's, so that ideal actuators do not lag: a lagging one also goes on to where it was last sent."""
FRAME_S = 0.055
"""A frame is told to last so long; at most this and the line's time are left when the link dies."""
LIMIT_MM = 3.0
"""Two frames at most may be one late frame's on a loaded computer: what is left must not be more on any board."""


@dataclass(frozen=True)
class BoardFacts:
    """What was found with one board.

    Attributes:
        residual_mm: What a strut still moved after the link died, for each death.
        reset_noticed_s: Wall time from a reset to FAULT; None: not noticed.
        reset_told: The reason of the fault, or of the next refusal.
        positions_known: After it.
    """

    residual_mm: tuple[float, ...]
    reset_noticed_s: float | None
    reset_told: str
    positions_known: bool


@contextmanager
def watching(lab: Rig) -> Iterator[list[tuple[float, float]]]:
    """A list that grows by (the prototype's robot time in s, length of S1 in m) with every observation."""
    first, second = STRUT_ENDS[0]
    seen: list[tuple[float, float]] = []

    def see(observation: Observation) -> None:
        length_m = float(np.linalg.norm(observation.joints_m[second] - observation.joints_m[first]))
        seen.append((observation.robot_time_ns * 1e-9, length_m))

    client = ObserverClient(str(observer_path(lab.link)), see)
    try:
        wait_until(lambda: seen, 10.0, "an observation")
        yield seen
    finally:
        client.close()


def residual_mm(lab: Rig) -> float:
    """How far S1 still goes after the link has died in mid-motion."""
    operator = lab.operator
    lease = lab.arm()
    with watching(lab) as seen:
        operator.begin_motion((0.036 / SPEED_M_S, stretched(1, 0.036)), lease=lease)
        wait_until(lambda: seen[-1][1] > MID[0] + 0.012, 20.0, "S1 under way")
        died_s = lab.fault("drop", TO_BOARD)
        wait_until(lambda: seen[-1][0] > died_s + 1.0, 20.0, "rest")
    times_s, lengths_m = np.array(seen).T
    at_death_m = float(np.interp(died_s, times_s, lengths_m))
    operator.trigger("stop")
    operator.lease = ""
    lab.fault("clear")
    lab.calm()
    return (seen[-1][1] - at_death_m) * 1e3


def facts_of(lab: Rig, board: str) -> BoardFacts:
    """Everything about one board."""
    operator = lab.use(Setup(board=board, time_scale=4.0))
    residuals = tuple(residual_mm(lab) for _ in range(DEATHS))
    lease = lab.arm()  # the struts have been under power since the first time, and so count as holding
    began_s = time.monotonic()
    if parse_board(board).quirks.tells_pulses:
        lab.fault("reset")
        operator.sees(BridgeState.FAULT, 20.0)
        noticed_s: float | None = time.monotonic() - began_s
        told = operator.bridge.reason
    else:
        lab.fault("brown_out", volts=5.0, seconds=20.0)
        noticed_s = None
        wait_until(lambda: operator.bridge.battery_v == 5.0, 20.0, "the sagging supply")
        expect(operator.bridge.state == BridgeState.ARMED, f"{board} noticed a reset")
        told = operator.move((1.0, stretched(1, 0.004)), lease=lease).reason
    known = not any(np.isnan(operator.bridge.length_m))
    lab.calm()
    lab.arm()  # homing, wherever the struts are seen now
    return BoardFacts(residuals, noticed_s, told, known)


def all_facts(lab: Rig) -> dict[str, BoardFacts]:
    """Of all boards, found once for both rows."""
    return lab.remember("boards", lambda: {board: facts_of(lab, board) for board in BOARDS})


def link_dies(lab: Rig) -> Evidence:
    """Row 3."""
    evidence = Evidence()
    for board, facts in all_facts(lab).items():
        quirks = parse_board(board).quirks
        largest = max(facts.residual_mm)
        expect(min(facts.residual_mm) >= -0.2 and largest <= LIMIT_MM, f"{board}: {facts.residual_mm} mm after the link died")
        line_s = 10.0 * quirks.longest_frame_bytes / quirks.usual_baud
        evidence.rows[board] = {
            f"seen in {DEATHS} tries [mm]": f"{largest:.1f}",
            f"frame and line at {SPEED_M_S * 1e3:g} mm/s [mm]": f"{SPEED_M_S * 1e3 * (FRAME_S + line_s):.1f}",
            "the board's own time-out": "4 s, if set; home on Ignore" if quirks.has_timeout else "none",
        }
        evidence.figures[f"{board}: largest residual motion [mm]"] = round(largest, 1)
    evidence.told.append("the board has not answered for 4 s; check power and link, then reset")
    return evidence


def board_resets(lab: Rig) -> Evidence:
    """Row 8."""
    evidence = Evidence()
    for board, facts in all_facts(lab).items():
        if facts.reset_noticed_s is None:
            expect(facts.positions_known, "nobody noticed, and yet the positions are unknown")
            expect("servo supply is 5.00 V" in facts.reset_told, f"{board}: {facts.reset_told}")
            how, after = "its supply sags; a short reset is not noticed", "-"
        else:
            expect("no pulse any more (reset or brown-out)" in facts.reset_told, f"{board}: {facts.reset_told}")
            expect(not facts.positions_known, f"{board}: after a reset the positions are believed")
            expect(facts.reset_noticed_s < 3.0, f"{board}: noticed after {facts.reset_noticed_s:.1f} s")
            how, after = "its next answer tells no pulse", f"{facts.reset_noticed_s:.1f}"
        evidence.rows[board] = {"noticed by": how, "after [s]": after}
        if facts.reset_told not in evidence.told and board != "maestro":
            evidence.told.append(facts.reset_told)
    return evidence
