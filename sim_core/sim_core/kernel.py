"""The VFIFE step: particles joined by massless beams and cables, rigid joints, Coulomb contact, explicit leapfrog.

Everything about one robot is two flat columns of rows, `state` (changes) and `par` (does not), cut up by `Layout`; a row is one
robot's number or eight robots' (see `lanes`). The topology is small integer tables. A step is

1. struts drive their rest lengths towards their targets at constant speed,
2. forces: beams, cables, contacts, gravity,
3. half-step velocities and spatial spins, then positions and orientations.

Formulas (symbols as in docs/model.md):

* beam: elastic potential U = EA/2l0 (l − l0)² + EI/l0 · 2(θ1·θ1 + θ1·θ2 + θ2·θ2) + GJ/2l0 φ² with θi = e × aᵢ, the small
  rotation from the chord e
  to the end's axis aᵢ, and φ the twist; forces and moments are its exact derivatives, so a free body keeps energy, momentum and
  angular momentum. To first order they are mᵢ = (EI/l0)(4θᵢ + 2θⱼ) ± (GJ/l0) φ e and f₂ = N e + e × (m₁ + m₂)/l.
* cable: max(0, k (l − l0)) between slave points of two rigid bodies.
* contact: N = max(0, k_n δ − c_n v_n); a tangential spring-damper sticks while |F_t| ≤ μ_s N, then slides with μ_k N until the
  spring-damper's own force falls below that.
* rotation: spatial spin s advanced by the moment; ω = R I⁻¹ Rᵀ s at mid-step; orientation by the Cayley map (order 2, no
  trigonometry).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_core.lanes import add_to, any_of, larger, load, root, select, smaller, store

# Rows of one particle in `state`: position, half-step velocity, orientation quaternion (w x y z), half-step spatial spin.
X, V, Q, S, PARTICLE_ROWS = 0, 3, 6, 10, 13
# Rows of one particle in `par`: Δt/mass, 1/inertia about its own axes, weight (force of gravity).
DT_M, INV_I, WEIGHT, PARTICLE_PAR = 0, 1, 4, 7
# Rows of one strut in `state`: rest length, target rest length, largest axial force (magnitude) since it was last zeroed,
# axial force now.
REST, TARGET, PEAK, AXIAL, STRUT_ROWS = 0, 1, 2, 3, 4
# Rows of one strut in `par`: largest change of rest length in a step.
STRUT_PAR = 1
# Rows of one beam in `par`: EA, EI, GJ, its share of the strut's rest length.
EA, EI, GJ, SHARE, BEAM_PAR = 0, 1, 2, 3, 4
# Rows of one cable in `par`: stiffness, rest length, slave points in the two bodies' frames.
K, L0, R1, R2, CABLE_PAR = 0, 1, 2, 5, 8
# Rows of one contact point in `state`: tangential spring stretch, 1 while sliding. In `par`: the point in its joint's frame.
U, SLIDING, CONTACT_ROWS, CONTACT_PAR = 0, 2, 3, 3
# Rows of the ground in `par`.
KN, CN, KT, CT, MU_S, MU_K, GROUND_PAR = 0, 1, 2, 3, 4, 5, 6
# Rows of one particle in `work`: rotation matrix (row-major), force, moment, normal ground force.
R, F, M, NORMAL, WORK_ROWS = 0, 9, 12, 15, 16

JOINTS = 12
POINTS_PER_JOINT = 5
CONTACTS = JOINTS * POINTS_PER_JOINT


class Topology(NamedTuple):
    """Which particles each element joins.

    Attributes:
        beams: int32 (n_beams, 3): particle 1, particle 2, strut.
        cables: int32 (n_cables, 2): particle 1, particle 2. The first 24 are the tendons, the next 24 the box's ropes.
        particles: number of particles: twelve joints, the struts' inner particles, the box last.
    """

    beams: NDArray[np.int32]
    cables: NDArray[np.int32]
    particles: int


class Layout(NamedTuple):
    """First row of each table in `state` and `par`."""

    struts: int
    contacts: int
    state_rows: int
    par_struts: int
    par_beams: int
    par_cables: int
    par_contacts: int
    par_ground: int
    par_rows: int


@njit(cache=True)
def layout(particles, n_beams, n_cables):
    """Layout for the given counts (six struts, sixty contact points)."""
    struts = particles * PARTICLE_ROWS
    contacts = struts + 6 * STRUT_ROWS
    state_rows = contacts + CONTACTS * CONTACT_ROWS
    par_struts = particles * PARTICLE_PAR
    par_beams = par_struts + 6 * STRUT_PAR
    par_cables = par_beams + n_beams * BEAM_PAR
    par_contacts = par_cables + n_cables * CABLE_PAR
    par_ground = par_contacts + CONTACTS * CONTACT_PAR
    return Layout(
        struts,
        contacts,
        state_rows,
        par_struts,
        par_beams,
        par_cables,
        par_contacts,
        par_ground,
        par_ground + GROUND_PAR,
    )


@njit(cache=True)
def _cross(ax, ay, az, bx, by, bz):
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True)
def _rotated(work, w, x, y, z):
    """R (x, y, z) with the rotation matrix at row `w`."""
    return (
        load(work, w) * x + load(work, w + 1) * y + load(work, w + 2) * z,
        load(work, w + 3) * x + load(work, w + 4) * y + load(work, w + 5) * z,
        load(work, w + 6) * x + load(work, w + 7) * y + load(work, w + 8) * z,
    )


@njit(cache=True)
def _push(work, w, fx, fy, fz, mx, my, mz):
    """Add a force and a moment to the particle whose work rows start at `w`."""
    add_to(work, w + F, fx)
    add_to(work, w + F + 1, fy)
    add_to(work, w + F + 2, fz)
    add_to(work, w + M, mx)
    add_to(work, w + M + 1, my)
    add_to(work, w + M + 2, mz)


@njit(cache=True)
def _matrix(qw, qx, qy, qz):
    """Rotation matrix of a unit quaternion, row-major."""
    return (
        1.0 - 2.0 * (qy * qy + qz * qz),
        2.0 * (qx * qy - qw * qz),
        2.0 * (qx * qz + qw * qy),
        2.0 * (qx * qy + qw * qz),
        1.0 - 2.0 * (qx * qx + qz * qz),
        2.0 * (qy * qz - qw * qx),
        2.0 * (qx * qz - qw * qy),
        2.0 * (qy * qz + qw * qx),
        1.0 - 2.0 * (qx * qx + qy * qy),
    )


@njit(cache=True)
def _put_matrix(work, w, matrix):
    """Store a rotation matrix at row `w`."""
    for i in range(9):
        store(work, w + i, matrix[i])


@njit(cache=True)
def _beam(state, par, work, p1, p2, rest, b):
    """Forces of one beam; returns its axial force (tension positive)."""
    x1, x2 = p1 * PARTICLE_ROWS + X, p2 * PARTICLE_ROWS + X
    w1, w2 = p1 * WORK_ROWS, p2 * WORK_ROWS
    ex, ey, ez = (
        load(state, x2) - load(state, x1),
        load(state, x2 + 1) - load(state, x1 + 1),
        load(state, x2 + 2) - load(state, x1 + 2),
    )
    length = root(ex * ex + ey * ey + ez * ez)
    ex, ey, ez = ex / length, ey / length, ez / length
    # section axes of both ends: a along the strut, b and c across it
    a1x, a1y, a1z = load(work, w1 + R), load(work, w1 + R + 3), load(work, w1 + R + 6)
    b1x, b1y, b1z = load(work, w1 + R + 1), load(work, w1 + R + 4), load(work, w1 + R + 7)
    c1x, c1y, c1z = load(work, w1 + R + 2), load(work, w1 + R + 5), load(work, w1 + R + 8)
    a2x, a2y, a2z = load(work, w2 + R), load(work, w2 + R + 3), load(work, w2 + R + 6)
    b2x, b2y, b2z = load(work, w2 + R + 1), load(work, w2 + R + 4), load(work, w2 + R + 7)
    c2x, c2y, c2z = load(work, w2 + R + 2), load(work, w2 + R + 5), load(work, w2 + R + 8)
    axial = load(par, b + EA) * (length - rest) / rest
    bend = 2.0 * load(par, b + EI) / rest
    # dU/dθi
    t1x, t1y, t1z = _cross(ex, ey, ez, a1x, a1y, a1z)
    t2x, t2y, t2z = _cross(ex, ey, ez, a2x, a2y, a2z)
    m1x, m1y, m1z = bend * (2.0 * t1x + t2x), bend * (2.0 * t1y + t2y), bend * (2.0 * t1z + t2z)
    m2x, m2y, m2z = bend * (2.0 * t2x + t1x), bend * (2.0 * t2y + t1y), bend * (2.0 * t2z + t1z)
    # force on end 2: N e + (1 − e eᵀ) Σ aᵢ × mᵢ / l, negated derivative of U with respect to its position
    g1x, g1y, g1z = _cross(a1x, a1y, a1z, m1x, m1y, m1z)
    g2x, g2y, g2z = _cross(a2x, a2y, a2z, m2x, m2y, m2z)
    gx, gy, gz = g1x + g2x, g1y + g2y, g1z + g2z
    along = ex * gx + ey * gy + ez * gz
    fx = axial * ex + (gx - along * ex) / length
    fy = axial * ey + (gy - along * ey) / length
    fz = axial * ez + (gz - along * ez) / length
    # moment that end i feels: −[(e·aᵢ) mᵢ − (aᵢ·mᵢ) e], and the twist's share
    twist = 0.25 * load(par, b + GJ) / rest * (b2x * c1x + b2y * c1y + b2z * c1z - c2x * b1x - c2y * b1y - c2z * b1z)
    h1x, h1y, h1z = _cross(b2x, b2y, b2z, c1x, c1y, c1z)
    h2x, h2y, h2z = _cross(b1x, b1y, b1z, c2x, c2y, c2z)
    hx, hy, hz = twist * (h1x + h2x), twist * (h1y + h2y), twist * (h1z + h2z)
    d1 = ex * a1x + ey * a1y + ez * a1z
    d2 = ex * a2x + ey * a2y + ez * a2z
    n1 = a1x * m1x + a1y * m1y + a1z * m1z
    n2 = a2x * m2x + a2y * m2y + a2z * m2z
    _push(work, w1, fx, fy, fz, hx - d1 * m1x + n1 * ex, hy - d1 * m1y + n1 * ey, hz - d1 * m1z + n1 * ez)
    _push(work, w2, -fx, -fy, -fz, -hx - d2 * m2x + n2 * ex, -hy - d2 * m2y + n2 * ey, -hz - d2 * m2z + n2 * ez)
    return axial


@njit(cache=True)
def _cable(state, par, work, p1, p2, c):
    """Forces of one cable between slave points of two rigid bodies."""
    x1, x2 = p1 * PARTICLE_ROWS + X, p2 * PARTICLE_ROWS + X
    w1, w2 = p1 * WORK_ROWS, p2 * WORK_ROWS
    r1x, r1y, r1z = _rotated(work, w1, load(par, c + R1), load(par, c + R1 + 1), load(par, c + R1 + 2))
    r2x, r2y, r2z = _rotated(work, w2, load(par, c + R2), load(par, c + R2 + 1), load(par, c + R2 + 2))
    dx = load(state, x2) + r2x - load(state, x1) - r1x
    dy = load(state, x2 + 1) + r2y - load(state, x1 + 1) - r1y
    dz = load(state, x2 + 2) + r2z - load(state, x1 + 2) - r1z
    length = root(dx * dx + dy * dy + dz * dz)
    pull = larger(0.0, load(par, c + K) * (length - load(par, c + L0))) / length
    fx, fy, fz = pull * dx, pull * dy, pull * dz
    m1x, m1y, m1z = _cross(r1x, r1y, r1z, fx, fy, fz)
    m2x, m2y, m2z = _cross(r2x, r2y, r2z, fx, fy, fz)
    _push(work, w1, fx, fy, fz, m1x, m1y, m1z)
    _push(work, w2, -fx, -fy, -fz, -m2x, -m2y, -m2z)


@njit(cache=True)
def _contact(state, par, work, p, wx, wy, wz, rx, ry, rz, height, row, ground, dt):
    """Forces of the ground on one contact point at arm (rx, ry, rz) of joint `p`, which turns with (wx, wy, wz)."""
    x, w = p * PARTICLE_ROWS, p * WORK_ROWS
    vx, vy, vz = _cross(wx, wy, wz, rx, ry, rz)
    vx, vy, vz = vx + load(state, x + V), vy + load(state, x + V + 1), vz + load(state, x + V + 2)
    normal = larger(0.0, -load(par, ground + KN) * height - load(par, ground + CN) * vz)
    normal = select(height < 0.0, normal, 0.0)
    stiffness, damping = load(par, ground + KT), load(par, ground + CT)
    # trial force of the tangential spring-damper
    ux, uy = load(state, row + U) + dt * vx, load(state, row + U + 1) + dt * vy
    tx, ty = -stiffness * ux - damping * vx, -stiffness * uy - damping * vy
    trial = root(tx * tx + ty * ty)
    sliding = load(state, row + SLIDING)
    limit = select(sliding > 0.5, load(par, ground + MU_K), load(par, ground + MU_S)) * normal
    slides = trial > limit
    scale = select(slides, load(par, ground + MU_K) * normal / larger(trial, 1e-30), 1.0)
    tx, ty = scale * tx, scale * ty
    touching = normal > 0.0
    # a sliding spring is kept at the stretch that carries its force, so that it sticks again without a jump
    store(state, row + U, select(touching, select(slides, -(tx + damping * vx) / stiffness, ux), 0.0))
    store(state, row + U + 1, select(touching, select(slides, -(ty + damping * vy) / stiffness, uy), 0.0))
    store(state, row + SLIDING, select(touching, select(slides, 1.0, 0.0), 0.0))
    tx, ty = select(touching, tx, 0.0), select(touching, ty, 0.0)
    # the point pressed onto the plane carries the force
    mx, my, mz = _cross(rx, ry, rz, tx, ty, normal)
    _push(work, w, tx, ty, normal, mx, my, mz)
    add_to(work, w + NORMAL, normal)


@njit(cache=True)
def _spin_to_turn(par, work, p, sx, sy, sz):
    """ω = R I⁻¹ Rᵀ s with the rotation matrix in `work`."""
    w, i = p * WORK_ROWS, p * PARTICLE_PAR + INV_I
    bx = (load(work, w) * sx + load(work, w + 3) * sy + load(work, w + 6) * sz) * load(par, i)
    by = (load(work, w + 1) * sx + load(work, w + 4) * sy + load(work, w + 7) * sz) * load(par, i + 1)
    bz = (load(work, w + 2) * sx + load(work, w + 5) * sy + load(work, w + 8) * sz) * load(par, i + 2)
    return _rotated(work, w, bx, by, bz)


@njit(cache=True)
def _drive(state, par, struts, par_struts):
    """Every strut moves its rest length towards its target, at most its speed × Δt, and stops there."""
    for s in range(6):
        row = struts + s * STRUT_ROWS
        most = load(par, par_struts + s * STRUT_PAR)
        rest, target = load(state, row + REST), load(state, row + TARGET)
        gap = target - rest
        arrives = smaller(gap, -gap) >= -most
        store(state, row + REST, select(arrives, target, rest + select(gap > 0.0, most, -most)))


@njit(cache=True)
def forces(state, par, work, topology, dt, reach):
    """Write rotation matrices, forces and moments of every particle into `work`; update friction and axial forces in `state`.

    Args:
        reach: no contact point of a joint is farther than this from the joint (m); joints higher than it are skipped.
    """
    beams, cables, particles = topology
    lay = layout(particles, beams.shape[0], cables.shape[0])
    for p in range(particles):
        x, w = p * PARTICLE_ROWS, p * WORK_ROWS
        _put_matrix(work, w, _matrix(load(state, x + Q), load(state, x + Q + 1), load(state, x + Q + 2), load(state, x + Q + 3)))
        for axis in range(3):
            store(work, w + F + axis, load(par, p * PARTICLE_PAR + WEIGHT + axis))
            store(work, w + M + axis, 0.0)
        store(work, w + NORMAL, 0.0)
    for b in range(beams.shape[0]):
        strut = lay.struts + beams[b, 2] * STRUT_ROWS
        row = lay.par_beams + b * BEAM_PAR
        axial = _beam(state, par, work, beams[b, 0], beams[b, 1], load(state, strut + REST) * load(par, row + SHARE), row)
        store(state, strut + AXIAL, axial)
        store(state, strut + PEAK, larger(load(state, strut + PEAK), larger(axial, -axial)))
    for c in range(cables.shape[0]):
        _cable(state, par, work, cables[c, 0], cables[c, 1], lay.par_cables + c * CABLE_PAR)
    for p in range(JOINTS):
        x = p * PARTICLE_ROWS
        if any_of(load(state, x + X + 2) < reach):
            wx, wy, wz = _spin_to_turn(par, work, p, load(state, x + S), load(state, x + S + 1), load(state, x + S + 2))
            for k in range(POINTS_PER_JOINT):
                point = p * POINTS_PER_JOINT + k
                at, row = lay.par_contacts + point * CONTACT_PAR, lay.contacts + point * CONTACT_ROWS
                w = p * WORK_ROWS
                rx, ry, rz = _rotated(work, w, load(par, at), load(par, at + 1), load(par, at + 2))
                height = load(state, x + X + 2) + rz
                if any_of(height < 0.0):
                    _contact(state, par, work, p, wx, wy, wz, rx, ry, rz, height, row, lay.par_ground, dt)
                else:  # as a contact that does not touch leaves it
                    for i in range(CONTACT_ROWS):
                        store(state, row + i, 0.0)


@njit(cache=True)
def integrate(state, par, work, particles, dt, zeta):
    """Half-step velocities and spins from the forces, then positions and orientations (central difference, leapfrog form)."""
    gain = 1.0 / (1.0 + 0.5 * zeta * dt)
    keep = (1.0 - 0.5 * zeta * dt) * gain
    for p in range(particles):
        x, w = p * PARTICLE_ROWS, p * WORK_ROWS
        push = load(par, p * PARTICLE_PAR + DT_M) * gain
        for axis in range(3):
            velocity = keep * load(state, x + V + axis) + push * load(work, w + F + axis)
            store(state, x + V + axis, velocity)
            add_to(state, x + X + axis, dt * velocity)
            store(state, x + S + axis, keep * load(state, x + S + axis) + gain * dt * load(work, w + M + axis))
        sx, sy, sz = load(state, x + S), load(state, x + S + 1), load(state, x + S + 2)
        qw, qx, qy, qz = load(state, x + Q), load(state, x + Q + 1), load(state, x + Q + 2), load(state, x + Q + 3)
        # ω with R at mid-step: half a step with the ω of now, then the full step with that ω
        wx, wy, wz = _spin_to_turn(par, work, p, sx, sy, sz)
        hw, hx, hy, hz = turned(qw, qx, qy, qz, wx, wy, wz, 0.25 * dt)
        _put_matrix(work, w, _matrix(hw, hx, hy, hz))
        wx, wy, wz = _spin_to_turn(par, work, p, sx, sy, sz)
        qw, qx, qy, qz = turned(qw, qx, qy, qz, wx, wy, wz, 0.5 * dt)
        store(state, x + Q, qw)
        store(state, x + Q + 1, qx)
        store(state, x + Q + 2, qy)
        store(state, x + Q + 3, qz)


@njit(cache=True)
def turned(qw, qx, qy, qz, wx, wy, wz, half):
    """The quaternion turned by the spatial angular velocity for 2·half seconds: Cayley map, normalised."""
    ax, ay, az = half * wx, half * wy, half * wz
    nw = qw - ax * qx - ay * qy - az * qz
    nx = qx + ax * qw + ay * qz - az * qy
    ny = qy + ay * qw + az * qx - ax * qz
    nz = qz + az * qw + ax * qy - ay * qx
    scale = 1.0 / root(nw * nw + nx * nx + ny * ny + nz * nz)
    return nw * scale, nx * scale, ny * scale, nz * scale


@njit(cache=True)
def advance(state, par, work, topology, dt, zeta, reach, steps):
    """Take `steps` steps of `dt` seconds in place."""
    lay = layout(topology.particles, topology.beams.shape[0], topology.cables.shape[0])
    for _ in range(steps):
        _drive(state, par, lay.struts, lay.par_struts)
        forces(state, par, work, topology, dt, reach)
        integrate(state, par, work, topology.particles, dt, zeta)
