"""Two planar mechanisms with one clearance joint, written by hand: the truth against which clearance_jax is checked.

Geometry of a pin in a sleeve (t = z x n; F is the force on the pin, -F the force on the sleeve, both at P):

    e = pin centre - sleeve centre     d = |e| - c     n = e / |e|     P = sleeve centre + Rb n
    v_t = t . (v_pin - v_sleeve) + (Rb - |e|) w_pin - Rb w_sleeve
    F = -F_n n + F_t t     F_t = -mu(v_t) F_n     F_n = max(0, K d^1.5 + STEP(d, 0, 0, d_max, c_max) d_dot) for d > 0

The law is ADAMS IMPACT. A `mode` freezes every branch of it, so that an integrator can use one smooth formula from one
switching to the next:  mode = (contact: 0 apart, 1 clipped, 2 contact;  deep: d > d_max;  zone: -1/0/1 of v_t).
`inside` is any time of the current piece of the drive and picks its branch in the same manner.

Every function is plain Python that numba can compile: the same source runs in double precision (the compiled objects
in `PROBLEMS`) and in numpy's extended precision (its `plain_*` members).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

Array = np.ndarray
APART, CLIPPED, CONTACT = 0, 1, 2

# The first eight parameters mean the same in both problems: pin radius [m], radial clearance [m], stiffness [N/m^1.5],
# c_max [N s/m], d_max [m], mu, transition speed [m/s], and the speed at which friction has a corner (inf: nowhere).
PIN_RADIUS, CLEARANCE, STIFFNESS, DAMPING, DEPTH, FRICTION, TRANSITION, CORNER = range(8)
LAW = 8


# ---- the contact law ------------------------------------------------------------------------------------------------


@register_jitable
def damping(d, deep, p):
    """STEP(d, 0, 0, d_max, c_max); below zero the cubic goes on, which only a rejected trial step ever sees."""
    s = d / p[DEPTH]
    return p[DAMPING] if deep else p[DAMPING] * s * s * (3 - 2 * s)


@register_jitable
def normal_force(mode, d, d_dot, p):
    """The smooth piece of IMPACT that `mode` names; d^1.5 is continued as an odd function."""
    if mode[0] != CONTACT:
        return 0 * d
    return p[STIFFNESS] * d * np.sqrt(abs(d)) + damping(d, mode[1], p) * d_dot


@register_jitable
def clip_margin(d, d_dot, deep, p):
    """1 + c(d) d_dot / (K d^1.5), the unclipped force without its zero at d = 0, so that its roots are transversal."""
    if deep:
        # The floor lies outside the deep mode and only keeps trial steps that leave it away from the pole at d = 0.
        d = max(d, 0.1 * p[DEPTH])
        return 1 + p[DAMPING] * d_dot / (p[STIFFNESS] * d * np.sqrt(d))
    s, root = d / p[DEPTH], np.sqrt(max(d, 0 * d))
    return 1 + p[DAMPING] * d_dot * root * (3 - 2 * s) / (p[STIFFNESS] * p[DEPTH] * p[DEPTH])


@register_jitable
def zone_of(slip, p):
    """-1, 0 or 1: which piece of the cubic friction law."""
    return 0 if abs(slip) <= p[CORNER] else (1 if slip > 0 else -1)


@register_jitable
def mode_of(signals, p):
    """The mode that signals (d, d_dot, v_t) belong to."""
    d, d_dot, slip = signals
    if d <= 0:
        return (APART, 0, 0)
    deep = 1 if d > p[DEPTH] else 0
    if clip_margin(d, d_dot, deep, p) < 0:
        return (CLIPPED, deep, 0)
    return (CONTACT, deep, zone_of(slip, p))


@register_jitable
def margins(mode, signals, p):
    """(touch, clip, d_max, friction corner): all positive inside `mode`; the first to become negative ends it."""
    d, d_dot, slip = signals
    far = 0 * d + np.inf
    if mode[0] == APART:
        return (-d, far, far, far)
    clip = clip_margin(d, d_dot, mode[1], p)
    deep = d - p[DEPTH] if mode[1] else p[DEPTH] - d
    if mode[0] == CLIPPED:
        return (d, -clip, deep, far)
    return (d, clip, deep, mode[2] * slip - p[CORNER] if mode[2] else p[CORNER] - abs(slip))


@register_jitable
def mode_after(mode, which, signals, p):
    """The mode on the other side of margin `which`."""
    if which == 0:
        return (CONTACT, 0, zone_of(signals[2], p)) if mode[0] == APART else (APART, 0, 0)
    if which == 1:
        return (CLIPPED, mode[1], 0) if mode[0] == CONTACT else (CONTACT, mode[1], zone_of(signals[2], p))
    if which == 2:
        return (mode[0], 1 - mode[1], mode[2])
    return (mode[0], mode[1], 0 if mode[2] else (1 if signals[2] > 0 else -1))


@register_jitable
def pin_in_sleeve(ex, ey, vx, vy, pin_rate, sleeve_rate, p):
    """Signals (d, d_dot, v_t) and n from the eccentricity and its rate in world axes."""
    length = np.sqrt(ex * ex + ey * ey)
    # At the very centre n is undefined and unused: there is no force while the pin is apart.
    nx, ny = (ex / length, ey / length) if length > 0 else (1 + length, length)
    sleeve_radius = p[PIN_RADIUS] + p[CLEARANCE]
    slip = nx * vy - ny * vx + (sleeve_radius - length) * pin_rate - sleeve_radius * sleeve_rate
    return (length - p[CLEARANCE], nx * vx + ny * vy, slip), nx, ny


# ---- slider-crank: y = (phi, x, phi_dot, x_dot) ---------------------------------------------------------------------
# p = law, crank speed, crank radius, conrod length, conrod mass, conrod inertia about its centre of mass, slider mass


@register_jitable
def slider_crank_kinematics(t, y, p):
    """The sleeve's centre is S = A + L u with crank pin A = r (cos wt, sin wt) and u = (cos phi, sin phi)."""
    phi, x, phi_dot, x_dot = y
    w, r, length = p[LAW], p[LAW + 1], p[LAW + 2]
    cos_crank, sin_crank, cos_rod, sin_rod = np.cos(w * t), np.sin(w * t), np.cos(phi), np.sin(phi)
    ex, ey = x - (r * cos_crank + length * cos_rod), -(r * sin_crank + length * sin_rod)
    vx = x_dot + r * w * sin_crank + length * phi_dot * sin_rod
    vy = -(r * w * cos_crank + length * phi_dot * cos_rod)
    return pin_in_sleeve(ex, ey, vx, vy, 0 * t, phi_dot, p)


@register_jitable
def slider_crank_signals(t, y, p):
    """Penetration d, its rate and the slip velocity v_t."""
    return slider_crank_kinematics(t, y, p)[0]


@register_jitable
def slider_crank_field(mode, inside, t, y, p):
    """Euler's law about the accelerated crank pin A, with rod force -F at P, and Newton's for the guided slider.

    (I + m L^2/4) phi'' = m (L/2) r w^2 sin(wt - phi) - (P - A) x F,   P - A = L u + Rb n,   m_s x'' = F_x
    """
    w, r, length = p[LAW], p[LAW + 1], p[LAW + 2]
    rod_mass, rod_inertia, slider_mass = p[LAW + 3], p[LAW + 4], p[LAW + 5]
    signals, nx, ny = slider_crank_kinematics(t, y, p)
    normal = normal_force(mode, signals[0], signals[1], p)
    traction = -p[FRICTION] * np.tanh(signals[2] / p[TRANSITION]) * normal
    fx, fy = -normal * nx - traction * ny, -normal * ny + traction * nx
    sleeve_radius = p[PIN_RADIUS] + p[CLEARANCE]
    arm_x, arm_y = length * np.cos(y[0]) + sleeve_radius * nx, length * np.sin(y[0]) + sleeve_radius * ny
    torque = rod_mass * length / 2 * r * w * w * np.sin(w * t - y[0]) - (arm_x * fy - arm_y * fx)
    return (y[2], y[3], torque / (rod_inertia + rod_mass * length * length / 4), fx / slider_mass)


@njit(cache=True)
def slider_crank_rhs(t, y, p):
    """The whole right-hand side, choosing its own branches, for ordinary integrators."""
    return np.array(slider_crank_field(mode_of(slider_crank_signals(t, y, p), p), t, t, y, p))


def slider_crank_parameters(clearance: float) -> Array:
    """NUMERICS.md, preamble; `clearance` in m, the stiffness stays that of radii 10 and 10.5 mm."""
    pin, sleeve, young, poisson = 0.01, 0.0105, 207e9, 0.3
    stiffness = 4 / (3 * 2 * (1 - poisson**2) / young) * np.sqrt(pin * sleeve / (sleeve - pin))
    law = [pin, clearance, stiffness, 2000.0, 1e-5, 0.03, 0.01, np.inf]
    return np.array([*law, 5000 * 2 * np.pi / 60, 0.05, 0.12, 0.21, 2.5e-4, 0.14])


def slider_crank_start(p: Array) -> Array:
    """The ideal mechanism's state at t = 0: pin in the middle of the sleeve."""
    w, r, length = p[LAW : LAW + 3]
    return np.array([0.0, r + length, -w * r / length, 0.0])


# ---- joint 5: y = (ex, ey, vx, vy) ----------------------------------------------------------------------------------
# p = law, payload mass, distance pin to centre of mass, theta0, gravity, then begin, end, rise of every STEP in turn


@register_jitable
def drive(inside, t, p):
    """theta, theta', theta'' of a sum of STEP(t, begin, 0, end, rise); `inside` decides which of them are running."""
    angle, rate, acceleration = 0 * t, 0 * t, 0 * t
    for i in range(LAW + 4, len(p), 3):
        duration, rise = p[i + 1] - p[i], p[i + 2]
        if inside >= p[i + 1]:
            angle += rise
        elif inside > p[i]:
            s = (t - p[i]) / duration
            angle += rise * s * s * (3 - 2 * s)
            rate += rise / duration * 6 * s * (1 - s)
            acceleration += rise / (duration * duration) * 6 * (1 - 2 * s)
    return angle, rate, acceleration


@register_jitable
def joint5_signals(t, y, p):
    """Penetration d, its rate and v_t; theta' is continuous, so the borders of the drive need no care here."""
    return pin_in_sleeve(y[0], y[1], y[2], y[3], drive(t, t, p)[1], 0 * t, p)[0]


@register_jitable
def joint5_field(mode, inside, t, y, p):
    """Newton's law of the payload's centre of mass, which the pin carries along and the drive turns.

    m (e'' + r_com (theta'' (-sin a, cos a) - theta'^2 (cos a, sin a))) = F + m g,   a = theta + theta0
    mu(v) = mu_max (3 x - x^3) / 2,  x = v / v_c clipped to [-1, 1]
    """
    mass, arm, offset, gravity = p[LAW], p[LAW + 1], p[LAW + 2], p[LAW + 3]
    angle, rate, acceleration = drive(inside, t, p)
    signals, nx, ny = pin_in_sleeve(y[0], y[1], y[2], y[3], rate, 0 * t, p)
    normal = normal_force(mode, signals[0], signals[1], p)
    x = signals[2] / p[TRANSITION] if mode[2] == 0 else 0 * t + mode[2]
    traction = -p[FRICTION] * (3 * x - x * x * x) / 2 * normal
    c, s = np.cos(angle + offset), np.sin(angle + offset)
    ax = (-normal * nx - traction * ny) / mass - arm * (-acceleration * s - rate * rate * c)
    ay = (-normal * ny + traction * nx) / mass - arm * (acceleration * c - rate * rate * s) - gravity
    return (y[2], y[3], ax, ay)


@njit(cache=True)
def joint5_rhs(t, y, p):
    """The whole right-hand side, choosing its own branches, for ordinary integrators."""
    return np.array(joint5_field(mode_of(joint5_signals(t, y, p), p), t, t, y, p))


# Velocity_1 of the paper (FACTS.md 8.2): begin [s], end [s], rise [rad].
VELOCITY_1 = ((0.0, 0.5, np.pi / 2), (0.5, 1.0, np.pi / 6), (1.0, 1.5, np.pi / 18))


def joint5_parameters(clearance: float, mu: float, corner_speed: float = 1e-2, steps=VELOCITY_1) -> Array:
    """The paper's Table 1 law (K = 2.487e6 N/mm^1.5, c_max = 2487 N s/mm, d_max = 0.01 mm) under an assumed payload."""
    law = [0.025, clearance, 2.487e6 * 1000**1.5, 2.487e6, 1e-5, mu, corner_speed, corner_speed if mu else np.inf]
    return np.array([*law, 300.0, 0.17662, 0.0, 9.81, *np.ravel(steps)])


def joint5_start(p: Array) -> Array:
    """Pin in the middle of the sleeve, at rest."""
    return np.zeros(4)


# ---- as the integrators see them ------------------------------------------------------------------------------------


ONE_PIN = (njit(mode_of), njit(margins), njit(mode_after))


class Problem(NamedTuple):
    """One mechanism. `field(mode, inside, t, y, p)` and `signals(t, y, p)` are compiled, their twins are not. `rules`:
    the compiled `mode_of`, `margins` and `mode_after`; those above are for one pin.
    """

    field: Callable[..., Any]
    signals: Callable[..., Any]
    plain_field: Callable[..., Any]
    plain_signals: Callable[..., Any]
    rhs: Callable[..., Any]
    start: Callable[[Array], Array]
    scale: Callable[[Array], Array]
    borders: Callable[[Array], Array]
    step_limit: float
    rules: tuple[Callable[..., Any], ...] = ONE_PIN


def slider_crank_scale(p: Array) -> Array:
    """Size of every state: 1 rad, the stretched mechanism, and the speeds of the ideal one."""
    w, r, length = p[LAW : LAW + 3]
    return np.array([1.0, r + length, w * r / length, w * r])


def slider_crank_borders(p: Array) -> Array:
    """The crank turns evenly."""
    return np.empty(0)


def joint5_borders(p: Array) -> Array:
    """Times at which a STEP of the drive begins or ends: theta'' jumps there."""
    return np.unique(p[LAW + 4 :].reshape(-1, 3)[:, :2])


def joint5_scale(p: Array) -> Array:
    """Size of every state: the clearance, and the speed of a fall through it."""
    c = p[CLEARANCE]
    speed = np.sqrt(2 * c * p[LAW + 3])
    return np.array([c, c, speed, speed])


PROBLEMS = {
    "slider_crank": Problem(
        njit(slider_crank_field),
        njit(slider_crank_signals),
        slider_crank_field,
        slider_crank_signals,
        slider_crank_rhs,
        slider_crank_start,
        slider_crank_scale,
        slider_crank_borders,
        2e-6,
    ),
    "joint5": Problem(
        njit(joint5_field),
        njit(joint5_signals),
        joint5_field,
        joint5_signals,
        joint5_rhs,
        joint5_start,
        joint5_scale,
        joint5_borders,
        2e-4,
    ),
}
