"""Marks for pictures of a mechanism: the places of joints, points and springs on its bodies."""

from collections.abc import Iterator
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.dynamics.quantities import axes_of, observe
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.body import GROUND
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import Position
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.spatial import as_array

# Dataset variables of a picture beside the positions of marks.
SHOWN = "q", "eccentricity", "penetration", "pin_tilt"


class Mark(NamedTuple):
    """A place on a body, called by what is there: a joint or a spring (on two bodies each), a named point, or the
    body's own centre of mass, which has the body's name.
    """

    name: str
    body: str
    at: Position


def marks(mechanism: AbstractMechanism) -> Iterator[Mark]:
    """The marks of the ground and of every body. A body with one mark has its centre of mass as a second one."""
    joints, springs = mechanism.all_joints(), mechanism.springs
    for body in (GROUND, *(b.name for b in mechanism.bodies)):
        carried = [Mark(j.name, body, j.at_child) for j in joints if j.child == body]
        carried += [Mark(j.name, body, j.at_parent) for j in joints if j.parent == body]
        carried += [Mark(p.name, body, p.at) for p in mechanism.points if p.body == body]
        carried += [Mark(s.name, body, s.at_a) for s in springs if s.body_a == body]
        carried += [Mark(s.name, body, s.at_b) for s in springs if s.body_b == body]
        if len(carried) == 1:
            carried += [Mark(body, body, b.center_of_mass) for b in mechanism.bodies if b.name == body]
        yield from carried


def labels(mechanism: Mechanism) -> dict[str, tuple[str, list[str]]]:
    """Dataset labels of the marks: their names and their bodies."""
    drawn = list(marks(mechanism))
    return {"mark": ("mark", [m.name for m in drawn]), "mark_body": ("mark", [m.body for m in drawn])}


def mark_positions(mechanism: PreparedMechanism, time: Scalar, y: Array) -> Float[Array, "marks axes"]:
    """World places of all marks [m] at one state."""
    mechanism = mechanism.at(time)
    motion = frames(mechanism, time, layout(mechanism).split(y))
    axes = len(axes_of(mechanism))
    return jnp.stack([as_array(motion[m.body].point(m.at.vector)[:axes]) for m in marks(mechanism)])


def picture(mechanism: PreparedMechanism, time: Scalar, y: Array) -> dict[str, Array]:
    """The variables of a picture at one state of a prepared mechanism, by their names in a dataset."""
    seen = observe(time, y[: layout(mechanism).size], mechanism)
    shown = {name: seen[name] for name in SHOWN if name in seen}
    return shown | {"mark_position": mark_positions(mechanism, time, y)}
