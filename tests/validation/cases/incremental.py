# SPDX-License-Identifier: Apache-2.0
"""The beam's total form against the incremental form.

The incremental form is the textbook VFIFE one, written here from its description and used nowhere else: from one moment to the
next, the element's rigid motion is reversed (a virtual reverse translation and rotation), the small deformation that is left gives
increments of axial force and moments, and these are added to the accumulated ones, which turn with the element.
"""

from dataclasses import replace

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.structure.arrays import Array
from tests.validation.cases.free_body import tumbling
from tests.validation.harness.case import Case, Comparison, Curve, Picture, Setting
from tests.validation.harness.run import Run

SECONDS = 0.2
SAMPLES = 40


def _turn(now: Array, before: Array) -> Array:
    """Rotation vectors (B, 3) of the small rotations from one set of matrices to the next, (B, 3, 3)."""
    d = now @ before.transpose(0, 2, 1)
    return 0.5 * np.stack([d[:, 2, 1] - d[:, 1, 2], d[:, 0, 2] - d[:, 2, 0], d[:, 1, 0] - d[:, 0, 1]], axis=1)


def _along(vectors: Array, e: Array) -> Array:
    return np.asarray((vectors * e).sum(axis=1, keepdims=True))


class _IncrementalBeams:
    """Accumulated axial forces and moments of all beams, and where the beams were."""

    def __init__(self, run: Run):
        e = run.model.elements
        self.first, self.second = e.beam_ends.T
        rest = e.strut_mid_m[e.beam_strut] * e.beam_share
        self.ea, self.ei, self.gj = (value[:, None] / rest[:, None] for value in (e.beam_ea_n, e.beam_ei_n_m2, e.beam_gj_n_m2))
        self.axial = np.zeros((len(rest), 1))
        self.m1, self.m2 = np.zeros((len(rest), 3)), np.zeros((len(rest), 3))
        self.e, self.length, self.r1, self.r2 = self._now(run)

    def _now(self, run: Run) -> tuple[Array, Array, Array, Array]:
        chord, frames = run.x[self.second] - run.x[self.first], run.frames()
        length = np.linalg.norm(chord, axis=1, keepdims=True)
        return chord / length, length, frames[self.first], frames[self.second]

    def loads(self, run: Run) -> Array:
        """Accumulate the increments since the last call; (P, 6) forces and moments on the particles."""
        e, length, r1, r2 = self._now(run)
        turn1, turn2 = _turn(r1, self.r1), _turn(r2, self.r2)
        # the rigid rotation to reverse: the chord's own, and the ends' mean about it
        chord_turn = np.cross(self.e, e)
        mean = 0.5 * _along(turn1 + turn2, e)
        twist = _along(turn2 - turn1, e) * e
        d1, d2 = turn1 - chord_turn, turn2 - chord_turn
        d1, d2 = d1 - _along(d1, e) * e, d2 - _along(d2, e) * e

        def carried(moment: Array) -> Array:
            swung = np.cross(chord_turn, moment)
            swung = moment + swung + np.cross(chord_turn, swung) / (1.0 + _along(self.e, e))
            return np.asarray(swung + mean * np.cross(e, swung))

        self.axial = self.axial + self.ea * (length - self.length)
        self.m1 = carried(self.m1) + self.ei * (4.0 * d1 + 2.0 * d2) - self.gj * twist
        self.m2 = carried(self.m2) + self.ei * (4.0 * d2 + 2.0 * d1) + self.gj * twist
        self.e, self.length, self.r1, self.r2 = e, length, r1, r2
        force = self.axial * e + np.cross(e, self.m1 + self.m2) / length
        out = np.zeros((len(run.x), 6))
        np.add.at(out, self.first, np.hstack([force, -self.m1]))
        np.add.at(out, self.second, np.hstack([-force, -self.m2]))
        return out


def total_against_incremental(setting: Setting) -> Case:
    """The robot twice, floating, tumbling, shaking; the second with the kernel's ropes and time step, but incremental beams."""
    total = tumbling(replace(setting.prototype, strut_elements=1))
    m, lay = total.model, total.model.layout
    twin = Run(m)
    twin.state[:] = total.state
    body = np.delete(m.assembly.body, np.s_[lay.body_beams : lay.body_cables])
    bare = m.assembly._replace(beams=np.zeros((0, 3), dtype=np.int32), body=body)
    pushes = twin.work.reshape(-1, k.WORK_ROWS)[:, k.F : k.M + 3]
    length = setting.prototype.strut_length_m
    start, chunk = total.x.copy(), round(SECONDS / SAMPLES / m.dt_s)
    # both forms begin unstressed, so the increments are counted from there
    beams = _IncrementalBeams(twin)
    times, apart = [], []
    for _ in range(SAMPLES):
        total.advance(chunk)
        for _ in range(chunk):
            k.forces(twin.state, twin.par, twin.work, bare, m.dt_s, twin.reach_m)
            pushes += beams.loads(twin)
            k.integrate(twin.state, twin.par, twin.work, bare, m.dt_s, 0.0)
        times.append(total.step * m.dt_s)
        apart.append(float(np.linalg.norm(total.x - twin.x, axis=1).max()) / length)
    way = float(np.linalg.norm(total.x - start, axis=1).max()) / length
    return Case(
        "beam: total against incremental form",
        "Largest distance, per L, of the particles of two robots, one with each form, floating, tumbling and "
        f"shaking for {SECONDS:g} s.",
        "incremental VFIFE beam (reverse motion, accumulated increments): a second implementation",
        Comparison(max(apart), 0.0, "L", 1e-4, relative=False),
        note=f"The particles move by up to {way:.2g} L; the forms agree to first order in an element's deformation "
        "and rotation per step.",
        picture=Picture(
            "time (s)", "distance between the two robots / L", (Curve("total − incremental", times, apart),), log_y=True
        ),
    )
