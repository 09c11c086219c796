# SPDX-License-Identifier: Apache-2.0
"""Everything that can be refused or go wrong here: one line that says what was got, what is valid, what to do.

What a caller may want to know beside the text is an attribute.
"""

import math
from typing import Any


class BridgeError(Exception):
    """Base of all errors of this package."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Text and data, not the arguments that made them: what a bridge refuses in its own process is read in another."""
        return _same, (type(self), self.args, self.__dict__)


def _same(kind: type[BridgeError], args: tuple[Any, ...], data: dict[str, Any]) -> BridgeError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(data)
    return error


class ParameterError(BridgeError):
    """A value outside its range."""

    def __init__(self, name: str, value: object, valid: str) -> None:
        self.name, self.value = name, value
        super().__init__(f"{name} is {value}, valid is {valid}")


class CodecError(ParameterError):
    """A value that a board's protocol cannot carry."""


# ---- port -----------------------------------------------------------------------------------------------------------


class TransportError(BridgeError):
    """The port cannot be used."""

    def __init__(self, port: str, problem: str, remedy: str) -> None:
        self.port, self.problem, self.remedy = port, problem, remedy
        super().__init__(f"port {port}: {problem}; {remedy}")


class PortMissing(TransportError):
    """There is no such port."""


class PortBusy(TransportError):
    """Somebody else holds the port."""


class PortWrongKind(TransportError):
    """The path or URL is no serial port, or may not be opened."""


class LinkLost(TransportError):
    """A read or write on the open port failed. `dirty`: part of a frame may have reached the board."""

    def __init__(self, port: str, problem: str, remedy: str, dirty: bool = False) -> None:
        self.dirty = dirty
        super().__init__(port, problem, remedy)


class TimeScaleError(BridgeError):
    """The time scale does not fit the port."""

    def __init__(self, port: str, time_scale: float, problem: str) -> None:
        super().__init__(f"time scale {time_scale:g} with port {port}: {problem}")


# ---- configuration --------------------------------------------------------------------------------------------------


class CalibrationError(BridgeError):
    """A calibration that must not drive a robot. `strut` (`S1`…) and `line` (from 1) where they are known."""

    def __init__(self, source: str, problem: str, strut: str | None = None, line: int | None = None) -> None:
        self.problem, self.strut, self.line = problem, strut, line
        where = source if line is None else f"{source}, line {line}"
        who = "" if strut is None else f"{strut}: "
        super().__init__(f"calibration {where}: {who}{problem}")


class StateFileError(BridgeError):
    """What must outlive the bridge cannot be kept: without the last pulses the next homing would be blind."""

    def __init__(self, path: str, problem: str, what: str) -> None:
        super().__init__(f"cannot keep {what} in {path}: {problem}; make the folder writable or free space")


class BoardMismatch(BridgeError):
    """The board asked for is not the one that a calibration or a virtual prototype names."""

    def __init__(self, wanted: str, found: str, where: str) -> None:
        super().__init__(f"board is {wanted}, but {where} is for {found}; set the board to {found}, or use another one")


SEND_AGAIN = "send it again"
"""Ends the text of a refusal that says nothing against the motion: the same one with a fresh stamp is judged at once."""


def may_be_sent_again(reason: str) -> bool:
    """Whether a refusal's text says that the same motion, with a fresh stamp, may well be accepted."""
    return reason.endswith(SEND_AGAIN)


# ---- refused commands -----------------------------------------------------------------------------------------------


class Refused(BridgeError):
    """A command refused whole; nothing was sent."""


class WrongPrototype(Refused):
    """Arming was asked for another virtual prototype than the one behind the port, if there is one there."""

    def __init__(self, wanted: str, port: str, there: str) -> None:
        found = f"drives virtual prototype {there}" if there else "is at a real port"
        super().__init__(f"virtual prototype {wanted} was to be armed, but this bridge {found} ({port}): nothing is armed")


class LimitError(Refused):
    """A strut outside a limit. `value` and `limit` are in `unit`."""

    def __init__(self, strut: str, quantity: str, value: float, limit: float, unit: str, where: str = "") -> None:
        self.strut, self.quantity, self.value, self.limit, self.unit = strut, quantity, value, limit, unit
        at = f" {where}" if where else ""
        super().__init__(f"{strut}: {quantity} {value:.6g} {unit}{at} is outside the limit {limit:.6g} {unit}")


class ShapeError(Refused):
    """A shape (six rest lengths, m) that the structure must not take."""

    def __init__(self, lengths_m: tuple[float, ...], problem: str, where: str = "") -> None:
        self.lengths_m, self.problem = lengths_m, problem
        shape = ", ".join(f"{length * 1e3:.1f}" for length in lengths_m)
        super().__init__(f"shape [{shape}] mm{f' {where}' if where else ''} is not permitted: {problem}")


class DutyError(Refused):
    """A strut that has run too long of late; times in [s] of robot time. Waiting for ever does not help: `wait_s` is then None.

    `used_s` is infinite where nobody knows how long it has run.
    """

    def __init__(self, strut: str, used_s: float, needed_s: float, limit_s: float, window_s: float, wait_s: float) -> None:
        self.strut, self.wait_s = strut, wait_s if math.isfinite(wait_s) else None
        remedy = "make the motion shorter" if self.wait_s is None else f"wait {math.ceil(wait_s)} s of robot time"
        if math.isinf(used_s):
            for_s = window_s if self.wait_s is None else wait_s
            super().__init__(
                f"{strut}: nobody knows how long the struts have run lately, so they count as spent for another {for_s:.0f} s "
                f"of robot time; if they have rested, start the bridge with rested_s:={window_s:.1f} (the way back is open)"
            )
            return
        super().__init__(
            f"{strut}: has run {used_s:.1f} s of the last {window_s:g} s and would run {needed_s:.1f} s more, "
            f"the limit is {limit_s:g} s; {remedy}"
        )


class SupplyError(Refused):
    """The servo supply is too low to begin a motion that loads the struts; in [V]."""

    def __init__(self, supply_v: float, limit_v: float) -> None:
        super().__init__(
            f"servo supply is {supply_v:.2f} V, the limit is {limit_v:g} V; charge it; the way back to mid stroke is open"
        )


class TrajectoryError(Refused):
    """A trajectory that is none: wrong names, counts, times or not-a-number."""

    def __init__(self, problem: str, strut: str | None = None, knot: int | None = None) -> None:
        self.problem, self.strut, self.knot = problem, strut, knot
        super().__init__(f"trajectory refused: {problem}")


class LeaseError(Refused):
    """Not the holder of the current lease."""

    def __init__(self, lease: str, problem: str) -> None:
        super().__init__(f"{'this lease' if lease else 'no lease'} is refused: {problem}")  # the lease itself is a secret


class StaleError(Refused):
    """A command stamped too long ago, or in the future. What was judged meanwhile is remembered: again, it goes quickly."""

    def __init__(self, age_s: float, limit_s: float) -> None:
        self.age_s = age_s
        super().__init__(f"command is {age_s:.3g} s old, valid is within {limit_s:g} s; check clocks, {SEND_AGAIN}")


class StateError(Refused):
    """Not in this state."""

    def __init__(self, command: str, mode: str, remedy: str) -> None:
        super().__init__(f"{command} refused in state {mode}: {remedy}")


class FaultLatched(StateError):
    """A fault is latched."""

    def __init__(self, command: str, reason: str) -> None:
        super().__init__(command, "FAULT", f"{reason}; remove the cause, then call reset")


class PositionUnknown(Refused):
    """Nobody knows where a strut is, or two sources disagree."""

    def __init__(self, strut: str, problem: str) -> None:
        self.strut, self.problem = strut, problem
        super().__init__(f"{strut}: {problem}")


class BoardSilent(Refused):
    """The board has never answered since the port was opened: who knows whether one is there."""

    def __init__(self, port: str, board: str, why: str, word: str) -> None:
        super().__init__(f"the board ({board}) has never answered on {port}: {why}; if it cannot answer, {word}")


class NotClear(Refused):
    """Arming without the operator's word that the robot is lifted and hands are clear."""

    def __init__(self) -> None:
        super().__init__("arm refused: lifted_and_clear is false; lift the robot, clear hands, then confirm it")


# ---- recorder and prototype -----------------------------------------------------------------------------------------


class RecorderError(BridgeError):
    """The log cannot be written, finished or verified."""

    def __init__(self, path: str, problem: str) -> None:
        self.problem = problem
        super().__init__(f"log {path}: {problem}")


class BagError(BridgeError):
    """A bag that cannot be read."""


class SchemaError(BridgeError):
    """A message type that is not installed."""

    def __init__(self, type_name: str, searched: list[str]) -> None:
        where = f" below {', '.join(searched)}" if searched else ""
        super().__init__(f"message type {type_name} not found{where}; name it package/msg/Name, source its workspace")


class ObserverError(BridgeError):
    """An observer said something that is no observation."""


class PrototypeError(BridgeError):
    """The virtual prototype cannot start."""

    def __init__(self, link: str, problem: str) -> None:
        self.problem = problem
        super().__init__(f"virtual prototype {link}: {problem}")
