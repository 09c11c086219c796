# SPDX-License-Identifier: Apache-2.0
"""One simulated robot: a model and its state."""

from __future__ import annotations

import hashlib

import numpy as np

from sim_core.dynamics import vfife as k
from sim_core.dynamics.footing import FACE_JOINTS, FACE_NAMES, Footing, center_of_mass, clearance_m, judge_footing, under
from sim_core.dynamics.model import Model
from sim_core.errors import DivergedError
from sim_core.structure.arrays import Array
from sim_core.structure.elements import face_down
from sim_core.structure.rotations import (
    about_z,
    best_fit,
    down_of,
    matrix_of,
    norm,
    product,
    quaternion_of,
    rotated,
)
from sim_core.structure.topology import JOINTS, NODES, POINTS_PER_JOINT

SETTLE_S = 3.0
SETTLE_ZETA_1_S = 40.0
QUICK = 5.0
"""Struts' speed over their own where a shape is only settled, not moved through."""
"""Near-critical mass damping, for settling on a face only."""


class Robot:
    """State of one robot; every method that changes it says so.

    Attributes:
        model: what it is made of.
        step: steps taken since it was made.
    """

    def __init__(self, model: Model):
        """At rest in the ideal shape at mid stroke, centre at the origin, axes as the body's."""
        self.model = model
        self.step = 0
        lay = model.layout
        self._state = np.zeros(lay.state_rows)
        self._work = np.zeros(model.assembly.particles * k.WORK_ROWS)
        e = model.elements
        self._particles[:, k.X : k.X + 3] = e.position_m
        self._particles[:, k.Q : k.Q + 4] = [quaternion_of(frame) for frame in e.frame]
        self._struts[:, k.REST] = self._struts[:, k.TARGET] = e.strut_mid_m

    @classmethod
    def resting_on(cls, model: Model, face: str, center_m: tuple[float, float] = (0.0, 0.0), yaw_rad: float = 0.0) -> Robot:
        """A robot settled on a face at neutral lengths, its centre of mass above `center_m`.

        Args:
            model: the robot's model.
            face: its name, such as TC6.
            center_m: (x, y) of the centre of mass, in [m].
            yaw_rad: turn about the vertical, from the smallest turn that puts the face down.

        Raises:
            UnknownFaceError, DivergedError.
        """
        robot = cls.placed_on(model, face, yaw_rad)
        m = model
        steps = round(SETTLE_S * m.steps_per_second)
        k.advance(robot._state, m.par, robot._work, m.assembly, m.dt_s, SETTLE_ZETA_1_S, m.reach_m, steps)
        robot.take_settled(*robot.rows(), center_m)
        return robot

    @classmethod
    def standing_on(cls, model: Model, face: str, raw_lengths_m: Array, center_m: tuple[float, float]) -> Robot:
        """A robot settled on a face at these rest lengths (6,), as `targets_m` gives them; at neutral ones if it tips over by them.

        Raises:
            UnknownFaceError, DivergedError.
        """
        neutral = cls.resting_on(model, face, center_m)
        robot, m = neutral.copy(), model
        par, lay = m.par.copy(), m.layout
        par[lay.par_struts : lay.par_struts + 6 * k.STRUT_PAR] *= QUICK
        robot.set_raw_targets(raw_lengths_m)
        steps = round(SETTLE_S * m.steps_per_second)
        k.advance(robot._state, par, robot._work, m.assembly, m.dt_s, SETTLE_ZETA_1_S, m.reach_m, steps)
        robot.take_settled(*robot.rows(), center_m)
        return robot if robot.face_under() == face else neutral

    @classmethod
    def placed_on(cls, model: Model, face: str, yaw_rad: float = 0.0) -> Robot:
        """A robot in the ideal shape, put down on a face, not settled yet. Raises UnknownFaceError."""
        robot = cls(model)
        robot.place(product(about_z(yaw_rad), face_down(face)), np.zeros(3))
        robot._particles[:, k.X + 2] -= robot.contact_points_m()[:, 2].min()
        return robot

    def take_settled(self, state: Array, work: Array, center_m: tuple[float, float] = (0.0, 0.0)) -> None:
        """Take on the rows of a robot that was settled with heavy damping.

        Stops all motion (friction keeps its hold) and puts the centre of mass above `center_m`.
        """
        self._state[:], self._work[:] = state, work
        self._require_finite()
        self._particles[:, k.V : k.V + 3] = 0.0
        self._particles[:, k.S : k.S + 3] = 0.0
        self.reset_peaks()
        shift = np.append(np.asarray(center_m) - self.center_of_mass_m()[:2], 0.0)
        self._particles[:, k.X : k.X + 3] += shift

    def rows(self) -> tuple[Array, Array]:
        """The kernel's state and work rows of this robot (copies)."""
        return self._state.copy(), self._work.copy()

    def arrays(self) -> tuple[Array, Array]:
        """The kernel's state and work rows themselves, for compiled code that goes on with this robot in place."""
        return self._state, self._work

    @property
    def _particles(self) -> Array:
        return self._state[: self.model.layout.struts].reshape(-1, k.PARTICLE_ROWS)

    @property
    def _struts(self) -> Array:
        lay = self.model.layout
        return self._state[lay.struts : lay.contacts].reshape(6, k.STRUT_ROWS)

    def place(self, turn: Array, shift_m: Array) -> None:
        """Turn the whole robot about the origin by a rotation matrix, then shift it. Friction lets go."""
        rows = self._particles
        for at in (k.X, k.V, k.S):
            rows[:, at : at + 3] = rotated(turn, rows[:, at : at + 3])
        rows[:, k.X : k.X + 3] += shift_m
        rows[:, k.Q : k.Q + 4] = [quaternion_of(product(turn, matrix)) for matrix in matrix_of(rows[:, k.Q : k.Q + 4])]
        self._state[self.model.layout.contacts :] = 0.0

    def copy(self) -> Robot:
        """An independent robot in the same state."""
        twin = object.__new__(Robot)
        twin.model, twin.step = self.model, self.step
        twin._state, twin._work = self._state.copy(), self._work.copy()
        return twin

    def set_targets(self, lengths_m: Array) -> None:
        """Command six absolute rest lengths (m); the actuators drive there at constant speed from the next step on."""
        self._struts[:, k.TARGET] = self.model.rest_lengths(lengths_m)

    def set_raw_targets(self, lengths_m: Array) -> None:
        """Set the actuators' own target rest lengths (m), as `targets_m` gives them, without the struts' gains."""
        self._struts[:, k.TARGET] = lengths_m

    def advance(self, steps: int) -> None:
        """Take `steps` time steps.

        Raises:
            DivergedError: the state is no longer finite.
        """
        m = self.model
        k.advance(self._state, m.par, self._work, m.assembly, m.dt_s, m.elements.zeta_1_s, m.reach_m, steps)
        self.step += steps
        self._require_finite()

    def _require_finite(self) -> None:
        if not np.isfinite(self._state).all():
            raise DivergedError(f"the run diverged before step {self.step} ({self.step * self.model.dt_s:.3f} s)")

    def reset_peaks(self) -> None:
        """Forget the largest strut forces seen."""
        self._struts[:, k.PEAK] = 0.0

    def joints_m(self) -> Array:
        """Positions of the twelve joints, (12, 3)."""
        return self._particles[:JOINTS, k.X : k.X + 3].copy()

    def joint_speeds_m_s(self) -> Array:
        """Speeds of the twelve joints, (12,)."""
        return norm(self._particles[:JOINTS, k.V : k.V + 3])

    def box_m(self) -> Array:
        """Position of the control box, (3,)."""
        return self._particles[-1, k.X : k.X + 3].copy()

    def quaternions(self) -> Array:
        """Orientations (w, x, y, z) of the twelve joints and the box, (13, 4)."""
        rows = self._particles[:, k.Q : k.Q + 4]
        return np.concatenate([rows[:JOINTS], rows[-1:]])

    def frames(self) -> Array:
        """Rotation matrices of every particle, (P, 3, 3)."""
        return matrix_of(self._particles[:, k.Q : k.Q + 4])

    def push(self, velocities_m_s: Array) -> None:
        """Add to the velocity of every particle, (P, 3)."""
        self._particles[:, k.V : k.V + 3] += velocities_m_s

    def body_pose(self) -> tuple[Array, Array]:
        """Centre of the twelve joints (3,) and the rotation (3, 3) that best fits them to the ideal shape."""
        joints = self.joints_m()
        return joints.mean(axis=0), best_fit(NODES, joints)

    def contact_points_m(self) -> Array:
        """Positions of the sixty contact points, (60, 3)."""
        frames = matrix_of(self._particles[:JOINTS, k.Q : k.Q + 4])
        points = self.model.elements.contact_point_m.reshape(JOINTS, POINTS_PER_JOINT, 3)
        return (self.joints_m()[:, None, :] + rotated(frames[:, None], points)).reshape(-1, 3)

    def center_of_mass_m(self) -> Array:
        """(3,)."""
        center = np.empty(3)
        center_of_mass(self._state, self.model.elements.mass_kg, center)
        return center

    def rest_lengths_m(self) -> Array:
        """Present rest lengths of the struts, (6,)."""
        return self._struts[:, k.REST].copy()

    def targets_m(self) -> Array:
        """Rest lengths the actuators drive to, (6,)."""
        return self._struts[:, k.TARGET].copy()

    def strut_forces_n(self) -> Array:
        """Axial force of each strut at the last step, tension positive, (6,)."""
        return self._struts[:, k.AXIAL].copy()

    def peak_forces_n(self) -> Array:
        """Largest axial force (magnitude) of each strut since `reset_peaks`, (6,)."""
        return self._struts[:, k.PEAK].copy()

    def ground_forces_n(self) -> Array:
        """Normal force of the ground on each joint at the last step, (12,)."""
        return self._work.reshape(-1, k.WORK_ROWS)[:JOINTS, k.NORMAL].copy()

    def cable_forces_n(self) -> Array:
        """Tension of the 24 tendons and the 24 box ropes in the present shape, (48,)."""
        e = self.model.elements
        x, frames = self._particles[:, k.X : k.X + 3], self.frames()
        ends = [
            x[p] + rotated(frames[p], points)
            for p, points in zip(e.cable_ends.T, (e.cable_point_1_m, e.cable_point_2_m), strict=True)
        ]
        return np.maximum(0.0, e.cable_stiffness_n_m * (norm(ends[1] - ends[0]) - e.cable_rest_m))

    def footing(self) -> Footing:
        """What the robot stands on now."""
        m = self.model
        gravity = m.elements.gravity_m_s2
        carry = m.prototype.carry_fraction * m.weight_n
        down = down_of(gravity)
        return judge_footing(self.joints_m(), self.center_of_mass_m(), self.ground_forces_n(), carry, down)

    def face_under(self) -> str | None:
        """The face that it stands on while it moves, see `footing.under`."""
        down = down_of(self.model.elements.gravity_m_s2)
        face = under(self.joints_m(), self.center_of_mass_m(), down, FACE_JOINTS)
        return FACE_NAMES[face] if face >= 0 else None

    def clearance_m(self) -> float:
        """Smallest gap between surfaces of struts, and of struts and box, now."""
        p = self.model.prototype
        return clearance_m(self.joints_m(), self.box_m(), p.strut_diameter_m, p.box_radius_m)

    def is_slow(self) -> bool:
        """Every joint is slower than the rest speed now."""
        return bool(self.joint_speeds_m_s().max() < self.model.prototype.rest_speed_m_s)

    def digest(self) -> str:
        """sha256 of the state's bytes and the step count, hex: equal digests are equal bits."""
        return hashlib.sha256(self._state.tobytes() + self.step.to_bytes(8, "little")).hexdigest()
