"""Joints with play, by the formulas of `docs/joints.md`: contact points, forces, and what fills the play.

All vectors are in the axes of the sleeve (of a guide: z is its direction). The symbols are those of the page: p and a
(place and axis of the pin), d (penetration), g (gradient), P (contact point), t (tangents), w (share).
"""

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from . import kernels
from .filling import filling
from .frictions import Friction, friction_law
from .laws import Geometry, Normal, normal_law
from .quantities import Vector, cross, dot, number

Z, ONE = np.array([0.0, 0.0, 1.0]), np.ones(1)


class Pose(NamedTuple):
    """The pin in its sleeve: place [m], rotation matrix, velocity of its centre [m/s] and angular velocity [rad/s]."""

    place: Vector
    rotation: Vector
    velocity: Vector
    spin: Vector


class Points(NamedTuple):
    """Contact points: w (n,), d (n,), g (n, 3), P (n, 3), tangents (n, directions, 3)."""

    share: Vector
    depth: Vector
    gradient: Vector
    place: Vector
    tangents: Vector


class Push(NamedTuple):
    """What a joint does: force on the pin and moment about its centre, normal force and friction force in all [N], what
    the normal forces and the filling absorb and what friction takes [W], rates of the memory of each point.
    """

    force: Vector
    moment: Vector
    normal: float
    traction: Vector
    absorbed: float
    rubbed: float
    flows: Vector
    bends: Vector


class Play(NamedTuple):
    """A joint's play.

    - `points`: of a pose. `count` of them, with `directions` of slip; `held`: the names of what stays held in space.
    - `round_socket`: whether bristles are vectors of three components, square to the normal.
    """

    points: Callable[[Pose], Points]
    count: int
    directions: int
    held: tuple[str, ...]
    normal: Normal
    friction: Friction | None
    fills: Callable[[Pose], tuple[Vector, Vector]] | None
    stores: Callable[[Pose], float]
    round_socket: bool = False
    axes: Vector = np.eye(3)

    @property
    def memories(self) -> int:
        """Numbers that the laws remember and that change within a contact."""
        bristles = self.directions if self.friction is not None and self.friction.remembers else 0
        return self.count * (self.normal.memories + bristles)

    def split(self, memory: Vector) -> tuple[Vector, Vector]:
        """Of the normal law, shape (count,), and of the friction law, shape (count, directions)."""
        own = self.count * self.normal.memories
        flow = memory[:own] if own else np.zeros(self.count)
        rest = memory[own:]
        return flow, rest.reshape(self.count, self.directions) if len(rest) else np.zeros((self.count, self.directions))

    def depths(self, pose: Pose, memory: Vector, speed: Vector) -> tuple[Vector, Vector, Vector]:
        """Penetration, its rate, and the force before it is cut off, of every point: signs make the regime."""
        at = self.points(pose)
        _, rate, _ = kernels.slips(*at[2:], pose.place, pose.velocity, pose.spin)
        return at.depth, rate, self.normal.force(at.depth, rate, self.split(memory)[0], speed)

    def regime(self, pose: Pose, memory: Vector, speed: Vector) -> tuple[Any, Any]:
        """Which points touch, and which of them press."""
        depth, _, force = self.depths(pose, memory, speed)
        return depth > 0, (depth > 0) & ((force > 0) | (not self.normal.clipped))

    def stored(self, pose: Pose) -> float:
        """Elastic energy [J]."""
        at = self.points(pose)
        energies = np.where(at.depth > 0, self.normal.energy(np.maximum(at.depth, 0.0)), 0.0)
        return float(at.share @ energies) + self.stores(pose)

    def act(self, pose: Pose, memory: Vector, speed: Vector, touches: Vector, presses: Vector) -> Push:
        """The joint's push in a regime: which points touch, and of which of these the force is not cut off."""
        at = self.points(pose)
        flow, bend = self.split(memory)
        arm, rate, slip = kernels.slips(*at[2:], pose.place, pose.velocity, pose.spin)
        normal = at.share * np.where(presses, self.normal.force(at.depth, rate, flow, speed), 0.0)
        traction, bends = np.zeros_like(slip), np.zeros_like(bend)
        lever = np.zeros(self.count)
        if self.friction is not None:
            if self.directions == 1:
                # Friction all over a wide contact acts further from the pin's axis than at its point.
                lever = self.normal.lever(at.depth)
                slip = slip + lever[:, None] * pose.spin[2]
            traction = normal[:, None] * self.friction.traction(slip, bend)
            if self.friction.remembers:
                bends = np.where(touches[:, None], self.friction.rates(slip, bend), 0.0)
                if self.round_socket:
                    bends = bends + touches[:, None] * cross(self._turning(pose, at), bend)
        total, moment, friction = kernels.sums(normal, at.gradient, traction, at.tangents, arm)
        absorbed, rubbed = float(normal @ rate), -float((traction * slip).sum())
        moment = moment + (lever * traction[:, 0]).sum() * Z
        if self.fills is not None:
            push, twist = self.fills(pose)
            total, moment = total + push, moment + twist
            absorbed -= float(push @ pose.velocity + twist @ pose.spin)
        flows = self.normal.flows(at.depth, flow, presses)
        return Push(total, moment, float(normal.sum()), friction, absorbed, rubbed, flows, bends)

    def _turning(self, pose: Pose, at: Points) -> Vector:
        """How the plane of contact of a ball turns, without turning about its normal."""
        n = at.gradient
        along = (pose.velocity - dot(n, pose.velocity[None])[:, None] * n) / np.linalg.norm(pose.place)
        return cross(n, along)


def play(joint: dict) -> Play | None:
    """The play of a scene's joint, or nothing."""
    if "normal" not in joint:
        return None
    kind = joint.get("kind", "pin") if joint["type"] == "revolute" else joint["type"]
    points, count, directions, held, geometry = KINDS[kind](joint)
    friction = friction_law(joint["friction"]) if "friction" in joint else None
    fills, stores = None, lambda pose: 0.0
    if "element" in joint:
        # Along a slide of the joint itself there is no play.
        fills, stores = filling(joint["element"], geometry, (*held, "z") if kind in SLIDING else held)
    axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) if kind == "prismatic" else np.eye(3)
    law = normal_law(joint["normal"], geometry)
    return Play(points, count, directions, held, law, friction, fills, stores, kind == "spherical", axes)


def _radii(joint):
    c, r = number(joint["radial_clearance"]), number(joint["pin_radius"])
    return c, r, Geometry(c, r, r + c, number(joint.get("length", np.nan)))


def _pin(joint):
    c, r, geometry = _radii(joint)
    wall = _wall([number(x) for x in joint["worn"]["depth"]], c, r) if "worn" in joint else None

    def points(pose):
        e = pose.place[:2]
        distance = np.sqrt(e @ e)
        depth = distance - c
        n = np.array([*(e / distance if distance > 0 else (1.0, 0.0)), 0.0])
        place = (c + r) * n
        if wall is not None:
            depth, n, place = wall(pose.place)
        return Points(ONE, np.array([depth]), n[None], place[None], np.array([[[-n[1], n[0], 0.0]]]))

    # Round play, and a tilt and a slide along the axis that stay held.
    return points, 1, 1, ("z", "turn x", "turn y"), geometry


def _wall(depths, c, r):
    """A worn bore: the pin stands d = max over t of e . n(t) - h(t) - c in the wall, along n there. The depths h of the
    sectors are samples of a smooth profile, taken by its Fourier series.
    """
    worn, count = np.array(depths), len(depths)
    waves = np.fft.rfft(worn) / count
    orders = np.arange(1, len(waves))[np.abs(waves[1:]) > 1e-6 * np.abs(waves).max()]
    mean, twice, angles = waves[0].real, 2 * waves[orders], 2 * np.pi * np.arange(count) / count
    profile = np.cos(angles), np.sin(angles), worn, orders, twice

    def wall(place):
        t, further = kernels.wall(place[0], place[1], *profile)
        n = np.array([np.cos(t), np.sin(t), 0.0])
        depth = n @ place - mean - further - c
        return depth, n, place + (r - depth) * n

    return wall


def _lobatto(count):
    """Places from -1 to 1, and weights whose sum is 1."""
    legendre = np.polynomial.legendre.Legendre.basis(count - 1)
    places = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
    return places, 1 / (count * (count - 1) * legendre(places) ** 2)


def _sleeve(joint):
    """Stations along the sleeve, then the ring of the faces if there is axial play."""
    c, r, geometry = _radii(joint)
    axial = number(joint["axial_clearance"]) if "axial_clearance" in joint else None
    places, weights = _lobatto(int(joint.get("stations", 8)))
    heights, inside = places * geometry.length / 2, joint.get("pin", "through") == "inside"
    ring = int(joint.get("ring", 8)) if axial is not None else 0
    angles = 2 * np.pi * np.arange(ring) / max(ring, 1)
    outward = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1)
    on_ring = number(joint.get("collar_radius", 1.5 * r)) * outward

    def stations(pose):
        p, a = pose.place, pose.rotation[:, 2]
        tau = a / a[2]
        s = p + (heights[:, None] * a if inside else (heights - p[2])[:, None] * tau)
        across = s * [1.0, 1.0, 0.0]
        distance = np.sqrt(dot(across, across))
        n = across / np.where(distance > 0, distance, 1.0)[:, None]
        n[distance == 0, 0] = 1.0
        g = n if inside else n - dot(n, tau[None])[:, None] * Z
        tangents = np.stack([cross(Z[None], n), np.broadcast_to(Z, n.shape)], 1)
        return Points(weights, distance - c, g, s + (c + r - distance)[:, None] * g, tangents)

    def faces(pose):
        p, a = pose.place, pose.rotation[:, 2]
        tau = a / a[2]
        height = p[2] - dot(tau[None, :2], (on_ring - p)[:, :2])
        side = np.where(height >= 0, 1.0, -1.0)
        tangents = np.stack([cross(Z[None], outward), outward], 1)
        place = on_ring + height[:, None] * Z
        return Points(np.full(ring, 1 / ring), np.abs(height) - axial, side[:, None] * tau, place, tangents)

    def points(pose):
        if axial is None:
            return stations(pose)
        return Points(*(np.concatenate(both) for both in zip(stations(pose), faces(pose), strict=True)))

    return points, len(heights) + ring, 2, (() if axial is not None else ("z",)), geometry


def _ball(joint):
    c, r = number(joint["radial_clearance"]), number(joint["ball_radius"])

    def points(pose):
        distance = np.sqrt(pose.place @ pose.place)
        n = pose.place / distance if distance > 0 else np.array([1.0, 0.0, 0.0])
        # Along all three axes of the socket, square to the normal.
        square = np.eye(3) - np.outer(n, n)
        return Points(ONE, np.array([distance - c]), n[None], ((c + r) * n)[None], square[None])

    return points, 1, 3, (), Geometry(c, r, c + r)


def _block(joint):
    c, length, height = (number(joint[key]) for key in ("side_clearance", "length", "height"))
    width = number(joint["width"]) if "width" in joint else None
    corners, walls = [], []
    for sign in itertools.product((1, -1), (1, -1) if width else (0,), (1, -1)):
        for wall in (0, 1) if width else (0,):
            corners.append(np.array(sign) * np.array([height, width or 0.0, length]) / 2)
            walls.append(sign[wall] * np.eye(3)[wall])
    corners, walls = np.array(corners), np.array(walls)
    reach = dot(walls, corners) + c
    tangents = np.stack([np.broadcast_to(Z, walls.shape), cross(Z[None], walls)], 1)

    def points(pose):
        place = pose.place + corners @ pose.rotation.T
        return Points(np.ones(len(corners)), dot(walls, place) - reach, walls, place, tangents)

    return points, len(corners), 2, () if width else ("y", "turn x", "turn z"), Geometry(c)


SLIDING = ("prismatic", "cylindrical")
KINDS = {
    "pin": _pin,
    "sleeve": _sleeve,
    "cylindrical": _sleeve,
    "spherical": _ball,
    "prismatic": _block,
}
