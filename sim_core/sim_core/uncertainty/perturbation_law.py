# SPDX-License-Identifier: Apache-2.0
"""What a robot may differ in from its drawing, and prototypes drawn from that: the law of the robustness study.

Every uncertainty is a group of members (48 ropes, six struts, …), each off by an error that is uniform in ±(width · scale).
Members may share a part of their error (ropes of one batch) and the designs of `sampling` may be low-discrepancy. An error belongs
to (seed, prototype, member): switching a group off leaves all other errors as they are.

`perturb` is an older draw, of one prototype by its seed, for the virtual prototype; the two share no draws.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sim_core.dynamics.model import Model, build_model
from sim_core.errors import ParameterError
from sim_core.structure.arrays import Array
from sim_core.structure.elements import PREVIOUS, Elements
from sim_core.structure.rotations import rotated
from sim_core.structure.topology import JOINTS, POINTS_PER_JOINT
from sim_core.uncertainty.sampling import DESIGNS, INDEPENDENT, correlated, unit_rows


def _factor(name: str) -> Callable[[Elements, Array], Elements]:
    """Errors as factors on a table of the elements."""
    return lambda e, off: replace(e, **{name: getattr(e, name) * (1.0 + off)})


def _slope(e: Elements, off: Array) -> Elements:
    """Tilt the ground further about its x, then about its y axis, as `elements_of` does: gravity turns the other way."""
    x, y = off
    about_x = np.array([[1, 0, 0], [0, math.cos(x), math.sin(x)], [0, -math.sin(x), math.cos(x)]])
    about_y = np.array([[math.cos(y), 0, -math.sin(y)], [0, 1, 0], [math.sin(y), 0, math.cos(y)]])
    return replace(e, gravity_m_s2=rotated(about_y, rotated(about_x, e.gravity_m_s2)))


def _joint_size(e: Elements, off: Array) -> Elements:
    """Every rope's and contact's point of a joint nearer to, or farther from, the node. Ropes stay as they were cut."""
    size = np.ones(len(e.mass_kg))
    size[:JOINTS] += off
    return replace(
        e,
        cable_point_1_m=e.cable_point_1_m * size[e.cable_ends[:, 0], None],
        cable_point_2_m=e.cable_point_2_m * size[e.cable_ends[:, 1], None],
        contact_point_m=e.contact_point_m * np.repeat(size[:JOINTS], POINTS_PER_JOINT)[:, None],
    )


def _payload(e: Elements, off: Array) -> Elements:
    """Move the box's centre of mass inside it: its lugs stay where they were. Inertia and clearance sphere move too."""
    box = len(e.mass_kg) - 1
    position, own = e.position_m.copy(), rotated(e.frame[box].T, off)
    position[box] += off
    points = [
        np.where(e.cable_ends[:, [end]] == box, points_m - own, points_m)
        for end, points_m in enumerate((e.cable_point_1_m, e.cable_point_2_m))
    ]
    return replace(e, position_m=position, cable_point_1_m=points[0], cable_point_2_m=points[1])


class Group(NamedTuple):
    """One uncertainty.

    Attributes:
        width: half range of the error per unit of scale.
        what: in words, with its range at scale s.
        members: how many errors a robot has.
        batch: how many of these, from the first, are of one batch and may be correlated.
        source: whose range it is.
        apply: (elements, errors (members,)) -> elements.
    """

    width: float
    what: str
    members: Callable[[Elements], int]
    batch: Callable[[Elements], int]
    source: str
    apply: Callable[[Elements, Array], Elements]


def _count(number: int) -> Callable[[Elements], int]:
    return lambda e: number


def _ropes(e: Elements) -> int:
    return len(e.cable_ends)


def _masses(e: Elements) -> int:
    return len(e.mass_kg)


def _nodes(e: Elements) -> int:
    return len(e.mass_kg) - 1


AGREED, OURS = "agreed", "stand-in"
GROUPS: dict[str, Group] = {
    "stiffness": Group(1.0, "each rope's stiffness ±s", _ropes, _ropes, AGREED, _factor("cable_stiffness_n_m")),
    "rest_length": Group(0.17, "each rope's rest length ±0.17 s", _ropes, _ropes, AGREED, _factor("cable_rest_m")),
    "mass": Group(1.0, "each node's and the box's mass ±s", _masses, _nodes, AGREED, _factor("mass_kg")),
    "stroke": Group(0.5, "each strut's stroke ±s/2", _count(6), _count(6), AGREED, _factor("strut_gain")),
    "friction": Group(2.0, "friction ±2 s, both coefficients together", _count(1), _count(0), AGREED, _factor("friction")),
    "slope": Group(0.1, "slope ±0.1 s rad about each axis", _count(2), _count(0), AGREED, _slope),
    "joint_size": Group(
        1.0, "each joint's rope and contact points ±s from its node", _count(JOINTS), _count(JOINTS), OURS, _joint_size
    ),
    "payload": Group(0.05, "the box's centre of mass ±0.05 s m along each of its axes", _count(3), _count(0), OURS, _payload),
}
"""Every uncertainty, all uniform. The order is that of the draws: append, never insert."""
JUDGED = ("stiffness", "rest_length", "mass", "stroke", "friction")
"""The agreed law of judgement."""
MAX_SCALE = 0.3
"""Beyond it some prototypes would need a smaller time step, or have slack ropes."""
MAX_INCLINE_DEG = 20.0
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
INCLINE_STREAM = 25
"""Sets the directions of inclines apart from other uses of the same seed."""
IMPROVED_ONLY = ("joint_size", "payload")
"""The previous model's joints and box are points."""


def groups_of(words: str) -> tuple[str, ...]:
    """Names of uncertainties from words with commas: `judged`, `all`, a name, or −name to take one out. Raises ParameterError."""
    chosen: list[str] = []
    for word in filter(None, (word.strip() for word in words.split(","))):
        names = {"judged": JUDGED, "all": tuple(GROUPS)}.get(word.removeprefix("-"), (word.removeprefix("-"),))
        if not set(names) <= GROUPS.keys():
            raise ParameterError(f"unknown uncertainty {word!r}: valid are judged, all, {', '.join(GROUPS)}, and - before any")
        chosen = [name for name in chosen if name not in names] + ([] if word.startswith("-") else list(names))
    return tuple(name for name in GROUPS if name in chosen)


@dataclass(frozen=True)
class Law:
    """How prototypes differ.

    Attributes:
        scale: s, 0.1 for ±10 %.
        groups: names of the uncertainties that are on.
        correlation: of the members of a batch, in [0, 1): that of the normal variates of a Gaussian copula; ranges stay uniform.
        design: INDEPENDENT or SOBOL (scrambled, seeded).
        incline_deg: besides, the ground is inclined by this much; downhill is another direction for every prototype, all round.
    """

    scale: float = 0.05
    groups: tuple[str, ...] = JUDGED
    correlation: float = 0.0
    design: str = INDEPENDENT
    incline_deg: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.scale <= MAX_SCALE:
            raise ParameterError(f"perturbation scale {self.scale!r}: valid is a number in [0, {MAX_SCALE}]")
        unknown = [name for name in self.groups if name not in GROUPS]
        if unknown:
            raise ParameterError(f"unknown uncertainty {unknown[0]!r}: valid are {', '.join(GROUPS)}")
        if not 0.0 <= self.correlation < 1.0:
            raise ParameterError(f"correlation {self.correlation!r}: valid is a number in [0, 1)")
        if self.design not in DESIGNS:
            raise ParameterError(f"unknown design {self.design!r}: valid are {', '.join(DESIGNS)}")
        if not 0.0 <= self.incline_deg <= MAX_INCLINE_DEG:
            raise ParameterError(f"incline {self.incline_deg!r} degrees: valid is a number in [0, {MAX_INCLINE_DEG}]")
        object.__setattr__(self, "groups", tuple(name for name in GROUPS if name in self.groups))

    def only(self, group: str) -> Law:
        """The law with this uncertainty alone."""
        return replace(self, groups=(group,))

    def without(self, group: str) -> Law:
        """The law without this uncertainty."""
        return replace(self, groups=tuple(name for name in self.groups if name != group))

    @property
    def symmetric(self) -> bool:
        """Whether a robot and its images under the symmetry group are equally likely. A slope within a square is not."""
        return "slope" not in self.groups

    @property
    def brief(self) -> str:
        """The law in a few words: "±10 %"; what that means of each part is told in the documentation, Perturbed prototypes."""
        groups = "" if self.groups == JUDGED else f" in {', '.join(self.groups) or 'nothing'}"
        shared = f", batches correlated by {self.correlation:g}" if self.correlation else ""
        incline = f", ground inclined by {self.incline_deg:g}°" if self.incline_deg else ""
        return f"±{100 * self.scale:g} %{groups}{shared}{incline}"

    @property
    def text(self) -> str:
        """The law, for people and for provenance."""
        text = f"uniform at scale s = {self.scale:g}: " + (", ".join(GROUPS[name].what for name in self.groups) or "nothing")
        shared = f"members of a batch correlated by {self.correlation:g}" if self.correlation else "independent"
        incline = f"; ground inclined by {self.incline_deg:g} degrees, downhill all round" if self.incline_deg else ""
        return f"{text}; {shared}; {self.design} design{incline}"


def errors_of(model: Model, law: Law, seed: int, indices: Sequence[int]) -> dict[str, Array]:
    """The errors of prototypes `indices`, for all groups, on or off: name -> (len(indices), members), in the group's unit.

    Raises:
        ParameterError: a negative seed or index.
    """
    if seed < 0 or any(index < 0 for index in indices):
        raise ParameterError(f"seed {seed!r}, prototype {min(indices, default=0)!r}: valid are whole numbers of 0 or more")
    e = model.elements
    sizes = {name: group.members(e) for name, group in GROUPS.items()}
    rows = unit_rows(law.design, sum(sizes.values()) + len(GROUPS), seed, indices)
    members, shared = rows[:, : -len(GROUPS)], rows[:, -len(GROUPS) :]
    found, at = {}, 0
    for number, (name, group) in enumerate(GROUPS.items()):
        own = members[:, at : at + sizes[name]]
        batch = group.batch(e)
        if law.correlation and batch:
            own = np.hstack([correlated(own[:, :batch], shared[:, number], law.correlation), own[:, batch:]])
        found[name] = group.width * law.scale * (2.0 * own - 1.0)
        at += sizes[name]
    return found


def prototype_of(model: Model, law: Law, errors: Mapping[str, Array]) -> Model:
    """The model with these errors, (members,) per group; only the law's groups are applied. Raises ParameterError, ModelError."""
    if law.scale == 0.0 or not law.groups:
        return model
    impossible = [name for name in law.groups if name in IMPROVED_ONLY] if model.kind == PREVIOUS else []
    if impossible:
        raise ParameterError(
            f"the previous model's joints and box are points: {impossible[0]} cannot vary; valid are "
            f"{', '.join(name for name in GROUPS if name not in IMPROVED_ONLY)}"
        )
    elements = model.elements
    for name in law.groups:
        elements = GROUPS[name].apply(elements, errors[name])
    return build_model(model.prototype, elements)


def sample_at(model: Model, law: Law, seed: int, indices: Sequence[int]) -> list[Model]:
    """Prototypes `indices` of the endless row that (model, law, seed) stands for: each the same in whatever company it is drawn."""
    errors = errors_of(model, law, seed, indices)
    found = [prototype_of(model, law, {name: rows[k] for name, rows in errors.items()}) for k in range(len(indices))]
    if law.incline_deg == 0.0:
        return found
    return [inclined(prototype, law.incline_deg, seed, index) for prototype, index in zip(found, indices, strict=True)]


def inclined(model: Model, incline_deg: float, seed: int, index: int = 0) -> Model:
    """On inclined ground. Directions of consecutive prototypes are spread by the golden ratio; the seed turns them all."""
    share = (GOLDEN * (index + 1) + np.random.default_rng([seed, INCLINE_STREAM]).random()) % 1.0
    return inclined_towards(model, incline_deg, 2.0 * math.pi * share)


def inclined_towards(model: Model, incline_deg: float, downhill_rad: float) -> Model:
    """On ground that goes down in a direction on the floor."""
    slope = math.radians(incline_deg) * np.array([-math.sin(downhill_rad), math.cos(downhill_rad)])
    return build_model(model.prototype, _slope(model.elements, slope))


def sample(model: Model, law: Law, count: int, seed: int) -> list[Model]:
    """The first `count` prototypes of (model, law, seed).

    Raises:
        ParameterError: see Law and `errors_of`.
        ModelError: a prototype that cannot be built, e.g. because its time step would be unstable.
    """
    return sample_at(model, law, seed, range(count))


def perturb(model: Model, scale: float, seed: int) -> Model:
    """A copy of the model with every member of the judged groups off by its own random error; scale 0.1 is ±10 %.

    Same seed and model, same prototype; scale 0 is the model itself.

    Raises:
        ParameterError: a scale outside [0, MAX_SCALE], or a negative seed.
    """
    Law(scale)  # raises
    if seed < 0:
        raise ParameterError(f"perturbation seed {seed!r}: valid is a whole number of 0 or more")
    if scale == 0.0:
        return model
    rng, elements = np.random.default_rng(seed), model.elements
    for group in (GROUPS[name] for name in JUDGED):
        elements = group.apply(elements, group.width * scale * rng.uniform(-1.0, 1.0, group.members(elements)))
    return build_model(model.prototype, elements)
