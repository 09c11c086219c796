# SPDX-License-Identifier: Apache-2.0
"""A session computed by the batch solver: a real folder with its ledger, of virtual trials that no stack ran."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from sim_core.dynamics.model import Model
from sim_core.gaits.cycle import Chain
from sim_core.gaits.library import Library
from sim_core.rolling.batch import Batch, Job
from sim_core.rolling.roll import RollResult
from sim_core.structure.policy import MOST_STAGES, checked_policy
from sim_core.studies.ensemble_fit import stood_on_target
from sim_core.studies.local_runner import Reporter, silent
from sim_core.uncertainty.perturbation_law import perturb
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.folder import SessionFolder, Settings, begin_session, now_text, virtual_robot_text
from tensegrity_lab.session_data.ledger import Ledger
from tensegrity_lab.session_data.ledger_line import Event, Line, Outcome, utc_text
from tensegrity_lab.session_data.plan import DIGITS, Slot, chosen_gaits, chosen_primitives, planned

COMPUTED = "batch solver"
IDEAL = "ideal"
"""Actuators: with them, batch solver and stack have the same robot."""


def session_of(
    path: Path,
    nominal: Model,
    library: Library,
    primitives: str,
    gaits: str,
    perturbation: float,
    seed: int,
    report: Reporter = silent,
) -> SessionFolder:
    """Try gaits of a library on the virtual prototype of (perturbation, seed), and write that as a session.

    Args:
        path: its folder, new or empty.
        nominal: model of the nominal prototype.
        library: the gait library.
        primitives: as `sixstrut trial` takes them.
        gaits: as `sixstrut trial` takes them.
        perturbation: scale of the law that the prototype is drawn by.
        seed: of the prototype and of the order.
        report: called with (done, total).

    Raises:
        SessionError: no such gaits, or the folder holds something else. ParameterError, OSError.
    """
    chosen = chosen_gaits(chosen_primitives(library, primitives), gaits)
    if any(isinstance(gait, Chain) for gait in chosen):
        raise SessionError(
            f"--primitives {primitives!r}: a campaign takes primitives; `trial` and `robustness --cycles` take cycles"
        )
    plan = planned(chosen, library, nominal, 1, seed)
    settings = Settings(
        name=path.resolve().name,
        created=now_text(),
        library=library.name,
        library_hash=library.hash,
        primitives=primitives,
        gaits=gaits,
        repeats=1,
        order_seed=seed,
        robot=virtual_robot_text(seed, perturbation, IDEAL),
        virtual_robot=True,
        perturbation=perturbation,
        seed=seed,
        actuators=IDEAL,
        computed=COMPUTED,
    )
    folder = begin_session(path, settings, plan, library)
    jobs = [Job(0, slot.source, checked_policy(slot.policy_mm, 10_000, MOST_STAGES), slot.target) for slot in plan]
    results = Batch([perturb(nominal, perturbation, seed)]).run(jobs, report)
    trials = zip(plan, results, strict=True)
    Ledger(path).append_all([line for n, (slot, result) in enumerate(trials, 1) for line in _lines(folder, n, slot, result)])
    return folder


def _lines(folder: SessionFolder, number: int, slot: Slot, result: RollResult) -> Sequence[Line]:
    """A trial's beginning and its end."""
    settings, now = folder.settings, utc_text(time.time_ns())
    facts = (settings.name, COMPUTED, settings.robot, True, settings.library, settings.library_hash)
    won = stood_on_target(result)
    stands = result.returned if result.returned is not None else result.actuated
    begun = Line(Event.BEGIN, number, now, *facts, **slot._asdict(), began=now)
    ended = replace(
        begun,
        event=Event.TRIAL,
        outcome=Outcome.SUCCESS if won else Outcome.FAILURE,
        reason="" if won else result.reason,
        observed_face=stands.face or "",
        faces=result.faces,
        robot_s=round(result.duration_s, DIGITS),
        rolls=int(result.actuated.face == slot.target),
    )
    return begun, ended


def require_new(folder: Path) -> None:
    """Raise SessionError if a folder holds anything."""
    if folder.exists() and any(folder.iterdir()):
        raise SessionError(f"{folder} is not empty: give a folder that does not exist yet")
