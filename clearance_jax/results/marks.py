"""What is drawn of a mechanism: the places on its bodies that its joints, points and springs are at."""

from collections.abc import Iterator
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._types import Scalar
from clearance_jax.dynamics.kinematics import Frames, frames
from clearance_jax.dynamics.observe import axes_of
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.body import GROUND
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import Position
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.spatial import as_array


class Mark(NamedTuple):
    """A place on a body, called by what is there: a joint or a spring (on two bodies each), a named point, or the
    body's own centre of mass, which has the body's name.
    """

    name: str
    body: str
    at: Position


def carried(mechanism: AbstractMechanism, body: str) -> list[Mark]:
    """What a body carries; a body that carries one thing only has its centre of mass beside it."""
    joints, springs = mechanism.all_joints(), mechanism.springs
    found = [Mark(j.name, body, j.at_child) for j in joints if j.child == body]
    found += [Mark(j.name, body, j.at_parent) for j in joints if j.parent == body]
    found += [Mark(p.name, body, p.at) for p in mechanism.points if p.body == body]
    found += [Mark(s.name, body, s.at_a) for s in springs if s.body_a == body]
    found += [Mark(s.name, body, s.at_b) for s in springs if s.body_b == body]
    if len(found) == 1:
        found += [Mark(body, body, b.center_of_mass) for b in mechanism.bodies if b.name == body]
    return found


def marks(mechanism: AbstractMechanism) -> Iterator[Mark]:
    """Those of the ground, and of every body."""
    for body in (GROUND, *(b.name for b in mechanism.bodies)):
        yield from carried(mechanism, body)


def labels(mechanism: Mechanism) -> dict[str, tuple[str, list[str]]]:
    """What labels the marks of a dataset: their names, and the bodies that they are on."""
    found = list(marks(mechanism))
    return {"mark": ("mark", [m.name for m in found]), "mark_body": ("mark", [m.body for m in found])}


def mark_positions(mechanism: PreparedMechanism, time: Scalar, y: Array) -> Float[Array, "marks axes"]:
    """World places of all marks [m] at one state."""
    mechanism = mechanism.at(time)
    motion = frames(mechanism, time, layout(mechanism).split(y))
    axes = len(axes_of(mechanism))
    return jnp.stack([as_array(place(mark, motion)[:axes]) for mark in marks(mechanism)])


def place(mark: Mark, motion: Frames) -> tuple:
    """World place of a mark [m]."""
    return motion[mark.body].point(mark.at.vector)
