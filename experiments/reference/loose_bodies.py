"""Rigid bodies in the plane that only pins in sleeves hold together: Newton's and Euler's laws of every body.

    q = (x, y, angle) of every body, x and y those of its centre of mass;  state (q, q')

No joint is ideal, so nothing is constrained: a body that is guided or driven at constant speed has no inverse mass (or
no inverse inertia) in that direction. Body -1 is the ground. Contacts are those of `problems`, all with one law.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from experiments.reference.problems import (
    CLEARANCE,
    FRICTION,
    LAW,
    TRANSITION,
    Array,
    Problem,
    margins,
    mode_after,
    mode_of,
    normal_force,
    pin_in_sleeve,
)

# p = law, number of bodies, of joints, spring (stiffness, free length, body, its point, point of the ground), then of
# every body (inverse masses along x, y and about z, torque), then of every joint (sleeve's body and point, pin's body
# and point); points are from the centre of mass.
BODIES, JOINTS, SPRING = LAW, LAW + 1, LAW + 2
TABLE, BODY, JOINT, MODE, MARGINS = LAW + 9, 4, 6, 3, 4


class Body(NamedTuple):
    """Inverse masses along x and y [1/kg] and about z [1/(kg m^2)], torque [N m], place and angle at the start, the
    centre of mass in the body's frame, speed and rate at the start.
    """

    inverse: tuple[float, float, float]
    place: tuple[float, float, float]
    centre: tuple[float, float] = (0.0, 0.0)
    speed: tuple[float, float, float] = (0.0, 0.0, 0.0)
    torque: float = 0.0


class Pin(NamedTuple):
    """A joint: sleeve's body and its centre in that body's frame, pin's body and its centre there."""

    sleeve: int
    at_sleeve: tuple[float, float]
    pin: int
    at_pin: tuple[float, float]


@njit
def point_of(y, p, body, px, py):
    """Place, velocity and rate of a body's point, and its arm from the centre of mass."""
    if body < 0:
        return px, py, 0.0, 0.0, 0.0, 0.0, 0.0
    count = int(p[BODIES])
    c, s = np.cos(y[3 * body + 2]), np.sin(y[3 * body + 2])
    ax, ay = c * px - s * py, s * px + c * py
    at = 3 * (count + body)
    rate = y[at + 2]
    return y[3 * body] + ax, y[3 * body + 1] + ay, y[at] - rate * ay, y[at + 1] + rate * ax, rate, ax, ay


@njit
def joint_at(y, p, i):
    """Signals of one contact, its normal, and the arms of both bodies' centres of pin and sleeve."""
    at = TABLE + BODY * int(p[BODIES]) + JOINT * i
    sx, sy, svx, svy, srate, sax, say = point_of(y, p, int(p[at]), p[at + 1], p[at + 2])
    px, py, pvx, pvy, prate, pax, pay = point_of(y, p, int(p[at + 3]), p[at + 4], p[at + 5])
    seen, nx, ny = pin_in_sleeve(px - sx, py - sy, pvx - svx, pvy - svy, prate, srate, p)
    return seen, nx, ny, sax, say, pax, pay


@njit
def loose_signals(t, y, p):
    count = int(p[JOINTS])
    out = np.empty(MODE * count)
    for i in range(count):
        seen = joint_at(y, p, i)[0]
        out[MODE * i], out[MODE * i + 1], out[MODE * i + 2] = seen
    return out


@njit
def loose_field(mode, inside, t, y, p):
    bodies = int(p[BODIES])
    force = np.zeros((bodies + 1, 3))  # the last one is the ground
    for b in range(bodies):
        force[b, 2] = p[TABLE + BODY * b + 3]
    if p[SPRING] > 0:
        b = int(p[SPRING + 2])
        x, z, _, _, _, ax, az = point_of(y, p, b, p[SPRING + 3], p[SPRING + 4])
        x, z = x - p[SPRING + 5], z - p[SPRING + 6]
        length = np.sqrt(x * x + z * z)
        pull = -p[SPRING] * (length - p[SPRING + 1]) / length
        force[b, 0] += pull * x
        force[b, 1] += pull * z
        force[b, 2] += pull * (ax * z - az * x)
    for i in range(int(p[JOINTS])):
        if mode[MODE * i] != 2:
            continue
        seen, nx, ny, sax, say, pax, pay = joint_at(y, p, i)
        normal = normal_force((2, mode[MODE * i + 1], 0), seen[0], seen[1], p)
        traction = -p[FRICTION] * np.tanh(seen[2] / p[TRANSITION]) * normal
        fx, fy = -normal * nx - traction * ny, -normal * ny + traction * nx
        radius, distance = p[0] + p[CLEARANCE], seen[0] + p[CLEARANCE]
        at = TABLE + BODY * bodies + JOINT * i
        sleeve, pin = int(p[at]), int(p[at + 3])
        # Both act at the sleeve's surface.
        rx, ry = pax + (radius - distance) * nx, pay + (radius - distance) * ny
        force[pin, 0] += fx
        force[pin, 1] += fy
        force[pin, 2] += rx * fy - ry * fx
        rx, ry = sax + radius * nx, say + radius * ny
        force[sleeve, 0] -= fx
        force[sleeve, 1] -= fy
        force[sleeve, 2] -= rx * fy - ry * fx
    out = np.empty(6 * bodies)
    for b in range(bodies):
        for k in range(3):
            out[3 * b + k] = y[3 * (bodies + b) + k]
            out[3 * (bodies + b) + k] = force[b, k] * p[TABLE + BODY * b + k]
    return out


# ---- the rules of one pin, for every pin -----------------------------------------------------------------------------


@njit
def loose_mode_of(signals, p):
    out = np.empty(len(signals), np.int64)
    for i in range(0, len(signals), MODE):
        out[i], out[i + 1], out[i + 2] = mode_of((signals[i], signals[i + 1], signals[i + 2]), p)
    return out


@njit
def loose_margins(mode, signals, p):
    count = len(signals) // MODE
    out = np.empty(MARGINS * count)
    for i in range(count):
        k = MODE * i
        one = margins((mode[k], mode[k + 1], mode[k + 2]), (signals[k], signals[k + 1], signals[k + 2]), p)
        for j in range(MARGINS):
            out[MARGINS * i + j] = one[j]
    return out


@njit
def loose_mode_after(mode, which, signals, p):
    out, k = mode.copy(), MODE * (which // MARGINS)
    one = (mode[k], mode[k + 1], mode[k + 2])
    out[k], out[k + 1], out[k + 2] = mode_after(one, which % MARGINS, (signals[k], signals[k + 1], signals[k + 2]), p)
    return out


# ---- scenes ----------------------------------------------------------------------------------------------------------


def parameters(law: list[float], bodies: list[Body], pins: list[Pin], spring: tuple[float, ...] = (0.0,) * 7) -> Array:
    """The numbers of a scene; `law`: the first eight of `problems`."""

    def from_centre(body, point):
        cx, cy = bodies[body].centre if body >= 0 else (0.0, 0.0)
        return [point[0] - cx, point[1] - cy]

    p = [*law, float(len(bodies)), float(len(pins)), *spring]
    for body in bodies:
        p += [*body.inverse, body.torque]
    for pin in pins:
        p += [pin.sleeve, *from_centre(pin.sleeve, pin.at_sleeve), pin.pin, *from_centre(pin.pin, pin.at_pin)]
    return np.array(p, float)


def start_of(bodies: list[Body]) -> Array:
    """Places and speeds of the centres of mass, from those of the frames' origins."""
    q, v = [], []
    for body in bodies:
        (x, y, angle), (vx, vy, rate), (cx, cy) = body.place, body.speed, body.centre
        c, s = np.cos(angle), np.sin(angle)
        ax, ay = c * cx - s * cy, s * cx + c * cy
        q += [x + ax, y + ay, angle]
        v += [vx - rate * ay, vy + rate * ax, rate]
    return np.array(q + v)


def problem_of(bodies: list[Body], scale: Array, limit: float) -> Problem:
    """`scale`: the size of every state, for the error control."""
    start = start_of(bodies)
    return Problem(
        loose_field,
        loose_signals,
        loose_field.py_func,
        loose_signals.py_func,
        loose_field,
        lambda p: start,
        lambda p: scale,
        lambda p: np.empty(0),
        limit,
        (loose_mode_of, loose_margins, loose_mode_after),
    )


def relative(y: Array, bodies: list[Body], pins: list[Pin]) -> Array:
    """Of every pin (pins, 6, samples): angle, eccentricity in the sleeve's axes, and their rates."""
    count, out = len(bodies), []

    def point(body, at):
        if body < 0:
            zero = np.zeros(len(y))
            return zero + at[0], zero + at[1], zero, zero, zero, zero
        centre = bodies[body].centre
        px, py = at[0] - centre[0], at[1] - centre[1]
        x, z, angle = y[:, 3 * body : 3 * body + 3].T
        vx, vz, rate = y[:, 3 * (count + body) : 3 * (count + body) + 3].T
        ax, az = np.cos(angle) * px - np.sin(angle) * py, np.sin(angle) * px + np.cos(angle) * py
        return x + ax, z + az, vx - rate * az, vz + rate * ax, angle, rate

    for pin in pins:
        sx, sz, svx, svz, sa, sr = point(pin.sleeve, pin.at_sleeve)
        px, pz, pvx, pvz, pa, pr = point(pin.pin, pin.at_pin)
        c, s = np.cos(sa), np.sin(sa)
        ex, ez, vx, vz = px - sx, pz - sz, pvx - svx, pvz - svz
        vx, vz = vx + sr * ez, vz - sr * ex
        out.append([pa - sa, c * ex + s * ez, c * ez - s * ex, pr - sr, c * vx + s * vz, c * vz - s * vx])
    return np.array(out)
