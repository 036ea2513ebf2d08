"""Derivatives of the slider-crank's state with respect to clearance, friction and stiffness.

The variational equations ride along with the state through both integrators of `located.py`, as one state of sixteen:

    z = (y, dy/dc, dy/dmu, dy/dK)    (dy/dp)' = f_y dy/dp + f_p    dy/dp = 0 at t = 0, for the start knows none of them

Every derivative is taken with all other entries of p fixed; K does not follow c.

Nothing happens to a variation at a switching. Where a margin g = 0 turns the field f- into f+, dy/dp jumps by
(f- - f+) dt*/dp, t* being the instant of the switching: the part of the saltation matrix beyond the identity. The force
of IMPACT is continuous at every switching it has (`force_jumps` measures it), so f+ = f-, and dt*/dp is finite because
the integrators find only margins that change sign with a slope:

    touch   K d^1.5 + STEP(d) d_dot is zero at d = 0, and so is the force of a pin apart
    clip    sits where the unclipped force is zero, and the clipped force is zero
    d_max   STEP has reached c_max, with slope zero: even the force's gradient is continuous here
    corner  the tanh has none (and the cubic of joint 5 arrives at its corner with slope zero)

What does change there is the right-hand side of the variation: f_y jumps at the clip and sets in like sqrt(d) at touch,
where no smooth formula converges at its order. Hence the integrators' restart with FIRST_STEP after each of them.
"""

import itertools
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from numba import njit
from numba.extending import register_jitable

from experiments.reference.located import EXTENDED, Solution, dop853, gbs
from experiments.reference.problems import (
    APART,
    CLEARANCE,
    CLIPPED,
    CONTACT,
    DAMPING,
    DEPTH,
    FRICTION,
    LAW,
    PIN_RADIUS,
    PROBLEMS,
    STIFFNESS,
    TRANSITION,
    Array,
    Problem,
    damping,
    mode_of,
    normal_force,
    slider_crank_field,
    slider_crank_kinematics,
    slider_crank_signals,
    slider_crank_start,
)

SLIDER_CRANK = PROBLEMS["slider_crank"]
COLUMNS = (CLEARANCE, FRICTION, STIFFNESS)  # entries of p, in the order of the stored derivatives
STATES = 4


# ---- the equations --------------------------------------------------------------------------------------------------


@register_jitable
def normal_force_tangent(mode, d, d_dot, dd, dd_dot, dk, p):
    """Change of `normal_force` with d, d_dot and the stiffness."""
    if mode[0] != CONTACT:
        return 0 * dd
    s, root = d / p[DEPTH], np.sqrt(abs(d))
    damping_slope = 0 * d if mode[1] else 6 * p[DAMPING] * s * (1 - s) / p[DEPTH]
    elastic = dk * d * root + 1.5 * p[STIFFNESS] * root * dd
    return elastic + damping_slope * d_dot * dd + damping(d, mode[1], p) * dd_dot


@register_jitable
def slider_crank_tangent(mode, t, y, dy, dp, p):
    """Change of `slider_crank_field` with the state (dy) and with (clearance, friction, stiffness) (dp), in one mode.

    With b = z x n, dn = turn b and db = -turn n, `turn` being the rotation of the line of centres.
    """
    phi, _, phi_dot, _ = y
    dphi, dx, dphi_dot, dx_dot = dy
    dc, dmu, dk = dp
    w, r, length = p[LAW], p[LAW + 1], p[LAW + 2]
    rod_mass, rod_inertia, slider_mass = p[LAW + 3], p[LAW + 4], p[LAW + 5]
    inertia = rod_inertia + rod_mass * length * length / 4
    dtorque = -rod_mass * length / 2 * r * w * w * np.cos(w * t - phi) * dphi
    if mode[0] != CONTACT:
        return (dphi_dot, dx_dot, dtorque / inertia, 0 * dx)

    (d, d_dot, slip), nx, ny = slider_crank_kinematics(t, y, p)
    sleeve_radius, cos_rod, sin_rod = p[PIN_RADIUS] + p[CLEARANCE], np.cos(phi), np.sin(phi)
    dex, dey = dx + length * sin_rod * dphi, -length * cos_rod * dphi
    dvx = dx_dot + length * (sin_rod * dphi_dot + cos_rod * phi_dot * dphi)
    dvy = -length * (cos_rod * dphi_dot - sin_rod * phi_dot * dphi)
    turn = (nx * dey - ny * dex) / (d + p[CLEARANCE])
    dd, dd_dot = nx * dex + ny * dey - dc, nx * dvx + ny * dvy + turn * (slip + sleeve_radius * phi_dot)
    dslip = nx * dvy - ny * dvx - turn * d_dot - dc * phi_dot - sleeve_radius * dphi_dot

    normal, dnormal = normal_force(mode, d, d_dot, p), normal_force_tangent(mode, d, d_dot, dd, dd_dot, dk, p)
    shape = np.tanh(slip / p[TRANSITION])
    dshape = (1 - shape * shape) * dslip / p[TRANSITION]
    traction = -p[FRICTION] * shape * normal
    dtraction = -(dmu * shape + p[FRICTION] * dshape) * normal - p[FRICTION] * shape * dnormal
    fx, fy = -normal * nx - traction * ny, -normal * ny + traction * nx
    along, across = -dnormal - turn * traction, dtraction - turn * normal
    dfx, dfy = along * nx - across * ny, along * ny + across * nx

    arm_x, arm_y = length * cos_rod + sleeve_radius * nx, length * sin_rod + sleeve_radius * ny
    darm_x = -length * sin_rod * dphi + dc * nx - sleeve_radius * turn * ny
    darm_y = length * cos_rod * dphi + dc * ny + sleeve_radius * turn * nx
    dtorque -= darm_x * fy - darm_y * fx + arm_x * dfy - arm_y * dfx
    return (dphi_dot, dx_dot, dtorque / inertia, dfx / slider_mass)


@register_jitable
def variational_field(mode, inside, t, z, p):
    """Field of the state and of its three derivatives."""
    y, zero, one = (z[0], z[1], z[2], z[3]), 0 * t, 1 + 0 * t
    by_clearance = slider_crank_tangent(mode, t, y, (z[4], z[5], z[6], z[7]), (one, zero, zero), p)
    by_friction = slider_crank_tangent(mode, t, y, (z[8], z[9], z[10], z[11]), (zero, one, zero), p)
    by_stiffness = slider_crank_tangent(mode, t, y, (z[12], z[13], z[14], z[15]), (zero, zero, one), p)
    return slider_crank_field(mode, inside, t, y, p) + by_clearance + by_friction + by_stiffness


@register_jitable
def variational_signals(t, z, p):
    """The margins know the state only."""
    return slider_crank_signals(t, (z[0], z[1], z[2], z[3]), p)


def variational_start(p: Array) -> Array:
    """The start depends on none of the three parameters."""
    return np.concatenate([slider_crank_start(p), np.zeros(STATES * len(COLUMNS))])


def force_jumps(p: Array) -> dict[str, float]:
    """|F_n+ - F_n-| at each kind of switching, over the elastic force at d_max. Only F_n knows the mode here."""
    size = p[STIFFNESS] * p[DEPTH] ** 1.5
    jumps = dict.fromkeys(("touch", "clip", "d_max"), 0.0)

    def record(kind: str, before: tuple, after: tuple, d: float, d_dot: float) -> None:
        jump = abs(normal_force(before, d, d_dot, p) - normal_force(after, d, d_dot, p)) / size
        jumps[kind] = max(jumps[kind], jump)

    for d_dot in (-1.0, 1.0):
        record("touch", (APART, 0, 0), (CONTACT, 0, 0), 0.0, d_dot)
        record("d_max", (CONTACT, 0, 0), (CONTACT, 1, 0), p[DEPTH], d_dot)
    for deep, d in ((0, 0.5 * p[DEPTH]), (1, 2 * p[DEPTH])):
        d_dot = -p[STIFFNESS] * d**1.5 / damping(d, deep, p)  # the root of the clip's margin
        record("clip", (CONTACT, deep, 0), (CLIPPED, deep, 0), d, d_dot)
    return jumps


# ---- the integrations -----------------------------------------------------------------------------------------------

ROUGH = 1e-7  # tolerance of the run that only measures how large the derivatives become
# Extrapolation controls the derivatives this much less strictly than the state, whose errors enter them multiplied by
# the curvature of d^1.5: 1e-15 of their magnitude per step is still far below what differences can confirm.
SLACK = 100.0


@njit(cache=True)
def variational_rhs(t, z, p):
    """The whole right-hand side, choosing its own branches, for ordinary integrators."""
    return np.array(variational_field(mode_of(variational_signals(t, z, p), p), t, t, z, p))


_field, _signals = njit(variational_field), njit(variational_signals)


def variational_problem(scale: Array) -> Problem:
    """The sixteen equations, with errors measured by `scale`."""
    return SLIDER_CRANK._replace(
        field=_field,
        signals=_signals,
        plain_field=variational_field,
        plain_signals=variational_signals,
        rhs=variational_rhs,
        start=variational_start,
        scale=lambda p: scale,
    )


def split(z: Array) -> tuple[Array, Array]:
    """States (n, 4) and derivatives (n, 4, 3) from the rows of sixteen."""
    return z[:, :STATES], z[:, STATES:].reshape(-1, len(COLUMNS), STATES).swapaxes(1, 2)


def variational_scale(t: Array, p: Array) -> Array:
    """Sizes for the error control: the problem's own for the state, its largest value over time for each derivative."""
    size = SLIDER_CRANK.scale(p)
    guess = np.concatenate([size, *(size / p[i] for i in COLUMNS)])
    largest = np.max(np.abs(dop853(variational_problem(guess), t, p, ROUGH).y), axis=0)
    return np.concatenate([size, largest[STATES:]])


def solve_double(t: Array, p: Array) -> Solution:
    """State and derivatives (rows for `split`) by DOP853 in double precision."""
    return dop853(variational_problem(variational_scale(t, p)), t, p)


def solve_extended(t: Array, p: Array) -> Solution:
    """The same by extrapolation in extended precision."""
    scale = variational_scale(t, p)
    scale[STATES:] *= SLACK
    return gbs(variational_problem(scale), t, p)


# ---- the check: differences of the state, by the integrator that knows nothing of the equations above ---------------

# Relative steps: the largest of three, each half of the one before, so that two Richardson extrapolations remove the
# errors of order h^2 and h^4. They balance what truncation is
# left against round-off over the step: clearance moves the state most, friction least.
STEPS = {CLEARANCE: 4e-5, FRICTION: 16e-4, STIFFNESS: 4e-4}
PARTS = (1.0, 0.5, 0.25)


def shifted(job: tuple[Array, Array, int, float]) -> tuple[Array, int]:
    """States in extended precision with one parameter changed by a relative amount, and how many switchings it saw."""
    t, p, index, change = job
    p = p.astype(EXTENDED)
    p[index] *= 1 + EXTENDED(change)
    solution = gbs(SLIDER_CRANK, t, p, dtype=EXTENDED)
    return solution.y, len(solution.switchings)


def richardson(states: Sequence[Array], change: float) -> Array:
    """Derivative at step 0 from the states at +change, -change, +change/2, -change/2, ..."""
    table = [(up - down) / (2 * change * part) for part, up, down in zip(PARTS, states[::2], states[1::2], strict=True)]
    for order in range(1, len(PARTS)):
        table = [fine + (fine - coarse) / (4**order - 1) for coarse, fine in itertools.pairwise(table)]
    return table[0].astype(float)


def solve_differences(t: Array, p: Array) -> Array:
    """Derivatives (n, 4, 3) by extrapolated central differences: eighteen solutions, on all processors."""
    jobs = [(t, p, i, sign * part * STEPS[i]) for i in COLUMNS for part in PARTS for sign in (1, -1)]
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        states, counts = zip(*pool.map(shifted, jobs), strict=True)
    if len(set(counts)) > 1:
        raise RuntimeError(f"A step of the differences changes the number of switchings: {sorted(set(counts))}.")
    each = 2 * len(PARTS)
    changes = [EXTENDED(p[i]) * STEPS[i] for i in COLUMNS]
    columns = [richardson(states[n * each : (n + 1) * each], change) for n, change in enumerate(changes)]
    return np.stack(columns, axis=2)
