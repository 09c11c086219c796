# SPDX-License-Identifier: Apache-2.0
"""The VFIFE step: particles joined by massless beams and cables, rigid joints, Coulomb contact, explicit leapfrog.

One robot is three flat columns of rows, cut up by `Layout`: `state` (changes), `par` (its own masses, ropes, strut speeds,
ground and gravity) and the `body` of its `Assembly` (where things are tied, section stiffnesses, inertias). A row is one robot's
number or eight robots' (see `simd`); eight robots of the same body share one column of it. A step is

1. struts drive their rest lengths towards their targets at constant speed,
2. forces: beams, cables, contacts, gravity,
3. half-step velocities and spatial spins, then positions and orientations.

Formulas (symbols as in docs/model.md):

* beam: elastic potential U = EA/2l0 (l − l0)² + EI/l0 · 2(θ1·θ1 + θ1·θ2 + θ2·θ2) + GJ/2l0 φ² with θi = e × aᵢ, the small
  rotation from the chord e to the end's axis aᵢ, and φ the twist; forces and moments are its exact derivatives, so a free body
  keeps energy, momentum and angular momentum. To first order they are mᵢ = (EI/l0)(4θᵢ + 2θⱼ) ± (GJ/l0) φ e and
  f₂ = N e + e × (m₁ + m₂)/l.
* cable: max(0, k (l − l0)) between slave points of two rigid bodies.
* contact: N = max(0, k_n δ − c_n v_n); a tangential spring-damper sticks while |F_t| ≤ μ_s N, then slides with μ_k N until the
  spring-damper's own force falls below that.
* rotation: spatial spin s advanced by the moment; ω = R I⁻¹ Rᵀ s at mid-step (s / I where inertias are isotropic); orientation by
  the Cayley map (order 2, no trigonometry).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_core.dynamics.jit_cache import njit
from sim_core.dynamics.simd import add_to, any_of, larger, load, root, select, smaller, store
from sim_core.structure.arrays import Array
from sim_core.structure.topology import JOINTS, POINTS_PER_JOINT

# Rows of one particle in `state`: position, half-step velocity, orientation quaternion (w x y z), half-step spatial spin.
X, V, Q, S, PARTICLE_ROWS = 0, 3, 6, 10, 13
# Rows of one particle in `par`: Δt / mass (fictitious in the previous model), mass that gravity pulls at. In `body`: 1 / inertia
# about its own axes.
DT_M, MASS, PARTICLE_PAR = 0, 1, 2
INERTIA_ROWS = 3
# Rows of one strut in `state`: rest length, target rest length, largest axial force (magnitude) since it was last zeroed,
# axial force now.
REST, TARGET, PEAK, AXIAL, STRUT_ROWS = 0, 1, 2, 3, 4
# Rows of one strut in `par`: largest change of rest length in a step.
STRUT_PAR = 1
# Rows of one beam in `body`: EA, EI, GJ, its share of the strut's rest length.
EA, EI, GJ, SHARE, BEAM_ROWS = 0, 1, 2, 3, 4
# Rows of one cable in `par`: stiffness, rest length. In `body`: slave points in the two particles' frames.
K, L0, CABLE_PAR = 0, 1, 2
R1, R2, CABLE_ROWS = 0, 3, 6
# Rows of one contact point in `state`: tangential spring stretch, 1 while sliding. In `body`: the point in its joint's frame.
U, SLIDING, CONTACT_ROWS, POINT_ROWS = 0, 2, 3, 3
# Rows of the ground in `par`.
KN, CN, KT, CT, MU_S, MU_K, PER_KT, GROUND_PAR = 0, 1, 2, 3, 4, 5, 6, 7
# Rows of one particle in `work`: rotation matrix (row-major), force, moment, normal ground force.
R, F, M, NORMAL, WORK_ROWS = 0, 9, 12, 15, 16

# A division by zero gives an infinity, as it does in a lane, not an exception.
_compiled = njit(cache=True, error_model="numpy")

CONTACTS = JOINTS * POINTS_PER_JOINT


class Assembly(NamedTuple):
    """Which particles each element joins, and where: what the robots of a block have in common.

    Attributes:
        beams: int32 (n_beams, 3): particle 1, particle 2, strut.
        cables: int32 (n_cables, 2): particle 1, particle 2, sorted by particle 1 (`cable_order` of the model: which of the
            elements' cables each is).
        cable_starts: int32 (particles + 1): the cables of particle 1 = p are cable_starts[p] to cable_starts[p + 1].
        particles: number of particles: twelve joints, the struts' inner particles, the box last.
        isotropic: every particle's inertia is the same about all its axes.
        flat: no joint's slave point has a part along its strut's axis. Saves work, changes no bit.
        body: rows of points, sections and inertias, see `Layout`: (rows,) if all robots have the same, else (rows, WIDTH).
    """

    beams: NDArray[np.int32]
    cables: NDArray[np.int32]
    cable_starts: NDArray[np.int32]
    particles: int
    isotropic: bool
    flat: bool
    body: Array


class Layout(NamedTuple):
    """First row of each table in `state`, `par` and `body`; particles' rows and inertias come first in theirs."""

    struts: int
    contacts: int
    state_rows: int
    par_gravity: int
    par_struts: int
    par_cables: int
    par_ground: int
    par_rows: int
    body_beams: int
    body_cables: int
    body_contacts: int
    body_rows: int


@_compiled
def layout(particles: int, n_beams: int, n_cables: int) -> Layout:
    """Layout for the given counts (six struts, sixty contact points)."""
    struts = particles * PARTICLE_ROWS
    contacts = struts + 6 * STRUT_ROWS
    state_rows = contacts + CONTACTS * CONTACT_ROWS
    par_gravity = particles * PARTICLE_PAR
    par_struts = par_gravity + 3
    par_cables = par_struts + 6 * STRUT_PAR
    par_ground = par_cables + n_cables * CABLE_PAR
    par_rows = par_ground + GROUND_PAR
    body_beams = particles * INERTIA_ROWS
    body_cables = body_beams + n_beams * BEAM_ROWS
    body_contacts = body_cables + n_cables * CABLE_ROWS
    body_rows = body_contacts + CONTACTS * POINT_ROWS
    return Layout(
        struts,
        contacts,
        state_rows,
        par_gravity,
        par_struts,
        par_cables,
        par_ground,
        par_rows,
        body_beams,
        body_cables,
        body_contacts,
        body_rows,
    )


@_compiled
def _cross(ax, ay, az, bx, by, bz):
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@_compiled
def _rotated(work, w, x, y, z):
    """R (x, y, z) with the rotation matrix at row `w`."""
    return (
        load(work, w) * x + load(work, w + 1) * y + load(work, w + 2) * z,
        load(work, w + 3) * x + load(work, w + 4) * y + load(work, w + 5) * z,
        load(work, w + 6) * x + load(work, w + 7) * y + load(work, w + 8) * z,
    )


@_compiled
def _push(work, w, fx, fy, fz, mx, my, mz):
    """Add a force and a moment to the particle whose work rows start at `w`."""
    add_to(work, w + F, fx)
    add_to(work, w + F + 1, fy)
    add_to(work, w + F + 2, fz)
    add_to(work, w + M, mx)
    add_to(work, w + M + 1, my)
    add_to(work, w + M + 2, mz)


@_compiled
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


@_compiled
def _put_matrix(work, w, matrix):
    """Store a rotation matrix at row `w`."""
    for i in range(9):
        store(work, w + i, matrix[i])


@_compiled
def _point(at, row):
    """The three numbers from a row on."""
    return load(at, row), load(at, row + 1), load(at, row + 2)


@_compiled
def _columns(work, w):
    """The three axes of a particle: columns of its rotation matrix."""
    return (
        (load(work, w), load(work, w + 3), load(work, w + 6)),
        (load(work, w + 1), load(work, w + 4), load(work, w + 7)),
        (load(work, w + 2), load(work, w + 5), load(work, w + 8)),
    )


@_compiled
def _beam(state, body, work, p1, p2, rest, b):
    """Forces of one beam; returns its axial force (tension positive)."""
    x1, x2 = p1 * PARTICLE_ROWS + X, p2 * PARTICLE_ROWS + X
    w1, w2 = p1 * WORK_ROWS, p2 * WORK_ROWS
    ex, ey, ez = (
        load(state, x2) - load(state, x1),
        load(state, x2 + 1) - load(state, x1 + 1),
        load(state, x2 + 2) - load(state, x1 + 2),
    )
    length = root(ex * ex + ey * ey + ez * ez)
    per_length, per_rest = 1.0 / length, 1.0 / rest
    ex, ey, ez = ex * per_length, ey * per_length, ez * per_length
    # section axes of both ends: a along the strut, b and c across it
    (a1x, a1y, a1z), (b1x, b1y, b1z), (c1x, c1y, c1z) = _columns(work, w1)
    (a2x, a2y, a2z), (b2x, b2y, b2z), (c2x, c2y, c2z) = _columns(work, w2)
    axial = load(body, b + EA) * (length - rest) * per_rest
    bend = 2.0 * load(body, b + EI) * per_rest
    # axes' parts across the chord: θi = e × uᵢ, dU/dθi = mᵢ = e × qᵢ
    d1 = ex * a1x + ey * a1y + ez * a1z
    d2 = ex * a2x + ey * a2y + ez * a2z
    u1x, u1y, u1z = a1x - d1 * ex, a1y - d1 * ey, a1z - d1 * ez
    u2x, u2y, u2z = a2x - d2 * ex, a2y - d2 * ey, a2z - d2 * ez
    sx, sy, sz = u1x + u2x, u1y + u2y, u1z + u2z
    q1x, q1y, q1z = bend * (sx + u1x), bend * (sy + u1y), bend * (sz + u1z)
    q2x, q2y, q2z = bend * (sx + u2x), bend * (sy + u2y), bend * (sz + u2z)
    # force on end 2: N e − Σ (e·aᵢ) qᵢ / l, negated derivative of U with respect to its position
    g1, g2 = d1 * per_length, d2 * per_length
    fx = axial * ex - (g1 * q1x + g2 * q2x)
    fy = axial * ey - (g1 * q1y + g2 * q2y)
    fz = axial * ez - (g1 * q1z + g2 * q2z)
    # moment that end i feels: −[(e·aᵢ) mᵢ − (aᵢ·mᵢ) e], and the twist's share
    m1x, m1y, m1z = _cross(ex, ey, ez, q1x, q1y, q1z)
    m2x, m2y, m2z = _cross(ex, ey, ez, q2x, q2y, q2z)
    n1 = a1x * m1x + a1y * m1y + a1z * m1z
    n2 = a2x * m2x + a2y * m2y + a2z * m2z
    twist = 0.25 * load(body, b + GJ) * per_rest * (b2x * c1x + b2y * c1y + b2z * c1z - c2x * b1x - c2y * b1y - c2z * b1z)
    h1x, h1y, h1z = _cross(b2x, b2y, b2z, c1x, c1y, c1z)
    h2x, h2y, h2z = _cross(b1x, b1y, b1z, c2x, c2y, c2z)
    hx, hy, hz = twist * (h1x + h2x), twist * (h1y + h2y), twist * (h1z + h2z)
    _push(work, w1, fx, fy, fz, hx - d1 * m1x + n1 * ex, hy - d1 * m1y + n1 * ey, hz - d1 * m1z + n1 * ez)
    _push(work, w2, -fx, -fy, -fz, -hx - d2 * m2x + n2 * ex, -hy - d2 * m2y + n2 * ey, -hz - d2 * m2z + n2 * ez)
    return axial


@_compiled
def _arm(body, row, flat, a, b, c):
    """World vector of the slave point at `row`, for the axes (a, b, c) of its particle; `flat`: it has no part along a."""
    y, z = load(body, row + 1), load(body, row + 2)
    rx, ry, rz = b[0] * y + c[0] * z, b[1] * y + c[1] * z, b[2] * y + c[2] * z
    if flat:
        return rx, ry, rz
    x = load(body, row)
    return rx + a[0] * x, ry + a[1] * x, rz + a[2] * x


@_compiled
def _cables(state, par, body, work, p1, flat1, flat2, cables, first, last, par_cables, body_cables):
    """Forces of the cables from `first` to `last`, all tied to particle `p1` and each to another one.

    What they do to `p1` is summed before it is stored: cables are most of a step, and stores much of a cable.
    """
    w1 = p1 * WORK_ROWS
    a1, b1, c1 = _columns(work, w1)
    x1, y1, z1 = _point(state, p1 * PARTICLE_ROWS + X)
    f1x, f1y, f1z = _point(work, w1 + F)
    m1x, m1y, m1z = _point(work, w1 + M)
    for c in range(first, last):
        p2 = cables[c, 1]
        w2 = p2 * WORK_ROWS
        tied = body_cables + c * CABLE_ROWS
        r1x, r1y, r1z = _arm(body, tied + R1, flat1, a1, b1, c1)
        a2, b2, c2 = _columns(work, w2)
        r2x, r2y, r2z = _arm(body, tied + R2, flat2, a2, b2, c2)
        x2, y2, z2 = _point(state, p2 * PARTICLE_ROWS + X)
        dx, dy, dz = (x2 + r2x) - (x1 + r1x), (y2 + r2y) - (y1 + r1y), (z2 + r2z) - (z1 + r1z)
        row = par_cables + c * CABLE_PAR
        stiffness = load(par, row + K)
        # tension / length
        pull = larger(0.0, stiffness - stiffness * load(par, row + L0) / root(dx * dx + dy * dy + dz * dz))
        fx, fy, fz = pull * dx, pull * dy, pull * dz
        nx, ny, nz = _cross(r1x, r1y, r1z, fx, fy, fz)
        f1x, f1y, f1z = f1x + fx, f1y + fy, f1z + fz
        m1x, m1y, m1z = m1x + nx, m1y + ny, m1z + nz
        nx, ny, nz = _cross(r2x, r2y, r2z, fx, fy, fz)
        _push(work, w2, -fx, -fy, -fz, -nx, -ny, -nz)
    store(work, w1 + F, f1x)
    store(work, w1 + F + 1, f1y)
    store(work, w1 + F + 2, f1z)
    store(work, w1 + M, m1x)
    store(work, w1 + M + 1, m1y)
    store(work, w1 + M + 2, m1z)


@_compiled
def _contact(state, par, work, p, wx, wy, wz, rx, ry, rz, height, row, ground, dt):
    """Forces of the ground on one contact point at arm (rx, ry, rz) of joint `p`, which turns with (wx, wy, wz)."""
    x, w = p * PARTICLE_ROWS, p * WORK_ROWS
    vx, vy, vz = _cross(wx, wy, wz, rx, ry, rz)
    vx, vy, vz = vx + load(state, x + V), vy + load(state, x + V + 1), vz + load(state, x + V + 2)
    normal = larger(0.0, -load(par, ground + KN) * height - load(par, ground + CN) * vz)
    normal = select(height < 0.0, normal, 0.0)
    stiffness, damping, compliance = load(par, ground + KT), load(par, ground + CT), load(par, ground + PER_KT)
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
    store(state, row + U, select(touching, select(slides, -(tx + damping * vx) * compliance, ux), 0.0))
    store(state, row + U + 1, select(touching, select(slides, -(ty + damping * vy) * compliance, uy), 0.0))
    store(state, row + SLIDING, select(touching, select(slides, 1.0, 0.0), 0.0))
    tx, ty = select(touching, tx, 0.0), select(touching, ty, 0.0)
    # the point pressed onto the plane carries the force
    mx, my, mz = _cross(rx, ry, rz, tx, ty, normal)
    _push(work, w, tx, ty, normal, mx, my, mz)
    add_to(work, w + NORMAL, normal)


@_compiled
def _joint_on_ground(state, par, body, work, isotropic, lay, p, dt):
    """Forces of the ground on the five contact points of joint `p`; friction lets go of those that do not touch."""
    x, w = p * PARTICLE_ROWS, p * WORK_ROWS
    sx, sy, sz = _point(state, x + S)
    wx, wy, wz = _spin_to_turn(body, work, isotropic, p, sx, sy, sz)
    level = load(state, x + X + 2)
    for k in range(POINTS_PER_JOINT):
        point = p * POINTS_PER_JOINT + k
        row = lay.contacts + point * CONTACT_ROWS
        px, py, pz = _point(body, lay.body_contacts + point * POINT_ROWS)
        rz = load(work, w + 6) * px + load(work, w + 7) * py + load(work, w + 8) * pz
        height = level + rz
        if any_of(height < 0.0):
            rx = load(work, w) * px + load(work, w + 1) * py + load(work, w + 2) * pz
            ry = load(work, w + 3) * px + load(work, w + 4) * py + load(work, w + 5) * pz
            _contact(state, par, work, p, wx, wy, wz, rx, ry, rz, height, row, lay.par_ground, dt)
        else:  # as a contact that does not touch leaves it
            for i in range(CONTACT_ROWS):
                store(state, row + i, 0.0)


@_compiled
def _spin_to_turn(body, work, isotropic, p, sx, sy, sz):
    """ω = R I⁻¹ Rᵀ s with the rotation matrix in `work`."""
    w, i = p * WORK_ROWS, p * INERTIA_ROWS
    ix = load(body, i)
    if isotropic:
        return ix * sx, ix * sy, ix * sz
    iy, iz = load(body, i + 1), load(body, i + 2)
    bx = (load(work, w) * sx + load(work, w + 3) * sy + load(work, w + 6) * sz) * ix
    by = (load(work, w + 1) * sx + load(work, w + 4) * sy + load(work, w + 7) * sz) * iy
    bz = (load(work, w + 2) * sx + load(work, w + 5) * sy + load(work, w + 8) * sz) * iz
    return _rotated(work, w, bx, by, bz)


@_compiled
def _drive(state, par, struts, par_struts):
    """Every strut moves its rest length towards its target, at most its speed × Δt, and stops there."""
    for s in range(6):
        row = struts + s * STRUT_ROWS
        most = load(par, par_struts + s * STRUT_PAR)
        rest, target = load(state, row + REST), load(state, row + TARGET)
        gap = target - rest
        arrives = smaller(gap, -gap) >= -most
        store(state, row + REST, select(arrives, target, rest + select(gap > 0.0, most, -most)))


@_compiled
def forces(state: Array, par: Array, work: Array, assembly: Assembly, dt: float, reach: float) -> None:
    """Write rotation matrices, forces and moments of every particle into `work`; update friction and axial forces in `state`.

    Args:
        state: rows of one robot or of eight, see the module.
        par: the same.
        work: the same; written.
        assembly: which particles each element joins.
        dt: time step (s).
        reach: no contact point of a joint is farther than this from the joint (m); joints higher than it are skipped.
    """
    beams, cables, starts, particles, isotropic, flat, body = assembly
    lay = layout(particles, beams.shape[0], cables.shape[0])
    _forces(state, par, body, work, beams, cables, starts, particles, isotropic, flat, lay, dt, reach)


@_compiled
def _forces(state, par, body, work, beams, cables, starts, particles, isotropic, flat, lay, dt, reach):
    """`forces` with its assembly taken apart: to do so at every step costs a tenth of it (reference counts)."""
    gx, gy, gz = _point(par, lay.par_gravity)
    for p in range(particles):
        x, w = p * PARTICLE_ROWS, p * WORK_ROWS
        _put_matrix(work, w, _matrix(load(state, x + Q), load(state, x + Q + 1), load(state, x + Q + 2), load(state, x + Q + 3)))
        mass = load(par, p * PARTICLE_PAR + MASS)
        store(work, w + F, mass * gx)
        store(work, w + F + 1, mass * gy)
        store(work, w + F + 2, mass * gz)
        for axis in range(3):
            store(work, w + M + axis, 0.0)
        store(work, w + NORMAL, 0.0)
    for b in range(beams.shape[0]):
        strut = lay.struts + beams[b, 2] * STRUT_ROWS
        row = lay.body_beams + b * BEAM_ROWS
        axial = _beam(state, body, work, beams[b, 0], beams[b, 1], load(state, strut + REST) * load(body, row + SHARE), row)
        store(state, strut + AXIAL, axial)
        store(state, strut + PEAK, larger(load(state, strut + PEAK), larger(axial, -axial)))
    for p in range(particles):
        if starts[p] < starts[p + 1]:
            flat1, first, last = flat and p < JOINTS, starts[p], starts[p + 1]
            _cables(state, par, body, work, p, flat1, flat, cables, first, last, lay.par_cables, lay.body_cables)
    for p in range(JOINTS):
        if any_of(load(state, p * PARTICLE_ROWS + X + 2) < reach):
            _joint_on_ground(state, par, body, work, isotropic, lay, p, dt)


@_compiled
def integrate(state: Array, par: Array, work: Array, assembly: Assembly, dt: float, zeta: float) -> None:
    """Half-step velocities and spins from the forces, then positions and orientations (central difference, leapfrog form)."""
    _integrate(state, par, assembly.body, work, assembly.particles, assembly.isotropic, dt, zeta)


@_compiled
def _integrate(state, par, body, work, particles, isotropic, dt, zeta):
    gain = 1.0 / (1.0 + 0.5 * zeta * dt)
    keep = (1.0 - 0.5 * zeta * dt) * gain
    turn = gain * dt
    for p in range(particles):
        x, w = p * PARTICLE_ROWS, p * WORK_ROWS
        push = load(par, p * PARTICLE_PAR + DT_M) * gain
        for axis in range(3):
            velocity = keep * load(state, x + V + axis) + push * load(work, w + F + axis)
            store(state, x + V + axis, velocity)
            add_to(state, x + X + axis, dt * velocity)
            store(state, x + S + axis, keep * load(state, x + S + axis) + turn * load(work, w + M + axis))
        sx, sy, sz = _point(state, x + S)
        qw, qx, qy, qz = load(state, x + Q), load(state, x + Q + 1), load(state, x + Q + 2), load(state, x + Q + 3)
        wx, wy, wz = _spin_to_turn(body, work, isotropic, p, sx, sy, sz)
        if not isotropic:
            # ω with R at mid-step: half a step with the ω of now, then the full step with that ω
            hw, hx, hy, hz = turned(qw, qx, qy, qz, wx, wy, wz, 0.25 * dt)
            _put_matrix(work, w, _matrix(hw, hx, hy, hz))
            wx, wy, wz = _spin_to_turn(body, work, isotropic, p, sx, sy, sz)
        qw, qx, qy, qz = turned(qw, qx, qy, qz, wx, wy, wz, 0.5 * dt)
        store(state, x + Q, qw)
        store(state, x + Q + 1, qx)
        store(state, x + Q + 2, qy)
        store(state, x + Q + 3, qz)


@_compiled
def turned(
    qw: float, qx: float, qy: float, qz: float, wx: float, wy: float, wz: float, half: float
) -> tuple[float, float, float, float]:
    """The quaternion turned by the spatial angular velocity for 2·half seconds: Cayley map, normalised."""
    ax, ay, az = half * wx, half * wy, half * wz
    nw = qw - ax * qx - ay * qy - az * qz
    nx = qx + ax * qw + ay * qz - az * qy
    ny = qy + ay * qw + az * qx - ax * qz
    nz = qz + az * qw + ax * qy - ay * qx
    scale = 1.0 / root(nw * nw + nx * nx + ny * ny + nz * nz)
    return nw * scale, nx * scale, ny * scale, nz * scale


@_compiled
def advance(state: Array, par: Array, work: Array, assembly: Assembly, dt: float, zeta: float, reach: float, steps: int) -> None:
    """Take `steps` steps of `dt` seconds in place."""
    beams, cables, starts, particles, isotropic, flat, body = assembly
    lay = layout(particles, beams.shape[0], cables.shape[0])
    for _ in range(steps):
        _drive(state, par, lay.struts, lay.par_struts)
        _forces(state, par, body, work, beams, cables, starts, particles, isotropic, flat, lay, dt, reach)
        _integrate(state, par, body, work, particles, isotropic, dt, zeta)
