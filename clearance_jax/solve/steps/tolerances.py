"""Tolerances of each component of the state, from rtol and the scene's own lengths and speeds."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.types import Each, Flag, Scalar
from clearance_jax.dynamics.field import BALANCE_TERMS
from clearance_jax.dynamics.gaps import terms_of
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.gaps import CoordinateGap
from clearance_jax.mechanism.placement import Inertia
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import effort_sources, layout, parts
from clearance_jax.parameters import parameters
from clearance_jax.solve.steps.problem import Problem, widths
from clearance_jax.spatial import Vector, is_zero

# Impacts amplify a local error: a tenth of the tolerance in each step keeps every position within 100 rtol.
LOCAL = 0.1
FLOOR = 1e-3
# A contact less deep than this many rtol of the clearance may be passed by.
FIT = 10.0
_EPS = float(np.finfo(np.float64).eps)
# The smallest rtol. A step's error is compared with a tenth of it, which is then five units of round-off. Below, steps
# multiply and errors do not fall.
SMALLEST = 1e-14
# With derivatives a step beside an event may collapse at a smaller one: a slope that jumps there can then not be told
# from one that does not.
CLOSEST = 1e-12
# The parts of a step, at least and at most, by which a cut step ends past its event.
SHORTEST, LONGEST = 1e-8, 1e-2


class Scales(NamedTuple):
    """Magnitudes of a scene's motion."""

    length: Array
    spin: Array
    acceleration: Array
    energy: Array


class Tolerances(NamedTuple):
    """Tolerances of a solve, by component of the state and its quadratures, and others.

    - `absolute` error in one step (infinite: not controlled), and `relative` to the component's size.
    - `unit`: the components' magnitudes; `floor`: the size (in magnitudes) below which the derivative along a direction
      of variation is not resolved relatively.
    - `margin`: how far past an event a cut step may end, as a fraction of the step that may follow.
    - `fit`: the allowed misfit of the pins' curves inside a step, over the clearance; `noise`: the misfit by round-off
      alone.
    - `rate`: how fast the scene moves [1/s].
    """

    absolute: Float[Array, "n ..."]
    relative: Float[Array, "n ..."]
    unit: Float[Array, "n ..."]
    margin: Each
    fit: Each
    noise: Each
    rate: Each
    floor: Array | None = None


def largest_length(mechanism: AbstractMechanism, of: Any = jnp) -> Any:
    """The largest length among the mechanism's numbers [m], without clearances and points; 1 if there is none. `of`:
    NumPy if the numbers are known and nothing is to be compiled.
    """
    sizes = [
        of.abs(of.asarray(leaf.value))
        for leaf in parameters(mechanism).values()
        if leaf.metadata["unit"] == "m" and leaf.path[0] != "points" and "clearance" not in leaf.path
    ]
    length = of.max(of.stack([of.asarray(s, float) for s in sizes])) if sizes else of.asarray(1.0)
    return of.where(length > 0, length, 1.0)


def scales(mechanism: PreparedMechanism, y0: Array, t0: Scalar, t1: Scalar) -> Scales:
    """Magnitudes of a motion, from the bodies' largest length and the fastest spin of drives, start and pendulum."""
    length = largest_length(mechanism)
    gravity = _size(mechanism.gravity.vector)
    speeds = [(jnp.sqrt(gravity / length), None)]
    for coordinate in mechanism.coordinates():
        drive = coordinate.motion.drive
        if drive is not None:
            times = t0 + (t1 - t0) * jnp.asarray(np.linspace(0.0, 1.0, 33))
            rates = jax.vmap(lambda t, d=drive: jnp.asarray(d(t)[1], float))(times)
            speeds.append((jnp.max(jnp.abs(rates)), coordinate.slides))
    moving = layout(mechanism).split(y0).v
    speeds += [(jnp.abs(v), c.slides) for c, _, places in parts(mechanism) for v in moving[places]]
    spin = jnp.max(jnp.stack([speed if slides is None else speed / length for speed, slides in speeds]))
    spin = jnp.where(spin > 0, spin, 1 / (t1 - t0))
    mass = sum((jnp.asarray(b.mass) for b in mechanism.bodies if b.mass is not None), jnp.zeros(()))
    inertia = sum((_largest(b.inertia) for b in mechanism.bodies if b.inertia is not None), jnp.zeros(()))
    energy = mass * (spin * length) ** 2 + inertia * spin**2
    return Scales(length, spin, jnp.maximum(gravity, spin * spin * length), energy)


def _size(vector: Vector) -> Array:
    """The length of a vector."""
    x, y, z = vector
    plane = jnp.hypot(jnp.asarray(x, float), jnp.asarray(y, float))
    return plane if is_zero(z) else jnp.hypot(plane, jnp.asarray(z, float))


def _largest(inertia: Array | Inertia) -> Array:
    """The largest moment of inertia."""
    if isinstance(inertia, Inertia):
        return jnp.maximum(jnp.maximum(inertia.xx, inertia.yy), inertia.zz)
    return jnp.asarray(inertia)


def are_resolved(rtol: Scalar, atol: Any, allowed: Tolerances) -> Flag:
    """Whether floats resolve the tolerances, by `rtol` or the `atol` that overrides it."""
    good = (rtol >= SMALLEST) & (rtol < 1)
    if atol is None:
        return good
    unit = jnp.where(jnp.isfinite(allowed.unit), allowed.unit, 0.0)
    enough = allowed.absolute + allowed.relative * unit >= LOCAL * SMALLEST * unit
    return good & jnp.all(enough) & jnp.all(jnp.asarray(atol) > 0)


def floors(varied: Any, directions: Any, unit: Array) -> Float[Array, " directions"]:
    """Size of a derivative (in magnitudes of the state) above which its error is controlled relative to itself.

    It is a thousandth of the motion for a change of the number by itself (by one, for a zero). Without a floor, a
    derivative that grows from zero after a touch as a power of time could not be resolved.
    """
    total = jnp.zeros(jax.tree.leaves(directions)[0].shape[0])
    model, y0 = eqx.filter(varied, jax.tree.map(lambda d: d is not None, directions, is_leaf=lambda d: d is None))
    moved, pushed = directions
    for value, rows in zip(jax.tree.leaves(model), jax.tree.leaves(moved), strict=True):
        size = jnp.where(value == 0, 1.0, jnp.abs(value))
        total += jnp.sum(jnp.abs(rows) / size[None], axis=tuple(range(1, rows.ndim)))
    if y0 is not None:
        magnitude = jnp.where(jnp.isfinite(unit), unit, 1.0)[: y0.shape[0]]
        total += jnp.sum(jnp.abs(pushed) / magnitude[None], axis=1)
    return FLOOR * total


def _gap_sizes(mechanism: PreparedMechanism) -> tuple[dict[str, Array], dict[str, Array]]:
    """By coordinate the size of its own backlash; and of that in the least of its meshes, seen from it."""
    drives, meshed = {}, {}
    for gap in mechanism.gaps:
        if not (gap.is_play or gap.what == "teeth"):
            continue
        for name, factor in terms_of(gap):
            if len(gap.coordinates) == 1:
                drives[name] = gap.size
            else:
                meshed[name] = jnp.minimum(meshed.get(name, jnp.inf), gap.size / jnp.abs(jnp.asarray(factor)))
    return drives, meshed


def _balance_scales(mechanism: PreparedMechanism, energy: Array, moves: bool) -> tuple[Array, np.ndarray]:
    """By term of the energy balance the magnitude by which it is controlled (infinite: not at all) and the part of its
    own size that counts beside it.
    """
    prescribed = {c.name for c in mechanism.coordinates() if not c.motion.is_free}
    unfelt = any(gap.loss is not None and gap.motor in prescribed for gap in mechanism.gaps)
    judged = np.array([not moves or (unfelt and term == "friction_loss") for term in BALANCE_TERMS])
    scale = FLOOR * energy if moves else energy
    return jnp.where(judged & (energy > 0), scale, jnp.inf), 1.0 * (judged & moves)


def tolerances(problem: Problem, y0: Array, t0: Scalar, t1: Scalar, rtol: Scalar, atol: Any = None) -> Tolerances:
    """Absolute tolerances from the scene's scales, and relative ones where the scale is not known beforehand
    (velocities, and penetrations that may exceed a tiny clearance). `atol` (by component of the state) overrides the
    absolute ones; `y0`: the state of the motion at the start.

    The energy balance judges a solve but does not control its steps, which would not improve it; only a mechanism
    without states takes its steps from it, and one with a loss of which the motion feels nothing those for its
    friction. Integrals are controlled by their signals' scales.
    """
    mechanism = problem.mechanism
    size, joints = scales(mechanism, y0, t0, t1), mechanism.contacts()
    position, velocity, adapt = [], [], []
    drives, meshed = _gap_sizes(mechanism)
    for coordinate in mechanism.free_coordinates():
        turns, c = coordinate.slides is None, drives.get(coordinate.name, coordinate.play)
        if c is not None:
            slow = size.spin * c
            position.append(c)
            # A link crosses its gap as a pin does; a tilt is slower.
            fall = size.acceleration / size.length if coordinate.name in drives and turns else size.acceleration
            is_tilt = turns and coordinate.name not in drives
            velocity.append(slow if is_tilt else jnp.maximum(slow, jnp.sqrt(2 * fall * c)))
        else:
            least = meshed.get(coordinate.name, jnp.inf)
            position += [jnp.minimum(1.0 if turns else size.length, least)] * len(coordinate.positions)
            velocity += [size.spin if turns else size.spin * size.length] * len(coordinate.velocities)
        adapt += [0.0 if c is None else 1.0] * len(coordinate.positions)
    memory = [scale for joint in joints for scale in joint.clearance.memory_scale()]
    turning = {c.name: c.slides is None for c in mechanism.moved_coordinates()}
    integrating = [s.coordinates[0] for s in effort_sources(mechanism) if s.integrates]
    memory += [(1.0 if turning[name] else size.length) / size.spin for name in integrating]
    memory += [jnp.asarray(jnp.inf)] * layout(mechanism).held  # which a step does not change
    unit = jnp.stack([*position, *velocity, *memory]) if position or memory else jnp.zeros(0)
    local = LOCAL * rtol
    absolute = local * unit if atol is None else jnp.broadcast_to(jnp.asarray(atol, float), unit.shape)
    grows = [growth for joint in joints for growth in joint.clearance.memory_growth()]
    grows += [0.0] * (len(memory) - len(grows))
    relative = local * jnp.asarray([*adapt, *[1.0] * len(velocity), *grows])
    judged, part = _balance_scales(mechanism, size.energy, bool(adapt))
    signals = [
        jnp.broadcast_to((t1 - t0) * f.scale(mechanism), (width,))
        for f, width in zip(problem.integrands, widths(problem), strict=True)
    ]
    judged, part = (x[: len(BALANCE_TERMS) if problem.energy_balance else 0] for x in (judged, part))
    added = jnp.concatenate([judged, *signals])
    allowed = jnp.concatenate([local * judged, *(rtol * unit for unit in signals)])
    # The surfaces' places are known to the round-off of lengths and of angles turned, however short the step.
    turned = 1 + size.spin * jnp.maximum(jnp.abs(t0), jnp.abs(t1))
    joints = [joint for joint in joints if not isinstance(joint, CoordinateGap) or joint.is_play]
    lengths = [1.0 if isinstance(joint, CoordinateGap) and joint.turns else size.length for joint in joints]
    fuzzy = [length / joint.size for joint, length in zip(joints, lengths, strict=True)]
    noise = 64 * _EPS * turned * (jnp.max(jnp.stack(fuzzy)) if fuzzy else 0.0)
    # The event left in a cut step causes an error of second order in the margin, of first order if a force jumps, or in
    # derivatives if its slope jumps.
    first_order = problem.varies or any(law.smoothness == "C-1" for joint in mechanism.contacts() for law in joint.laws)
    return Tolerances(
        absolute=jnp.concatenate([absolute, allowed]),
        relative=jnp.concatenate([relative, local * part, jnp.zeros(len(added) - len(part))]),
        unit=jnp.concatenate([unit, added]),
        margin=jnp.clip(rtol if first_order else jnp.sqrt(rtol), SHORTEST, LONGEST),
        fit=jnp.clip(FIT * rtol, noise, jnp.maximum(noise, 0.1)),
        noise=noise,
        rate=size.spin,
    )
