# SPDX-License-Identifier: Apache-2.0
"""What a library holds, at a glance: every primitive's strokes, and how often it worked in training."""

from pathlib import Path

import numpy as np

from sim_core.gaits.library import Library
from sim_core.structure.roll_classes import CLASSES
from tensegrity_lab.reports.figure import new_figure, picture_file

SCALE_MM = 45


@picture_file
def library_picture(library: Library, path: Path) -> None:
    """One panel a class: a row of six coloured strokes for each primitive; success on training prototypes, or margin, beside it."""
    figure = new_figure(11, 6.5)
    panels = figure.subplots(1, len(CLASSES))
    image = None
    for axes, (name, rolls) in zip(panels, CLASSES.items(), strict=True):
        chosen = [p for p in library.primitives if p.roll_class is rolls]
        axes.set_title(f"{name}: {len(chosen)} primitives")
        if not chosen:
            axes.set_axis_off()
            continue
        columns = max(len(p.policy) for p in chosen)
        strokes = np.array([p.policy + p.policy[-6:] * ((columns - len(p.policy)) // 6) for p in chosen])
        image = axes.imshow(strokes, cmap="PuOr", vmin=-SCALE_MM, vmax=SCALE_MM, aspect="auto")
        for row, p in enumerate(chosen):
            for strut, value in enumerate(strokes[row]):
                axes.text(
                    strut, row, f"{value:+d}", ha="center", va="center", fontsize=7, color="white" if abs(value) > 28 else "black"
                )
            note = f"{100 * p.margins['success']:.0f} %" if "success" in p.margins else f"{p.margins.get('inside_mm', 0):.0f} mm"
            axes.text(columns - 0.35, row, note, va="center", fontsize=8)
        axes.set_xticks(range(columns), [f"S{place % 6 + 1}" for place in range(columns)])
        axes.set_yticks(range(len(chosen)), [p.name for p in chosen])
        axes.set_xlim(-0.5, columns + 0.6)
    if image is not None:
        figure.colorbar(image, ax=list(panels), label="stroke (mm), + lengthens", shrink=0.8)
    trained = any("success" in p.margins for p in library.primitives)
    right = "success on training prototypes" if trained else "margin of the centre of mass inside its base"
    figure.suptitle(f"Library {library.name}: strokes for the reference pair; right: {right}")
    figure.savefig(path, dpi=110)
