"""Kinematics of the links of a table: a loop over them, starting at the ground."""

import functools
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.numerics import sincos
from clearance_jax._basis.types import Scalar
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, parts
from clearance_jax.mechanism.tree.links import Links, Order, rodrigues
from clearance_jax.mechanism.tree.moved import Moved, swing_rates
from clearance_jax.spatial import Term, as_array, matrix, of_quaternion, put, swing, three


class Motions(NamedTuple):
    """By link: rotation, place, spin, velocity, and the rates of the last two without the free accelerations."""

    rotation: Array
    place: Array
    spin: Array
    velocity: Array
    spin_rate: Array
    acceleration: Array


class Given(NamedTuple):
    """By link: value, rate and prescribed acceleration of its coordinate (zero for balls); `turned`: rotation matrices
    of balls by link; `spins`: spins of balls in the link's own axes.
    """

    values: list[Term]
    rates: list[Term]
    accelerations: list[Term]
    turned: dict[int, Array]
    spins: list[Array]


def given_motion(mechanism: PreparedMechanism, plan: Order, time: Scalar, state: State, known: Sequence[Term]) -> Given:
    """The motion of the links' coordinates, from drives and the state; `known`: accelerations of its velocities."""
    free = {part.coordinate.name: part for part in parts(mechanism)}
    moved, turned = [], {}
    for i, c in enumerate(plan.coordinates):
        part, spin, q, v, a = free.get(c.name), jnp.zeros(3), 0.0, 0.0, 0.0
        if part is None:
            assert c.motion.drive is not None
            q, v, a = c.motion.drive(time)
        elif c.is_ball:
            w, x, y, z = state.q[part.q]
            turned[i] = matrix(of_quaternion(w, x, y, z))
            spin = as_array(state.v[part.v])
        else:
            q, v, a = state.q[part.q.start], state.v[part.v.start], known[part.v.start]
        moved.append((q, v, a, spin))
    values, rates, accelerations, spins = (list(each) for each in zip(*moved, strict=True))
    return Given(values, rates, accelerations, turned, spins)


class Swept(NamedTuple):
    """By link: `rates` and own `axes` of its coordinate; and the `motions` of all links, the ground behind them."""

    rates: list[Term]
    axes: Array
    motions: Motions


def sweep(plan: Order, links: Links, now: Given) -> Swept:
    """Pose and motion of all links, whose coordinates move as `given_motion` says."""
    count = len(plan.coordinates)
    turning = np.array([float(c.turns is not None and not c.swings) for c in plan.coordinates])
    sliding = np.array([float(c.slides is not None) for c in plan.coordinates])
    q, v, a = as_array(now.values), as_array(now.rates), as_array(now.accelerations)
    sine, cosine = sincos(turning * q)
    inner = rodrigues(links.axis, sine, cosine)
    if now.turned:
        inner = put(inner, np.array(list(now.turned)), jnp.stack(list(now.turned.values())))
    # By link, in its own axes: the spin that its coordinate adds, and the rate of that.
    spins, spin_rates = ((turning * rate)[:, None] * links.axis for rate in (v, a))
    spins, axes = spins + jnp.stack(now.spins), links.axis
    first = plan.swings
    if first.size:
        tilts = [(three(links.axis[i].T), q[i], v[i], a[i]) for i in (first, first + 1)]
        (about_x, *x), (about_y, *y) = tilts
        by = Moved(-1, (x[0], y[0]), (x[1], y[1]), (x[2], y[2]))
        at = swing(about_x, about_y, *by.q)
        spin, faster = swing_rates(at, by)
        inner = put(inner, first, jnp.moveaxis(jnp.asarray(at.rows), -1, 0))
        spins = put(spins, first, jnp.stack(spin, -1))
        spin_rates = put(spin_rates, first, jnp.stack(faster, -1))
        for k, axis in enumerate(at.inside):
            axes = put(axes, first + k, jnp.stack(axis, -1))
    given = (
        np.array([parent if parent >= 0 else count for parent in plan.parents]),
        np.arange(count),
        multiply_each(links.turned, inner),
        links.offset,
        (sliding * q)[:, None] * links.axis,
        (sliding * v)[:, None] * links.axis,
        (sliding * a)[:, None] * links.axis,
        spins,
        spin_rates,
    )
    # One array, with one row read and one written in a turn: with one for each quantity it takes 1.5 times as long.
    ground = jnp.concatenate([jnp.eye(3), jnp.zeros((5, 3))])
    begin = jnp.broadcast_to(ground, (count + 1, *ground.shape))

    def once(motions: Array, link):
        parent, i, within, offset, slide, slide_rate, slide_acceleration, own_spin, own_spin_rate = link
        at = _motions(motions[parent])
        rotation = at.rotation @ within
        moved, step = rotation @ slide_rate, rotation @ slide
        arm = at.rotation @ offset + step
        spin = rotation @ own_spin
        vectors = (
            at.place + arm,
            at.spin + spin,
            at.velocity + jnp.cross(at.spin, arm) + moved,
            at.spin_rate + jnp.cross(at.spin, spin) + rotation @ own_spin_rate,
            at.acceleration
            + jnp.cross(at.spin_rate, arm)
            + jnp.cross(at.spin, jnp.cross(at.spin, arm) + 2 * moved)
            + rotation @ slide_acceleration,
        )
        new = jnp.concatenate([rotation, jnp.stack(vectors)])
        return jax.lax.dynamic_update_index_in_dim(motions, new, i, 0), None

    return Swept(now.rates, axes, _motions(jax.lax.scan(once, begin, given)[0]))


def _motions(rows: Float[Array, "*links 8 3"]) -> Motions:
    """Motions by the rows of their rotations and their five vectors."""
    return Motions(rows[..., :3, :], *(rows[..., k, :] for k in range(3, 8)))


def multiply_each(a: Float[Array, "n 3 3"], b: Float[Array, "n 3 3"]) -> Float[Array, "n 3 3"]:
    """The products of matrices, term by term: a library's call, as XLA makes it of large ones, ends a compiled loop."""
    return add_up(a[:, :, k, None] * b[:, k, None, :] for k in range(3))


def add_up(terms: Iterable[Array]) -> Array:
    """The sum of arrays of one shape."""
    return functools.reduce(jnp.add, terms)
