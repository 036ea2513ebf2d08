"""What one accuracy knob, rtol, allows each component of the state: from the scene's own lengths and speeds."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._types import Scalar
from clearance_jax.mechanism.mechanism import Mechanism, layout, parameters

# Impacts amplify a local error: a tenth of the tolerance in each step keeps every position within 100 rtol.
LOCAL = 0.1
FLOOR = 1e-3
# A contact less deep than this many rtol of the clearance may be passed by.
FIT = 100.0
_EPS = float(np.finfo(np.float64).eps)
# The smallest part of a step that a switch is located to.
SHORTEST = 1e-8


class Scales(NamedTuple):
    """Magnitudes of a scene's motion."""

    length: Array
    spin: Array
    acceleration: Array
    energy: Array


class Tolerances(NamedTuple):
    """Error allowed in one step, per component of `[q, v, memory, books]`: absolute (infinite: not controlled), and
    relative to its size; the components' magnitudes, and the size (in magnitudes) below which the derivative along a
    direction of variation is not resolved relatively; how far past a switch a cut step may end, as a fraction of the
    uncut step; and how far inside a step the overlaps may be from the curves that stand for them, over the clearance.
    """

    absolute: Float[Array, " n"]
    relative: Float[Array, " n"]
    margin: Scalar
    unit: Float[Array, " n"]
    fit: Scalar
    floor: Array | None = None


def largest_length(mechanism: Mechanism) -> Array:
    """The largest length among the mechanism's numbers [m], clearances and points aside; 1 where there is none."""
    sizes = [
        jnp.abs(leaf.value)
        for leaf in parameters(mechanism).values()
        if leaf.metadata["unit"] == "m" and leaf.path[0] != "points" and "clearance" not in leaf.path
    ]
    length = jnp.max(jnp.stack([jnp.asarray(s, float) for s in sizes])) if sizes else jnp.asarray(1.0)
    return jnp.where(length > 0, length, 1.0)


def scales(mechanism: Mechanism, y0: Array, t0: Scalar, t1: Scalar) -> Scales:
    """Largest length of the bodies, fastest spin of drives, start and pendulum, and what follows from them."""
    length = largest_length(mechanism)
    gravity = jnp.hypot(*(jnp.asarray(g, float) for g in mechanism.gravity.vector))
    speeds = [(jnp.sqrt(gravity / length), None)]
    for coordinate in mechanism.coordinates():
        drive = coordinate.motion.drive
        if drive is not None:
            rates = jax.vmap(lambda t, d=drive: jnp.asarray(d(t)[1], float))(jnp.linspace(t0, t1, 33))
            speeds.append((jnp.max(jnp.abs(rates)), coordinate.slides))
    n = layout(mechanism).free
    speeds += [(jnp.abs(y0[n + i]), c.slides) for i, c in enumerate(mechanism.free_coordinates())]
    spin = jnp.max(jnp.stack([speed if slides is None else speed / length for speed, slides in speeds]))
    spin = jnp.where(spin > 0, spin, 1 / (t1 - t0))
    mass = sum((jnp.asarray(b.mass) for b in mechanism.bodies if b.mass is not None), jnp.zeros(()))
    inertia = sum((jnp.asarray(b.inertia) for b in mechanism.bodies if b.inertia is not None), jnp.zeros(()))
    energy = mass * (spin * length) ** 2 + inertia * spin**2
    return Scales(length, spin, jnp.maximum(gravity, spin * spin * length), energy)


def floors(varied: Any, directions: Any, unit: Array) -> Float[Array, " directions"]:
    """Size of a derivative (in magnitudes of the state) from which on its error is controlled relative to itself.

    A thousandth of the motion for a change of the number by itself (by one, for a zero). Without a floor the first
    instants after a touch, where a derivative grows from nothing as a power of time, could never be resolved.
    """
    total = jnp.zeros(jax.tree.leaves(directions)[0].shape[0])
    mechanism, y0 = eqx.filter(varied, jax.tree.map(lambda d: d is not None, directions, is_leaf=lambda d: d is None))
    moved, pushed = directions
    for value, rows in zip(jax.tree.leaves(mechanism), jax.tree.leaves(moved), strict=True):
        size = jnp.where(value == 0, 1.0, jnp.abs(value))
        total += jnp.sum(jnp.abs(rows) / size[None], axis=tuple(range(1, rows.ndim)))
    if y0 is not None:
        magnitude = jnp.where(jnp.isfinite(unit), unit, 1.0)[: y0.shape[0]]
        total += jnp.sum(jnp.abs(pushed) / magnitude[None], axis=1)
    return FLOOR * total


def switch_margin(mechanism: Mechanism, rtol: Scalar, varied: bool = False) -> Scalar:
    """How far past a switch a cut step may end. What is left of the switch inside the step costs an error of second
    order in the margin; of first order where a force jumps, and in derivatives where its slope jumps.
    """
    joints = [j.clearance for j in mechanism.clearance_joints() if j.clearance]
    laws = [law for joint in joints for law in (joint.normal, joint.friction)]
    jumps = any(law is not None and law.smoothness == "C-1" for law in laws)
    return jnp.clip(rtol if jumps or varied else jnp.sqrt(rtol), SHORTEST, 1e-3)


def tolerances(
    mechanism: Mechanism, y0: Array, t0: Scalar, t1: Scalar, rtol: Scalar, atol: Any, books: int, varied: bool = False
) -> Tolerances:
    """Absolute tolerances from the scene's scales, and relative ones where the scale is not known beforehand
    (velocities, and penetrations that may exceed a tiny clearance). `atol` (per component) overrides the absolute ones.

    The books (so many components more) judge a solve and do not steer it: with them in the error norm they closed no
    better. Only where there is no state at all are they what the steps must be chosen for.
    """
    size = scales(mechanism, y0, t0, t1)
    clearances = {j.name: j.clearance.radial_clearance for j in mechanism.clearance_joints() if j.clearance}
    position, velocity, adapt = [], [], []
    for coordinate in mechanism.free_coordinates():
        c = clearances.get(coordinate.name.rpartition(".")[0])
        if c is not None:
            position.append(c)
            velocity.append(jnp.maximum(size.spin * c, jnp.sqrt(2 * size.acceleration * c)))
        else:
            turns = coordinate.slides is None
            position.append(jnp.asarray(1.0) if turns else size.length)
            velocity.append(size.spin if turns else size.spin * size.length)
        adapt.append(0.0 if c is None else 1.0)
    memory = [j.clearance.memory_scale() for j in mechanism.clearance_joints() if j.clearance]
    unit = jnp.concatenate([jnp.stack(position + velocity) if position else jnp.zeros(0), *memory])
    local = LOCAL * rtol
    absolute = local * unit if atol is None else jnp.broadcast_to(jnp.asarray(atol, float), unit.shape)
    relative = jnp.concatenate([jnp.asarray(adapt), jnp.ones(len(adapt)), *(jnp.zeros_like(m) for m in memory)])
    judged = jnp.where((not adapt) & (size.energy > 0), local * size.energy, jnp.inf)
    absolute = jnp.concatenate([absolute, jnp.broadcast_to(judged, (books,))])
    relative = jnp.concatenate([local * relative, jnp.zeros(books)])
    unit = jnp.concatenate([unit, jnp.broadcast_to(jnp.where(jnp.isfinite(judged), size.energy, jnp.inf), (books,))])
    sizes = list(clearances.values())
    # Where the surfaces are is known to the round-off of lengths and of angles turned, however short the step.
    turned = 1 + size.spin * jnp.maximum(jnp.abs(t0), jnp.abs(t1))
    noise = 64 * _EPS * size.length * turned / jnp.min(jnp.stack(sizes)) if sizes else 0.0
    fit = jnp.clip(FIT * rtol, noise, jnp.maximum(noise, 0.1))
    return Tolerances(absolute, relative, switch_margin(mechanism, rtol, varied), unit, fit)
