"""draft"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from experiments.reference.problems import (
    CLEARANCE, CONTACT, DAMPING, DEPTH, FRICTION, LAW, PIN_RADIUS, STIFFNESS, TRANSITION, PROBLEMS, Array, Problem,
    damping, normal_force, slider_crank_borders, slider_crank_field, slider_crank_kinematics, slider_crank_scale,
    slider_crank_signals, slider_crank_start,
)


@register_jitable
def normal_force_tangent(mode, d, d_dot, dd, dd_dot, dk, p):
    if mode[0] != CONTACT:
        return 0 * dd
    s = d / p[DEPTH]
    bend = 0 * d if mode[1] else 6 * p[DAMPING] * s * (1 - s) / p[DEPTH]
    root = np.sqrt(abs(d))
    return dk * d * root + (1.5 * p[STIFFNESS] * root + bend * d_dot) * dd + damping(d, mode[1], p) * dd_dot


@register_jitable
def slider_crank_tangent(mode, t, y, dy, dp, p):
    """Change of the mode's field under a change dy of the state and dp of (clearance, friction, stiffness)."""
    phi, x, phi_dot, x_dot = y
    dphi, dx, dphi_dot, dx_dot = dy
    dc, dmu, dk = dp
    w, r, length = p[LAW], p[LAW + 1], p[LAW + 2]
    rod_mass, rod_inertia, slider_mass = p[LAW + 3], p[LAW + 4], p[LAW + 5]
    (d, d_dot, slip), nx, ny = slider_crank_kinematics(t, y, p)
    cos_rod, sin_rod = np.cos(phi), np.sin(phi)
    lead = rod_mass * length / 2 * r * w * w * np.cos(w * t - phi) * dphi
    inertia = rod_inertia + rod_mass * length * length / 4
    if mode[0] != CONTACT:
        return dphi_dot, dx_dot, -lead / inertia, 0 * dx
    # Eccentricity and its rate; t = (-ny, nx), so that dn = turn t and dt = -turn n.
    sleeve_radius = p[PIN_RADIUS] + p[CLEARANCE]
    dex, dey = dx + length * sin_rod * dphi, -length * cos_rod * dphi
    dvx = dx_dot + length * (sin_rod * dphi_dot + cos_rod * phi_dot * dphi)
    dvy = -length * (cos_rod * dphi_dot - sin_rod * phi_dot * dphi)
    turn = (nx * dey - ny * dex) / (d + p[CLEARANCE])
    sliding = slip + sleeve_radius * phi_dot
    dd, dd_dot = nx * dex + ny * dey - dc, nx * dvx + ny * dvy + turn * sliding
    dslip = nx * dvy - ny * dvx - turn * d_dot - dc * phi_dot - sleeve_radius * dphi_dot
    # Forces
    normal = normal_force(mode, d, d_dot, p)
    s = d / p[DEPTH]
    bend = 0 * d if mode[1] else 6 * p[DAMPING] * s * (1 - s) / p[DEPTH]
    root = np.sqrt(abs(d))
    dnormal = dk * d * root + (1.5 * p[STIFFNESS] * root + bend * d_dot) * dd + damping(d, mode[1], p) * dd_dot
    shape = np.tanh(slip / p[TRANSITION])
    traction = -p[FRICTION] * shape * normal
    dtraction = -dmu * shape * normal - p[FRICTION] * (
        shape * dnormal + (1 - shape * shape) / p[TRANSITION] * dslip * normal
    )
    fx, fy = -normal * nx - traction * ny, -normal * ny + traction * nx
    along, across = -dnormal - turn * traction, dtraction - turn * normal
    dfx, dfy = along * nx - across * ny, along * ny + across * nx
    arm_x, arm_y = length * cos_rod + sleeve_radius * nx, length * sin_rod + sleeve_radius * ny
    darm_x = -length * sin_rod * dphi + dc * nx - sleeve_radius * turn * ny
    darm_y = length * cos_rod * dphi + dc * ny + sleeve_radius * turn * nx
    dtorque = -lead - (darm_x * fy - darm_y * fx) - (arm_x * dfy - arm_y * dfx)
    return dphi_dot, dx_dot, dtorque / inertia, dfx / slider_mass


@register_jitable
def variational_field(mode, inside, t, z, p):
    y = (z[0], z[1], z[2], z[3])
    zero = 0 * t
    a = slider_crank_tangent(mode, t, y, (z[4], z[5], z[6], z[7]), (1 + zero, zero, zero), p)
    b = slider_crank_tangent(mode, t, y, (z[8], z[9], z[10], z[11]), (zero, 1 + zero, zero), p)
    c = slider_crank_tangent(mode, t, y, (z[12], z[13], z[14], z[15]), (zero, zero, 1 + zero), p)
    return slider_crank_field(mode, inside, t, y, p) + a + b + c


@register_jitable
def variational_signals(t, z, p):
    return slider_crank_signals(t, (z[0], z[1], z[2], z[3]), p)


def variational_start(p):
    return np.concatenate([slider_crank_start(p), np.zeros(12)])
