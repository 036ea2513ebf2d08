"""Where a mechanism's parts are: what its picture, and that of its pins in their sleeves, is drawn from."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._types import Scalar
from clearance_jax.analysis.measure import AbstractMetric, Request
from clearance_jax.dynamics.kinematics import Frames, frames, play, sleeve_rotation
from clearance_jax.mechanism.body import GROUND, Body, Spring
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import Position
from clearance_jax.mechanism.state import layout
from clearance_jax.mechanism.tree import AbstractJoint, Prismatic
from clearance_jax.spatial import Pair, Vector, as_array


class Places(NamedTuple):
    """World places [m], each array with a leading axis of times where many states are looked at; of a mechanism in
    space seen along z.

    - `bodies`: of each body, by name, what it carries: joints, named points, ends of springs, shape (k, 2).
    - `joints`: by name, (2,), `slides`: by name of a sliding joint, the direction that it slides along, (2,).
    - `points`, `springs` (both ends, (2, 2)): by name.
    - `pins`: of each clearance joint, the pin's centre from the sleeve's in the sleeve's axes; `forces`: its normal
      force [N].
    """

    bodies: dict[str, Float[Array, "*n k 2"]]
    joints: dict[str, Float[Array, "*n 2"]]
    slides: dict[str, Float[Array, "*n 2"]]
    points: dict[str, Float[Array, "*n 2"]]
    springs: dict[str, Float[Array, "*n 2 2"]]
    pins: dict[str, Float[Array, "*n 2"]]
    forces: dict[str, Float[Array, " *n"]]


class PlacesOverTime(AbstractMetric):
    """`Places` at given times [s], increasing."""

    times: Float[Array, " times"] = eqx.field(converter=lambda t: jnp.asarray(t, float))

    def request(self, mechanism, t1, options):
        return Request(times=self.times)

    def value(self, reply):
        ready = reply.mechanism.prepared()
        return jax.vmap(lambda time, y: places_at(time, y, ready))(self.times, reply.solution.y)


def places_at(time: Scalar, y: Array, mechanism: Mechanism) -> Places:
    """Of one state of a prepared mechanism."""
    state = layout(mechanism).split(y)
    motion = frames(mechanism, time, state)
    pins, forces = {}, {}
    for joint in mechanism.clearance_joints():
        at = play(mechanism, joint, time, state, motion).relative
        pins[joint.name] = _row(at.place)
        forces[joint.name] = joint.clearance.act(at, state.memory[joint.name]).normal_force
    return Places(
        {body.name: _carried(mechanism, body, motion) for body in mechanism.bodies},
        {j.name: _row(motion[j.child].point(j.at_child.vector)) for j in mechanism.all_joints()},
        {j.name: _axis(j, motion) for j in mechanism.joints if isinstance(j, Prismatic)},
        {p.name: _row(motion[p.body].point(p.at.vector)) for p in mechanism.points},
        {
            spring.name: jnp.stack([_row(motion[body].point(at.vector)) for body, at in _ends(spring)])
            for spring in mechanism.springs
        },
        pins,
        forces,
    )


def grounded(mechanism: Mechanism) -> frozenset[str]:
    """Names of the joints that hold something on the ground."""
    return frozenset(j.name for j in mechanism.all_joints() if GROUND in (j.parent, j.child))


def _carried(mechanism: Mechanism, body: Body, motion: Frames) -> Array:
    """What a body carries; a body that carries one thing only has its centre of mass beside it."""
    joints = mechanism.all_joints()
    found = [j.at_child.vector for j in joints if j.child == body.name]
    found += [j.at_parent.vector for j in joints if j.parent == body.name]
    found += [p.at.vector for p in mechanism.points if p.body == body.name]
    found += [s.at_a.vector for s in mechanism.springs if s.body_a == body.name]
    found += [s.at_b.vector for s in mechanism.springs if s.body_b == body.name]
    if len(found) == 1:
        found.append(body.center_of_mass.vector)
    return jnp.stack([_row(motion[body.name].point(at)) for at in found])


def _ends(spring: Spring) -> tuple[tuple[str, Position], tuple[str, Position]]:
    return (spring.body_a, spring.at_a), (spring.body_b, spring.at_b)


def _axis(joint: AbstractJoint, motion: Frames) -> Array:
    assert isinstance(joint, Prismatic)
    return _row(sleeve_rotation(joint, motion).apply(joint.axis.vector))


def _row(vector: Vector | Pair) -> Array:
    return as_array(vector[:2])
