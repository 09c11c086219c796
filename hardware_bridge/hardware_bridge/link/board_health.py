# SPDX-License-Identifier: Apache-2.0
"""What follows from a board's answer: pure, so that it is tested without a port."""

from dataclasses import dataclass

from hardware_bridge.boards.board import Health
from sim_core.names import STRUT_NAMES


@dataclass(frozen=True)
class Answer:
    """A sound answer of the board, and what was true when it was asked.

    Attributes:
        health: what it said.
        energised: which channels had been sent a pulse by then, and well before, in case the answer is a late one to an earlier
            question.
    """

    health: Health
    energised: tuple[bool, ...]

    @property
    def silent_channels(self) -> tuple[int, ...]:
        """Indices of the channels that should give a pulse and do not."""
        pairs = zip(self.health.pulses_us, self.energised, strict=False)
        return tuple(index for index, (pulse, on) in enumerate(pairs) if on and pulse is None)


@dataclass(frozen=True)
class Verdict:
    """What to do about an answer.

    Attributes:
        problem: why nothing more must be sent; empty: nothing is wrong with the struts that hold.
        positions_unknown: the struts may be elsewhere than they were sent.
    """

    problem: str = ""
    positions_unknown: bool = False


def judge(answer: Answer, holds: bool, error_moves: bool) -> Verdict:
    """Judges an answer. `holds`: some strut holds, or is about to; `error_moves`: on this board an error may move the struts.

    An error on a board whose struts nobody holds yet is old news (a time-out while no bridge was there, say), and no
    fault; but where it moves struts, nobody knows any more where they are.
    """
    errors, silent = answer.health.errors, answer.silent_channels
    unknown = bool(silent) or (bool(errors) and error_moves)
    if not holds:
        return Verdict("", unknown)
    if silent:
        names = ", ".join(STRUT_NAMES[index] for index in silent)
        return Verdict(f"the board gives {names} no pulse any more (reset or brown-out)", unknown)
    return Verdict(f"the board reports {', '.join(errors)}" if errors else "", unknown)
