"""Joints with clearance, written once more from docs/joints.md alone, in plain numpy and for one pose.

It imports nothing of the library. `tests/joints/test_joints_from_docs.py` compares both. The symbols are those of the
page: p and a (place and axis of the pin), w (share), d (penetration), g (gradient), P (contact point).
"""

import itertools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


class Contact(NamedTuple):
    """One contact point, in the axes of the sleeve (SI units)."""

    share: float
    penetration: float
    gradient: Vector
    point: Vector
    tangents: tuple[Vector, ...]


class Motion(NamedTuple):
    """The pin in its sleeve: place [m], rotation matrix, velocity of its centre [m/s] and angular velocity [rad/s]."""

    place: Vector
    rotation: Vector
    velocity: Vector
    spin: Vector


class Laws(NamedTuple):
    """The normal force for a penetration and its rate; the friction for a slip speed, over the normal force."""

    normal: Callable[[float, float], float]
    friction: Callable[[float], float]


def wrench(contacts: Iterator[Contact], motion: Motion, laws: Laws) -> Vector:
    """The force on the pin [N] and its moment about the pin's centre [N m], shape (6,)."""
    force, moment = np.zeros(3), np.zeros(3)
    for contact in contacts:
        arm = contact.point - motion.place
        velocity = motion.velocity + np.cross(motion.spin, arm)
        normal_force = contact.share * laws.normal(contact.penetration, contact.gradient @ velocity)
        slip = np.array([tangent @ velocity for tangent in contact.tangents])
        speed = np.linalg.norm(slip)
        push = -normal_force * contact.gradient
        if speed > 0:
            traction = -normal_force * laws.friction(speed) * slip / speed
            push = push + traction @ np.array(contact.tangents)
        force, moment = force + push, moment + np.cross(arm, push)
    return np.concatenate([force, moment])


def hunt_crossley(stiffness, factor, exponent=1.5):
    """`hunt-crossley` of docs/laws.md."""
    return lambda d, rate: max(0.0, stiffness * max(d, 0.0) ** exponent * (1 + factor * rate))


def adams_impact(stiffness, damping, depth, exponent=1.5):
    """`adams-impact`."""

    def force(d, rate):
        s = min(max(d / depth, 0.0), 1.0)
        return max(0.0, stiffness * d**exponent + damping * s**2 * (3 - 2 * s) * rate) if d > 0 else 0.0

    return force


def tanh(coefficient, speed):
    """`tanh`."""
    return lambda v: coefficient * np.tanh(v / speed)


def brown_mcphee(static, dynamic, speed):
    """`brown-mcphee`."""

    def friction(v):
        x = v / speed
        return dynamic * np.tanh(4 * x) + (static - dynamic) * x / (x**2 / 4 + 0.75) ** 2

    return friction


def pin_in_the_plane(clearance, pin_radius, motion) -> Iterator[Contact]:
    """The revolute joint with clearance."""
    distance = np.linalg.norm(motion.place[:2])
    n = np.array([*motion.place[:2] / distance, 0.0])
    yield Contact(1.0, distance - clearance, n, (clearance + pin_radius) * n, (np.cross([0.0, 0.0, 1.0], n),))


class Sleeve(NamedTuple):
    """The numbers of a sleeve in space [m]; without `axial_clearance` the pin is held axially."""

    clearance: float
    pin_radius: float
    length: float
    pin: str
    stations: int
    axial_clearance: float | None
    collar_radius: float
    ring: int


def lobatto(count):
    """Places from -1 to 1 of the Gauss-Lobatto quadrature, and weights whose sum is 1."""
    legendre = np.polynomial.legendre.Legendre.basis(count - 1)
    places = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
    return places, 1 / (count * (count - 1) * legendre(places) ** 2)


def pin_in_a_sleeve(sleeve: Sleeve, motion: Motion) -> Iterator[Contact]:
    """All stations, then the ring of the faces."""
    p, a, z = motion.place, motion.rotation[:, 2], np.array([0.0, 0.0, 1.0])
    tau = a / a[2]
    for xi, share in zip(*lobatto(sleeve.stations), strict=True):
        height = xi * sleeve.length / 2
        inside = sleeve.pin == "inside"
        centre = p + height * a if inside else p + (height - p[2]) * tau
        distance = np.linalg.norm(centre[:2])
        n = np.array([*centre[:2] / distance, 0.0])
        g = n if inside else n - (n @ tau) * z
        reach = sleeve.clearance + sleeve.pin_radius - distance
        yield Contact(share, distance - sleeve.clearance, g, centre + reach * g, (np.cross(z, n), z))
    if sleeve.axial_clearance is None:
        return
    for angle in 2 * np.pi * np.arange(sleeve.ring) / sleeve.ring:
        outward = np.array([np.cos(angle), np.sin(angle), 0.0])
        place = sleeve.collar_radius * outward
        height = p[2] - tau[:2] @ (place - p)[:2]
        tangents = (np.cross(z, outward), outward)
        g = np.sign(height) * tau
        yield Contact(1 / sleeve.ring, abs(height) - sleeve.axial_clearance, g, place + height * z, tangents)


def ball_in_a_socket(clearance, ball_radius, motion) -> Iterator[Contact]:
    """The spherical joint with clearance."""
    distance = np.linalg.norm(motion.place)
    n = motion.place / distance
    first = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    first = first / np.linalg.norm(first)
    yield Contact(1.0, distance - clearance, n, (clearance + ball_radius) * n, (first, np.cross(n, first)))


def block_in_a_guide(clearance, size, motion) -> Iterator[Contact]:
    """The block's height (x), width (y; 0: held) and length (z); every corner with the walls on its own side."""
    z, half = np.array([0.0, 0.0, 1.0]), np.array(size) / 2
    signs = itertools.product((1, -1), (1, -1) if size[1] else (0,), (1, -1))
    for sign in signs:
        corner = motion.place + motion.rotation @ (sign * half)
        for wall in (0, 1) if size[1] else (0,):
            n = sign[wall] * np.eye(3)[wall]
            depth = n @ corner - half[wall] - clearance
            yield Contact(1.0, depth, n, corner, (z, np.cross(z, n)))


class Filling(NamedTuple):
    """A preloaded bearing: stiffness and preload across, along and in tilt, and its damping time [s]."""

    stiffness: tuple[float, float, float]
    preload: tuple[float, float, float]
    damping_time: float


def preloaded_bearing(filling: Filling, motion: Motion) -> Vector:
    """The force and moment of `preloaded-bearing` in a joint with play in all its directions, shape (6,)."""
    z, a = np.array([0.0, 0.0, 1.0]), motion.rotation[:, 2]
    theta = np.arctan2(np.hypot(a[0], a[1]), a[2])
    about = np.cross(z, a) / np.hypot(a[0], a[1])
    across = np.array([1.0, 1.0, 0.0])
    deflections = motion.place * across, motion.place * z, 2 * np.sin(theta / 2) * about
    rates = motion.velocity * across, motion.velocity * z, motion.spin * across
    lever = 1.0, 1.0, np.cos(theta / 2)
    borne = [
        -k * f * x / np.sqrt(1 + (k * np.linalg.norm(x) / p) ** 2) - filling.damping_time * k * v
        for k, p, x, v, f in zip(filling.stiffness, filling.preload, deflections, rates, lever, strict=True)
    ]
    return np.concatenate([borne[0] + borne[1], borne[2]])
