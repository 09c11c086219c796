# SPDX-License-Identifier: Apache-2.0
"""The page and the pictures of the validation suite."""

from collections.abc import Mapping
from pathlib import Path

from tensegrity_lab.reports.figure import STRUT_COLORS, new_figure, picture_file
from tensegrity_lab.reports.markdown import table
from tests.validation import TOPICS, Case, Comparison, Picture

MARKERS = "os^Dv"


def number(value: float) -> str:
    """A measured number for people; a plain zero."""
    return "0" if value == 0.0 else f"{value:.6g}"


def with_unit(value: float, unit: str) -> str:
    """A number with its unit; "1" is none."""
    return number(value) if unit == "1" else f"{number(value)} {unit}"


def allowed(result: Comparison, unit: bool = True) -> str:
    """The tolerance, as it is meant."""
    if result.relative:
        return f"± {100.0 * result.tolerance:g} %"
    return f"± {with_unit(result.tolerance, result.unit if unit else '1')}"


def found(result: Comparison) -> str:
    """The error, in the tolerance's terms."""
    return f"{result.error:.1e}" if not result.relative else f"{100.0 * result.error:.2g} %"


@picture_file
def picture(data: Picture, path: Path, title: str) -> None:
    """One picture, as a small PNG."""
    import numpy as np

    figure = new_figure(6.4, 3.8)
    axes = figure.add_subplot()
    lines = dots = 0
    for curve in data.curves:
        color = STRUT_COLORS[(lines + dots) % len(STRUT_COLORS)]
        if curve.marks:
            axes.plot(curve.x, curve.y, MARKERS[dots % len(MARKERS)], color=color, ms=5, mfc="none", label=curve.label)
            dots += 1
        else:
            axes.plot(curve.x, curve.y, ("-", "--", "-.", ":")[lines % 4], color=color, lw=1.6, label=curve.label)
            lines += 1
    if data.log_x:
        widest = np.max(data.curves[0].x)
        axes.set_xscale("log", base=2 if widest > 1.0 else 10)
        if widest > 1.0:
            axes.xaxis.set_major_formatter("{x:g}")
    if data.log_y:
        axes.set_yscale("log")
    if data.equal:
        axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(data.x_label)
    axes.set_ylabel(data.y_label)
    axes.grid(color="0.9")
    axes.set_title(title, fontsize="medium")
    if len(data.curves) > 1:
        axes.legend(frameon=False, fontsize="small")
    figure.savefig(path, dpi=90)


def write_page(path: Path, cases: Mapping[str, Case], model_hash: str, steps_per_second: int) -> list[Path]:
    """Write the page, and beside it the pictures in images/<page's name>/; returns every file written."""
    folder = path.parent / "images" / path.stem
    folder.mkdir(parents=True, exist_ok=True)
    passed = sum(case.result.passed for case in cases.values())
    out = [
        "# Validation",
        "",
        "The solver against closed forms and independent computations. This page is written by `./sixstrut validate --page`; do",
        "not edit it, run the command again. The same cases are tests (`./sixstrut test tests/validation`). They check",
        "the solver against mechanics; they say nothing about how near the model's stand-in numbers are to your robot.",
        "",
        f"**{passed} of {len(cases)} cases hold.** Model `{model_hash}`, {steps_per_second} steps per second. Mass damping ζ is",
        "off unless a case says otherwise. References come from what is named with them, never from the solver, but for the",
        "stability limit (an estimate against a run) and the symmetries (a run against another).",
    ]
    files = [path]
    for topic in TOPICS:
        chosen = {name: cases[name] for name in topic.cases if name in cases}
        if not chosen:
            continue
        out += ["", f"## {topic.title}", "", topic.about, ""]
        rows = []
        for case in chosen.values():
            result = case.result
            values = with_unit(result.measured, result.unit), with_unit(result.reference, result.unit)
            rows.append((case.name, *values, found(result), allowed(result), "holds" if result.passed else "**FAILS**"))
        out.append(table(("case", "measured", "reference", "error", "tolerance", "verdict"), rows, "lrrrrl"))
        out.append("")
        for name, case in chosen.items():
            more = f" {case.note}" if case.note else ""
            out.append(f"* **{case.name}** (`{name}`): {case.checked} *Reference:* {case.source}.{more}")
        for name, case in chosen.items():
            if case.picture is not None:
                if (drawn := picture(case.picture, folder / f"{name}.png", case.name)) is None:
                    continue
                files.append(drawn)
                shown = f"{case.name}: {case.picture.y_label} over {case.picture.x_label}"
                out += ["", f"![{shown}]({folder.relative_to(path.parent)}/{name}.png)"]
    path.write_text("\n".join(out) + "\n", encoding="utf-8")
    return files
