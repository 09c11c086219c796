# SPDX-License-Identifier: Apache-2.0
"""A sample of computed trials, once more through the whole stack: real processes, real bytes, the same virtual prototypes."""

import random
import subprocess
import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from hardware_bridge.driver.child_process import bound
from tensegrity_lab.errors import SessionError
from tensegrity_lab.reports.markdown import table
from tensegrity_lab.reports.trial_analysis import read_told
from tensegrity_lab.session_data.folder import SessionFolder, begin_session
from tensegrity_lab.session_data.ledger_line import Line, Outcome
from tensegrity_lab.session_data.plan import Slot

LEFT = 130
LIMIT_S = 3600.0
NOT_DONE = "not done"


class Pair(NamedTuple):
    """One trial by both: what was tried, the computed line, and the stack's; None: the stack did not get to it."""

    session: SessionFolder
    slot: Slot
    fast: Line
    stack: Line | None

    @property
    def agrees(self) -> bool:
        """Both succeeded, or both failed."""
        return self.stack is not None and self.stack.outcome is self.fast.outcome


def chosen(sessions: Sequence[SessionFolder], count: int, seed: int) -> Mapping[Path, list[Slot]]:
    """Slots of sessions, drawn by a seed: half of them computed failures, as far as there are any, the rest successes.

    Returns:
        session's folder -> slots in its plan's order.
    """
    rows = [(folder, line) for folder in sessions for line in read_told(folder.path).valid]
    lost = [row for row in rows if row[1].outcome is Outcome.FAILURE]
    won = [row for row in rows if row[1].outcome is Outcome.SUCCESS]
    rng = random.Random(seed)
    failures = rng.sample(lost, min(len(lost), max(count // 2, count - len(won))))
    drawn = failures + rng.sample(won, min(len(won), count - len(failures)))
    wanted = {(folder.path, line.gait) for folder, line in drawn}
    found: dict[Path, list[Slot]] = defaultdict(list)
    for folder in sessions:
        for slot in folder.plan:
            if (folder.path, slot.gait) in wanted:
                found[folder.path].append(slot)
    return found


def through_the_stack(folder: SessionFolder, slots: Sequence[Slot], path: Path, time_scale: float) -> list[Pair]:
    """Try slots of a computed session with `sixstrut trial`, on the prototype of the same seed and scale, with ideal actuators.

    Args:
        folder: the computed session.
        slots: of its plan, to be tried again.
        path: folder of the stack's session.
        time_scale: robot seconds per second.

    Raises:
        SessionError: the stack could not go on; its own words are repeated.
    """
    settings = replace(folder.settings, name=path.resolve().name, computed="")
    begin_session(path, settings, list(slots), folder.library)
    command = [sys.executable, "-m", "sixstrut_cli", "trial", str(path), "--virtual", "--time-scale", f"{time_scale:g}"]
    done = subprocess.run(bound(command), capture_output=True, text=True, timeout=LIMIT_S, check=False)
    if done.returncode not in (0, LEFT):
        last = (done.stderr.strip() or done.stdout.strip() or "no words").splitlines()[-1]
        raise SessionError(f"the stack could not finish {path}: {last}; go on with `./sixstrut trial {path} --virtual`")
    fast = {line.gait: line for line in read_told(folder.path).valid}
    stack = {line.gait: line for line in read_told(path).valid}
    return [Pair(folder, slot, fast[slot.gait], stack.get(slot.gait)) for slot in slots]


def table_of(pairs: Sequence[Pair]) -> str:
    """A Markdown table of both outcomes."""
    rows = []
    for pair in pairs:
        stack = pair.stack.outcome if pair.stack is not None else NOT_DONE
        settings = pair.session.settings
        where = ("", "") if pair.agrees else (_end(pair.fast), _end(pair.stack))
        ends = f"{pair.fast.outcome}{where[0]}", f"{stack}{where[1]}"
        rows.append((settings.library, settings.seed, pair.slot.name, *ends, "yes" if pair.agrees else "**no**"))
    return table(("library", "prototype", "gait", "batch solver", "whole stack", "agree"), rows, "lrllll")


def _end(line: Line | None) -> str:
    return f" ({line.observed_face or 'no face'})" if line is not None else ""
