# SPDX-License-Identifier: Apache-2.0
"""A campaign from its libraries to its page."""

import shlex
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sim_core.dynamics.model import build_model
from sim_core.gaits.library import LIBRARIES, Library, load_library
from sim_core.structure.parameters import load_prototype
from sim_core.studies.local_runner import Reporter
from tensegrity_lab.errors import SessionError
from tensegrity_lab.reports.trial_report import TrialReport, summary_of
from tensegrity_lab.session_data.folder import SessionFolder
from tests.studies.campaign_batch import require_new, session_of
from tests.studies.campaign_stack_sample import Pair, chosen, table_of, through_the_stack

SESSIONS, STACK, REPORT = "sessions", "stack", "report"


@dataclass(frozen=True)
class CampaignRequest:
    """What the command line says.

    Attributes:
        output: folder, new.
        libraries: names or files, the first is set against each other one.
        primitives, gaits: as `sixstrut trial` takes them.
        prototypes: how many.
        seed: of the first of them.
        perturbation: their scale.
        sample: trials that go through the stack, too.
        time_scale: of the stack.
        page: Markdown to write; None: none.
        command: that makes it, for people.
    """

    output: Path
    libraries: tuple[str, ...]
    primitives: str
    gaits: str
    prototypes: int
    seed: int
    perturbation: float
    sample: int
    time_scale: float
    page: Path | None
    command: str


@dataclass(frozen=True)
class Campaign:
    """What was done. `sessions`: library's name -> its sessions; `skipped`: names of libraries that are not shipped."""

    sessions: dict[str, list[SessionFolder]]
    skipped: list[str]
    pairs: list[Pair]
    reports: list[Path]
    summaries: list[str]


def run(asked: CampaignRequest, bar: Callable[[str], Reporter], say: Callable[[str], None]) -> Campaign:
    """Run a campaign.

    Args:
        asked: what the user asked for.
        bar: title -> a reporter of progress.
        say: told what goes on.

    Raises:
        SessionError, LibraryError, ParameterError, OSError.
    """
    require_new(asked.output)
    libraries, skipped = _libraries(asked.libraries)
    for name in skipped:
        say(f"library {name} is not shipped: skipped")
    if not libraries:
        raise SessionError(f"none of the libraries {', '.join(asked.libraries)} is shipped: name one that is, or a YAML file")
    nominal = build_model(load_prototype())
    sessions: dict[str, list[SessionFolder]] = {}
    for library in libraries:
        for seed in range(asked.seed, asked.seed + asked.prototypes):
            path = asked.output / SESSIONS / f"{library.name}_{seed}"
            report = bar(f"{library.name}, prototype {seed}")
            done = session_of(path, nominal, library, asked.primitives, asked.gaits, asked.perturbation, seed, report)
            sessions.setdefault(library.name, []).append(done)
    pairs: list[Pair] = []
    every = {folder.path: folder for folders in sessions.values() for folder in folders}
    drawn = chosen(list(every.values()), asked.sample, asked.seed) if asked.sample else {}
    for number, (path, slots) in enumerate(drawn.items(), start=1):
        say(f"through the stack, {number} of {len(drawn)}: {len(slots)} trials of {path.name}")
        pairs += through_the_stack(every[path], slots, asked.output / STACK / path.name, asked.time_scale)
    campaign = Campaign(sessions, skipped, pairs, *_reports(asked, sessions))
    (asked.output / "campaign.md").write_text(page_of(asked, campaign, None), encoding="utf-8")
    if asked.page is not None:
        _publish(asked, campaign, asked.page)
    return campaign


def _libraries(names: Sequence[str]) -> tuple[list[Library], list[str]]:
    missing = [name for name in names if not name.endswith(".yaml") and not (LIBRARIES / f"{name}.yaml").exists()]
    found = [load_library(name) for name in names if name not in missing]
    doubles = [library.name for library in found if [other.name for other in found].count(library.name) > 1]
    if doubles:
        raise SessionError(f"two libraries are called {doubles[0]}: give each of them once, or rename one")
    return found, missing


def _reports(asked: CampaignRequest, sessions: dict[str, list[SessionFolder]]) -> tuple[list[Path], list[str]]:
    """One for each library that the first is set against; of one library alone, one."""
    names = list(sessions)
    first = [folder.path for folder in sessions[names[0]]]
    found, told = [], []
    for other in names[1:] or [""]:
        against = [folder.path for folder in sessions[other]] if other else []
        command = shlex.join(["./sixstrut", "report", *map(str, first), *(["--against", *map(str, against)] if against else [])])
        report = TrialReport(first, against, command)
        found.append(report.write(asked.output / REPORT / (f"{names[0]}_against_{other}" if other else names[0])))
        told.append(summary_of(report))
    return found, told


def page_of(asked: CampaignRequest, campaign: Campaign, images: Path | None) -> str:
    """The page, as Markdown. `images`: folder of the pictures, relative to the page; None: beside their reports."""
    agree = sum(pair.agrees for pair in campaign.pairs)
    count = sum(len(folder.plan) for folders in campaign.sessions.values() for folder in folders)
    libraries = ", ".join(f"`{name}`" for name in campaign.sessions)
    skipped = "".join(f" Library `{name}` is not shipped and was skipped." for name in campaign.skipped)
    lines = [
        "# A campaign of virtual trials",
        "",
        f"This page is written by `{asked.command}`; do not edit it, run the command again.",
        "",
        "**Every trial here is virtual**, on virtual prototypes that share the model's equations. They test the pipeline from plan",
        "to report, and the libraries against perturbations; they do not test the paper's claim, which is about a real robot.",
        "",
        f"{count} trials: libraries {libraries}, primitives {asked.primitives}, gaits {asked.gaits}, on {asked.prototypes} virtual",
        f"prototype(s) at ±{100 * asked.perturbation:g} %, seeds from {asked.seed}, ideal actuators, computed by the batch solver",
        f"and not by the stack. A trial succeeds if the robot stands on the target after actuation and after the return.{skipped}",
    ]
    for path, summary in zip(campaign.reports, campaign.summaries, strict=True):
        picture = f"{images}/{path.parent.name}.png" if images else f"{REPORT}/{path.parent.name}/figure8.png"
        lines += ["", f"## {path.parent.name.replace('_', ' ')}", "", "```", *summary.splitlines(), "```", ""]
        lines += [f"![success rates as in the paper's Figure 8, virtual: {path.parent.name.replace('_', ' ')}]({picture})"]
    lines += ["", "## The same trials through the whole stack", ""]
    if campaign.pairs:
        lines += [
            f"{len(campaign.pairs)} of these trials, drawn by the seed, half of them failures as far as there are any, were run",
            "again by `sixstrut trial`: planner, bridge, board's bytes and the virtual prototype of the same seed and scale, as",
            f"processes of their own. **{agree} of {len(campaign.pairs)} agree.** They need not all agree: the stack sends",
            "motions in steps, and its robot starts from where it stands, slightly displaced; the batch solver's does not.",
            "",
            table_of(campaign.pairs),
        ]
    else:
        lines.append("None was asked for (`--sample`).")
    return "\n".join(lines) + "\n"


def _publish(asked: CampaignRequest, campaign: Campaign, page: Path) -> None:
    images = Path("images") / page.stem
    (page.parent / images).mkdir(parents=True, exist_ok=True)
    for path in campaign.reports:
        shutil.copyfile(path.parent / "figure8.png", page.parent / images / f"{path.parent.name}.png")
    page.write_text(page_of(asked, campaign, images), encoding="utf-8")
