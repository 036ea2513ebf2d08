"""Where a mechanism's parts are: what its picture, and that of its pins in their sleeves, is drawn from."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._types import Scalar
from clearance_jax.dynamics.kinematics import Frames, frames, plays, sleeve_rotation
from clearance_jax.dynamics.observe import axes_of
from clearance_jax.mechanism.body import GROUND, Body, Spring
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import Position
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.mechanism.tree import Prismatic
from clearance_jax.metrics.measure import AbstractMetric, Request
from clearance_jax.results.marks import carried, place
from clearance_jax.spatial import Vector, as_array


class Places(NamedTuple):
    """World places [m] along every axis of the mechanism (two in the plane, three in space), each array with a leading
    axis of times where many states are looked at.

    - `bodies`: of each body, by name, what it carries: joints, named points, ends of springs, shape (k, axes).
    - `joints`: by name, (axes,), `slides`: by name of a sliding joint, the direction that it slides along, (axes,).
    - `points`, `springs` (both ends, (2, axes)): by name.
    - `pins`: what each clearance joint's pin does.
    """

    bodies: dict[str, Float[Array, "*n k axes"]]
    joints: dict[str, Float[Array, "*n axes"]]
    slides: dict[str, Float[Array, "*n axes"]]
    points: dict[str, Float[Array, "*n axes"]]
    springs: dict[str, Float[Array, "*n 2 axes"]]
    pins: dict[str, "Pin"]


class Pin(NamedTuple):
    """A pin in its sleeve, in the sleeve's axes: `place` of its centre from the sleeve's [m], how its axis leans
    (`lean`, slopes along x and y), the `force` on it [N] and the `moment` about its centre [N m]; its `normal_force`
    [N], of all contact points together.
    """

    place: Float[Array, "*n 3"]
    lean: Float[Array, "*n 2"]
    force: Float[Array, "*n 3"]
    moment: Float[Array, "*n 3"]
    normal_force: Float[Array, " *n"]


class PlacesOverTime(AbstractMetric):
    """`Places` at given times [s], increasing."""

    times: Float[Array, " times"] = eqx.field(converter=lambda t: jnp.asarray(t, float))

    def request(self, mechanism, t1, options):
        return Request(times=self.times)

    def value(self, reply):
        ready = reply.mechanism.prepared()
        return jax.vmap(lambda time, y: places_at(time, y, ready))(self.times, reply.solution.y)


def places_at(time: Scalar, y: Array, mechanism: PreparedMechanism) -> Places:
    """Of one state."""
    state = layout(mechanism).split(y)
    motion, axes = frames(mechanism, time, state), len(axes_of(mechanism))

    def row(vector: Vector) -> Array:
        return as_array(vector[:axes])

    pins, found = {}, plays(mechanism, time, state, motion)
    for joint in mechanism.clearance_joints():
        at = found[joint.name].relative
        action = joint.clearance.act(at, state.memory[joint.name])
        lean = as_array(at.axis[:2]) / as_array([at.axis[2]])
        exerted = as_array(action.force), as_array(action.torque)
        pins[joint.name] = Pin(as_array(at.place), lean, *exerted, action.normal_force)
    return Places(
        {body.name: jnp.stack([row(at) for at in _carried(mechanism, body, motion)]) for body in mechanism.bodies},
        {j.name: row(motion[j.child].point(j.at_child.vector)) for j in mechanism.all_joints()},
        {j.name: row(sleeve_rotation(j, motion).apply(j.axis.vector)) for j in _slides(mechanism)},
        {p.name: row(motion[p.body].point(p.at.vector)) for p in mechanism.points},
        {
            spring.name: jnp.stack([row(motion[body].point(at.vector)) for body, at in _ends(spring)])
            for spring in mechanism.springs
        },
        pins,
    )


def grounded(mechanism: Mechanism) -> frozenset[str]:
    """Names of the joints that hold something on the ground."""
    return frozenset(j.name for j in mechanism.all_joints() if GROUND in (j.parent, j.child))


def _carried(mechanism: PreparedMechanism, body: Body, motion: Frames) -> list[Vector]:
    """Where what a body carries is, sliders on it too."""
    found = [place(mark, motion) for mark in carried(mechanism, body.name)]
    return found + [motion[j.child].point(j.at_child.vector) for j in _slides(mechanism) if j.parent == body.name]


def _slides(mechanism: PreparedMechanism) -> list[Prismatic]:
    return [joint for joint in mechanism.joints if isinstance(joint, Prismatic)]


def _ends(spring: Spring) -> tuple[tuple[str, Position], tuple[str, Position]]:
    return (spring.body_a, spring.at_a), (spring.body_b, spring.at_b)
