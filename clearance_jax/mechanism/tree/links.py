"""A large mechanism in space as a table: its coordinates and bodies as rows of arrays.

Written out number by number, the program of a mechanism grows with its coordinates. With a table the sweep from the
ground is a loop over its links, and inertia and loads are a few loops over their columns. A link is one elementary
coordinate: what is fixed before it, then its motion.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax.mechanism.body import GROUND, Body, needs_six
from clearance_jax.mechanism.placement import Inertia
from clearance_jax.mechanism.tree.coordinate import Coordinate
from clearance_jax.mechanism.tree.tree import AbstractJoint
from clearance_jax.spatial import (
    IDENTITY,
    UNIT,
    ZERO,
    Rotation,
    Vector,
    add,
    as_array,
    matrix,
    product,
    scale,
    transpose,
)

# With more coordinates than this, computations that occur once in a solve use a table: only their compiling counts.
ONCE = 3


class Links(Module):
    """The numbers of a table: by link the fixed rotation and offset before it, and its axis; by body the fixed rotation
    and offset of its frame on its link, the place of its joint there, and mass, centre and inertia in that link's axes.
    """

    turned: Float[Array, "links 3 3"]
    offset: Float[Array, "links 3"]
    axis: Float[Array, "links 3"]
    body_turned: Float[Array, "bodies 3 3"]
    body_offset: Float[Array, "bodies 3"]
    pivot: Float[Array, "bodies 3"]
    mass: Float[Array, " bodies"]
    centre: Float[Array, "bodies 3"]
    inertia: Float[Array, "bodies 3 3"]


class Order(NamedTuple):
    """The structure of a table: coordinates and parents of its links, and each body's link (-1: the ground)."""

    coordinates: tuple[Coordinate, ...]
    parents: tuple[int, ...]
    carriers: dict[str, int]

    @property
    def swings(self) -> np.ndarray:
        """The first link of each swing; the next link is its second tilt. The first link does the turning of both."""
        return np.array([i for i, c in enumerate(self.coordinates) if c.swings][::2], int)


def order(joints: tuple[AbstractJoint, ...]) -> Order:
    """The links of a tree, in the order of its coordinates."""
    carriers, coordinates, parents = {GROUND: -1}, [], []
    for joint in joints:
        at = carriers[joint.parent]
        for coordinate in joint.own_coordinates():
            coordinates.append(coordinate)
            parents.append(at)
            at = len(coordinates) - 1
        carriers[joint.child] = at
    return Order(tuple(coordinates), tuple(parents), carriers)


class FixedFrame(NamedTuple):
    """Rotation and offset of a frame that is fixed on a link."""

    rotation: Rotation = IDENTITY
    offset: Vector = ZERO

    def move(self, offset: Vector, rotation: Rotation) -> "FixedFrame":
        """A frame that is fixed on this one, relative to the link."""
        return FixedFrame(self.rotation.compose(rotation.rows), add(self.offset, self.rotation.apply(offset)))


def links_of(bodies: tuple[Body, ...], joints: tuple[AbstractJoint, ...]) -> Links:
    """The numbers of the table."""
    before, axes, pivots, placed = [], [], {}, {GROUND: FixedFrame()}
    for joint in joints:
        at = placed[joint.parent].move(joint.at_parent.vector, joint.turned)
        for coordinate in joint.coordinates():
            before.append(at)
            axes.append(coordinate.turns if coordinate.slides is None else coordinate.slides)
            at = FixedFrame()
        if joint.child_orientation is not None:
            rows = transpose(joint.child_orientation.rotation.rows)
            at = at.move(ZERO, Rotation(rows, rows))
        pivots[joint.child] = at.offset
        placed[joint.child] = at.move(scale(-1.0, joint.at_child.vector), IDENTITY)
    frames = [placed[body.name] for body in bodies]
    centres = [at.move(body.center_of_mass.vector, IDENTITY).offset for body, at in zip(bodies, frames, strict=True)]
    return Links(
        jnp.stack([matrix(at.rotation.rows) for at in before]),
        jnp.stack([as_array(at.offset) for at in before]),
        jnp.stack([as_array(axis or ZERO) for axis in axes]),
        jnp.stack([matrix(at.rotation.rows) for at in frames]),
        jnp.stack([as_array(at.offset) for at in frames]),
        jnp.stack([as_array(pivots[body.name]) for body in bodies]),
        as_array([0.0 if body.mass is None else body.mass for body in bodies]),
        jnp.stack([as_array(centre) for centre in centres]),
        jnp.stack([_inertia(body, at.rotation) for body, at in zip(bodies, frames, strict=True)]),
    )


def _inertia(body: Body, rotation: Rotation) -> Array:
    if body.inertia is None:
        return jnp.zeros((3, 3))
    if not isinstance(body.inertia, Inertia):
        raise needs_six(body)
    tensor = body.inertia.symmetric
    rows = tuple(tuple(tensor.entry(i, j) for j in range(3)) for i in range(3))
    turned = product(product(rotation.rows, rows), transpose(rotation.rows))  # pyright: ignore[reportArgumentType]
    return matrix(turned)


class Masks(NamedTuple):
    """The columns, free ones first, and what they move, as zeros and ones. A ball has three columns.

    - `links`: the link of each column; `local` (columns, 3): for a ball the axis of the column in the link, else zero;
      `turns`: whether the column turns (else it slides).
    - `beyond` (columns, links): whether a column moves a link.
    """

    links: tuple[int, ...]
    local: np.ndarray
    turns: np.ndarray
    beyond: np.ndarray


def masks(plan: Order) -> Masks:
    """The masks of the free columns in the order of the velocities, then of the prescribed ones."""
    count = len(plan.coordinates)
    beyond = np.zeros((count, count))  # beyond[i, j]: link j is link i or hangs on it
    for j in range(count):
        i = j
        while i >= 0:
            beyond[i, j] = 1.0
            i = plan.parents[i]
    free = [i for i, c in enumerate(plan.coordinates) if c.motion.is_free]
    driven = [i for i, c in enumerate(plan.coordinates) if not c.motion.is_free]
    links, local, turns = [], [], []
    for i in (*free, *driven):
        for unit in UNIT if plan.coordinates[i].is_ball else (ZERO,):
            links.append(i)
            local.append(unit)
            turns.append(plan.coordinates[i].slides is None)
    return Masks(tuple(links), np.array(local), np.array(turns, float), beyond[list(links)])


def rodrigues(axis: Float[Array, "links 3"], sine: Float[Array, " links"], cosine: Float[Array, " links"]) -> Array:
    """The matrices of turns about unit axes, (links, 3, 3)."""
    x, y, z = axis[:, 0], axis[:, 1], axis[:, 2]
    o = jnp.zeros_like(x)
    k = jnp.stack([o, -z, y, z, o, -x, -y, x, o], axis=1).reshape(-1, 3, 3)  # a cross product; `twice` is two
    twice = axis[:, :, None] * axis[:, None, :] - (x * x + y * y + z * z)[:, None, None] * jnp.eye(3)[None]
    return jnp.eye(3)[None] + sine[:, None, None] * k + (1 - cosine)[:, None, None] * twice
