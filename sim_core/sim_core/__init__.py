# SPDX-License-Identifier: Apache-2.0
"""The robot without hardware: its structure, the VFIFE solver, rolls, gaits, and what they do on robots that are a little off.

The names below are the public ones; `examples/` uses nothing else. A name's module is imported when the name is first used, so
`import sim_core` itself costs nothing. Everything else lives in the rooms (`sim_core.rolling`, `sim_core.gaits`, …).

* `Prototype`, `load_prototype`: the numbers of one robot, from a YAML file.
* `Model`, `build_model`, `perturb`: what the solver makes of them; the same robot as it might really have been built.
* `Robot`: a model and its state; `Robot.resting_on(model, "TC6")` settles it on a face.
* `roll`, `RollResult`, `Sample`: one roll, how it is judged, and what it looked like every 10 ms.
* `Job`, `roll_many`: many rolls at once, on all cores.
* `load_library`, `Primitive`, `class_of`, `gait_of`, `rolls_of`: policies, and the 24 gaits that symmetry makes of each.
* `Ensemble`, `Law`: rehearse gaits on perturbed robots.
* `rate_of`: a success rate with its 95 % interval.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim_core.dynamics.model import Model, build_model
    from sim_core.dynamics.robot import Robot
    from sim_core.gaits.library import Primitive, gait_of, load_library
    from sim_core.rolling.batch import Job, roll_many
    from sim_core.rolling.roll import RollResult, Sample, roll
    from sim_core.structure.parameters import Prototype, load_prototype
    from sim_core.structure.roll_classes import class_of, rolls_of
    from sim_core.studies.binomial_intervals import rate_of
    from sim_core.studies.rehearsal import Ensemble
    from sim_core.uncertainty.perturbation_law import Law, perturb

__all__ = [
    "Ensemble",
    "Job",
    "Law",
    "Model",
    "Primitive",
    "Prototype",
    "Robot",
    "RollResult",
    "Sample",
    "build_model",
    "class_of",
    "gait_of",
    "load_library",
    "load_prototype",
    "perturb",
    "rate_of",
    "roll",
    "roll_many",
    "rolls_of",
]

_NAMES = {
    "dynamics.model": ("Model", "build_model"),
    "dynamics.robot": ("Robot",),
    "gaits.library": ("Primitive", "gait_of", "load_library"),
    "rolling.batch": ("Job", "roll_many"),
    "rolling.roll": ("RollResult", "Sample", "roll"),
    "structure.parameters": ("Prototype", "load_prototype"),
    "structure.roll_classes": ("class_of", "rolls_of"),
    "studies.binomial_intervals": ("rate_of",),
    "studies.rehearsal": ("Ensemble",),
    "uncertainty.perturbation_law": ("Law", "perturb"),
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}: public are {', '.join(__all__)}")
    value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
