"""A free rigid body whose pin is in a sleeve at rest, in space: Newton's and Euler's laws, contacts by virtual work.

    state: place of the centre of mass, quaternion, velocity, spin (in the body's axes)

The pin's centre is at `(0, 0, height)` of the body's frame, its axis is the body's z. A penetration d is a function of
the pin's centre p and axis a; its force on the body is -F times the gradient by p, its moment about p is -F a x (the
gradient by a). The law is that of Hunt and Crossley.

    pin "through": the axis at the sleeve's height h, p + (h - p_z) a / a_z;  "inside": p + h a;  d = its distance - c
    face: a point of a ring of radius R, at an angle around the sleeve: |its height on the collar| - axial clearance
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from experiments.reference.problems import Array, Problem

APART, CLIPPED, CONTACT = 0, 1, 2
MASS, IX, IY, IZ, HEIGHT, GX, GY, GZ, TX, TY, TZ = range(11)
STIFFNESS, DAMPING, RADIAL, AXIAL, THROUGH, RING, STATIONS, POINTS = range(11, 19)
TABLE = 19


class Sleeve(NamedTuple):
    """A pin's body (mass, moments about x, y, z [kg m^2], height of the pin's centre over the centre of mass), what
    acts on it at its centre of mass (force [N], torque [N m], in the sleeve's axes), and the sleeve.
    """

    mass: float
    moments: tuple[float, float, float]
    height: float
    force: tuple[float, float, float]
    torque: tuple[float, float, float]
    stiffness: float
    damping: float
    radial: float
    axial: float
    length: float
    collar: float
    through: bool
    stations: int = 4
    ring: int = 4

    def parameters(self) -> Array:
        # Gauss-Lobatto: the ends, and where the derivative of the Legendre polynomial is zero.
        legendre = np.polynomial.legendre.Legendre.basis(self.stations - 1)
        places = np.sort([-1.0, *legendre.deriv().roots().real, 1.0])
        weights = 1 / (self.stations * (self.stations - 1) * legendre(places) ** 2)
        angles = 2 * np.pi * np.arange(self.ring) / self.ring
        head = [self.mass, *self.moments, self.height, *self.force, *self.torque, self.stiffness, self.damping]
        head += [self.radial, self.axial, float(self.through), self.collar, self.stations, self.stations + self.ring]
        points = [(h * self.length / 2, w) for h, w in zip(places, weights, strict=True)]
        points += [(angle, 1 / self.ring) for angle in angles]
        return np.array([*head, *np.ravel(points)])


@njit
def rotation(y):
    w, a, b, c = y[3], y[4], y[5], y[6]
    size = w * w + a * a + b * b + c * c
    out = np.empty((3, 3))
    out[0, 0], out[0, 1], out[0, 2] = w * w + a * a - b * b - c * c, 2 * (a * b - w * c), 2 * (a * c + w * b)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (a * b + w * c), w * w - a * a + b * b - c * c, 2 * (b * c - w * a)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (a * c - w * b), 2 * (b * c + w * a), w * w - a * a - b * b + c * c
    return out / size


@njit
def cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@njit
def pose(y, p):
    """The pin's centre, axis, the velocity of the one and the spin, in the sleeve's axes, and the rotation."""
    turn = rotation(y)
    axis = turn[:, 2].copy()
    arm = p[HEIGHT] * axis
    spin = turn @ y[10:13]
    return y[:3] + arm, axis, y[7:10] + cross(spin, arm), spin, turn


@njit
def penetration(i, centre, axis, p):
    """A point's penetration, and its gradients by the pin's centre and by its axis."""
    by_place, by_axis = np.zeros(3), np.zeros(3)
    where = p[TABLE + 2 * i]
    sx, sy = axis[0] / axis[2], axis[1] / axis[2]
    if i < int(p[STATIONS]):
        if p[THROUGH] > 0:
            reach = where - centre[2]
            x, y = centre[0] + reach * sx, centre[1] + reach * sy
        else:
            x, y = centre[0] + where * axis[0], centre[1] + where * axis[1]
        distance = np.sqrt(x * x + y * y)
        nx, ny = (x / distance, y / distance) if distance > 0 else (1.0, 0.0)
        by_place[0], by_place[1] = nx, ny
        if p[THROUGH] > 0:
            by_place[2] = -(nx * sx + ny * sy)
            by_axis[0], by_axis[1] = reach * nx / axis[2], reach * ny / axis[2]
            by_axis[2] = -reach * (nx * sx + ny * sy) / axis[2]
        else:
            by_axis[0], by_axis[1] = where * nx, where * ny
        return distance - p[RADIAL], by_place, by_axis
    x, y = p[RING] * np.cos(where) - centre[0], p[RING] * np.sin(where) - centre[1]
    height = centre[2] - (x * sx + y * sy)
    side = -1.0 if height < 0 else 1.0
    by_place[0], by_place[1], by_place[2] = side * sx, side * sy, side
    by_axis[0], by_axis[1] = -side * x / axis[2], -side * y / axis[2]
    by_axis[2] = side * (x * sx + y * sy) / axis[2]
    return side * height - p[AXIAL], by_place, by_axis


@njit
def sleeve_signals(t, y, p):
    """Penetration and 1 + damping times its rate, of every point."""
    centre, axis, velocity, spin, _ = pose(y, p)
    turning, count = cross(spin, axis), int(p[POINTS])
    out = np.empty(2 * count)
    for i in range(count):
        depth, by_place, by_axis = penetration(i, centre, axis, p)
        rate = np.sum(by_place * velocity) + np.sum(by_axis * turning)
        out[2 * i], out[2 * i + 1] = depth, 1 + p[DAMPING] * rate
    return out


@njit
def sleeve_field(mode, inside, t, y, p):
    centre, axis, velocity, spin, turn = pose(y, p)
    turning = cross(spin, axis)
    force, torque = p[GX : GX + 3].copy(), p[TX : TX + 3].copy()
    for i in range(int(p[POINTS])):
        if mode[i] != CONTACT:
            continue
        depth, by_place, by_axis = penetration(i, centre, axis, p)
        rate = np.sum(by_place * velocity) + np.sum(by_axis * turning)
        # d^1.5 is continued as an odd function, for trial steps.
        size = p[TABLE + 2 * i + 1] * p[STIFFNESS] * depth * np.sqrt(abs(depth)) * (1 + p[DAMPING] * rate)
        push = -size * by_place
        force += push
        torque += -size * cross(axis, by_axis) + cross(centre - y[:3], push)
    out = np.empty(13)
    out[:3] = y[7:10]
    w = y[10:13]
    out[3] = -0.5 * (y[4] * w[0] + y[5] * w[1] + y[6] * w[2])
    out[4:7] = 0.5 * (y[3] * w + cross(y[4:7], w))
    out[7:10] = force / p[MASS]
    own, moments = turn.T @ torque, p[IX : IX + 3]
    out[10:13] = (own - cross(w, moments * w)) / moments
    return out


@njit
def sleeve_mode_of(signals, p):
    out = np.empty(len(signals) // 2, np.int64)
    for i in range(len(out)):
        out[i] = APART if signals[2 * i] <= 0 else (CLIPPED if signals[2 * i + 1] < 0 else CONTACT)
    return out


@njit
def sleeve_margins(mode, signals, p):
    out = np.empty(len(signals))
    for i in range(len(mode)):
        depth, clip = signals[2 * i], signals[2 * i + 1]
        out[2 * i] = -depth if mode[i] == APART else depth
        out[2 * i + 1] = np.inf if mode[i] == APART else (clip if mode[i] == CONTACT else -clip)
    return out


@njit
def sleeve_mode_after(mode, which, signals, p):
    out, i = mode.copy(), which // 2
    if which % 2 == 0:
        out[i] = CONTACT if mode[i] == APART else APART
    else:
        out[i] = CLIPPED if mode[i] == CONTACT else CONTACT
    return out


def problem_of(start: Array, scale: Array, limit: float) -> Problem:
    """`scale`: the size of every state, for the error control."""
    return Problem(
        sleeve_field,
        sleeve_signals,
        sleeve_field.py_func,
        sleeve_signals.py_func,
        sleeve_field,
        lambda p: start,
        lambda p: scale,
        lambda p: np.empty(0),
        limit,
        (sleeve_mode_of, sleeve_margins, sleeve_mode_after),
    )


def play(y: Array, height: float) -> Array:
    """Pin's centre and axis across, (samples, 5), from states."""
    return np.array([np.concatenate([row[:3] + height * rotation(row)[:, 2], rotation(row)[:2, 2]]) for row in y])
