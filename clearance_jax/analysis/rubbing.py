"""Where and how hard a pin rubs on its sleeve along a solved motion, at the nodes of a quadrature over time.

Every touch and every separation is the end of a step. Within a step only the speed of sliding has a kink, where the
slip changes its sign. So each step is cut there (or in its middle), and each of the two parts has three Gauss nodes.
States at the nodes lie on the quintic through places, rates and accelerations at both ends of the step. If a patch
moves too far from one node to the next, the parts are cut further.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.numerics import safe_sqrt
from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.field import slope
from clearance_jax.dynamics.kinematics import relative_motions
from clearance_jax.errors import ClearanceError, unknown_name
from clearance_jax.joints import AbstractPin, Relative, Sections
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.drivers.trace import Trace
from clearance_jax.solve.steps.interpolate import between
from clearance_jax.solve.steps.step import latch

# Bisections that find a change of a slip's sign within a step.
HALVINGS = 40
# Steps in one call of the compiled program.
CHUNK = 64


class Contacts(NamedTuple):
    """When and how a pin rubs in its sleeve.

    - `time` since the motion began [s]: nodes in the steps, and `weight` [s]: the time that each stands for, shape
      (times,).
    - Of every section of the sleeve, shape (times, sections): normal `force` [N], at least 0; `angle` of its direction
      around the sleeve [rad]; `speed` of the pin's surface on the sleeve's [m/s]; `traction`: the ratio |T| / N.
    - `place` of the pin's centre [m], shape (times, sections, 2).
    - `turn` [rad], shape (times,): how far the pin is turned in its sleeve; `None`: not at all.
    """

    time: Float[Array, " times"]
    weight: Float[Array, " times"]
    force: Float[Array, "times sections"]
    angle: Float[Array, "times sections"]
    speed: Float[Array, "times sections"]
    traction: Float[Array, "times sections"]
    place: Float[Array, "times sections 2"]
    turn: Float[Array, " times"] | None = None


def sections_of(mechanism: Mechanism, joint: str) -> Sections:
    """The sections of a joint's sleeve that wear.

    **Arguments:** `mechanism`; `joint`: its name.

    **Raises:** `ClearanceError` for a joint that is no pin in a sleeve, or has no length.
    """
    pin = pin_of(mechanism, joint)
    try:
        return pin.sections()
    except ClearanceError as error:
        raise error.at(f"Joint `{joint}`") from None


def pin_of(mechanism: Mechanism, name: str) -> AbstractPin:
    """The clearance of a joint. **Raises** `ClearanceError` for a joint that is no pin in a sleeve."""
    known = {joint.name: joint.clearance for joint in mechanism.clearance_joints()}
    if name not in known:
        raise unknown_name(f"There is no clearance joint `{name}`.", name, known)
    if not isinstance(pin := known[name], AbstractPin):
        raise ClearanceError(f"`{name}` is no pin in a sleeve: its wear is not known.")
    return pin


def contacts(trace: Trace, joint: str, parts: int = 1) -> Contacts:
    """When and how a pin rubs in a joint along a trace, at 6 nodes a step.

    **Arguments:** `trace`: of the motion; `joint`: its name; `parts`: multiplies the number of nodes.

    **Raises:** `ClearanceError` for a joint that is no pin in a sleeve.
    """
    mechanism = trace.solution.mechanism
    pin_of(mechanism, joint)
    size, count = layout(mechanism).size, trace.time.size - 1
    time, y = np.asarray(trace.time), np.asarray(trace.y)[:, :size]
    chunks = []
    for first in range(0, count, CHUNK):
        # The last chunk is filled up with steps of no length.
        taken = np.minimum(np.arange(first, first + CHUNK + 1), count)
        seen = _look(mechanism, joint, jnp.asarray(time[taken]), jnp.asarray(y[taken]), parts)
        kept = A_STEP * parts * (min(first + CHUNK, count) - first)
        chunks.append(jax.tree.map(lambda x, kept=kept: np.asarray(x)[:kept], seen))
    whole = Contacts(*(jnp.asarray(np.concatenate(part)) for part in zip(*chunks, strict=True)))
    return whole._replace(time=whole.time - time[0])


def look(mechanism: Mechanism, joint: str, times: Array, states: Array) -> Contacts:
    """As `contacts`, from step ends, a multiple of `CHUNK` of them; with derivatives by mechanism and states, which the
    energy balance may follow.
    """
    states = states[:, : layout(mechanism).size]
    # Ends of the steps of each chunk, which begins where the one before it ends; the last one has a step of no length.
    ends = np.arange(times.shape[0]).reshape(-1, CHUNK)
    ends = np.minimum(np.concatenate([ends, ends[:, -1:] + 1], axis=1), times.shape[0] - 1)
    seen = jax.lax.map(lambda chunk: _look(mechanism, joint, chunk[0], chunk[1], 1), (times[ends], states[ends]))
    whole = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), seen)
    return whole._replace(time=whole.time - times[0])


def largest_swing(seen: Contacts, angle: Array, allowed: Array, parts: int) -> Array:
    """The largest motion of a patch from one node to the next of its step, over what is allowed at the two nodes.
    `angle` of the patch and `allowed` [rad] have the shape (times, sections).
    """
    steps = -1, A_STEP * parts
    angle, allowed, force = (values.reshape(*steps, *values.shape[1:]) for values in (angle, allowed, seen.force))
    moved = angle[:, 1:] - angle[:, :-1]
    moved = jnp.abs(moved - 2 * np.pi * jnp.round(moved / (2 * np.pi)))
    both = (force[:, 1:] > 0) & (force[:, :-1] > 0)
    return jnp.max(jnp.where(both, moved / jnp.minimum(allowed[:, 1:], allowed[:, :-1]), 0.0), initial=0.0)


# Two parts of a step, of three nodes each.
A_STEP = 6
NODES = np.sqrt(0.6) * np.array([-0.5, 0.0, 0.5]) + 0.5
WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18


@eqx.filter_jit
def _look(mechanism: Mechanism, name: str, times: Array, states: Array, parts: int) -> Contacts:
    """The contacts in the steps between times [s], one after another."""
    nodes = ((np.arange(parts)[:, None] + NODES) / parts).ravel()
    shares = np.tile(WEIGHTS / parts, parts)
    ready = mechanism.prepare()
    plan, joints = layout(mechanism), ready.clearance_joints()
    index = [joint.name for joint in joints].index(name)
    clearance = joints[index].clearance
    pin = clearance.joint

    def of_step(t0: Scalar, t1: Scalar, y0: Array, y1: Array):
        h = t1 - t0
        begin = slope(t0, y0, ready)
        if plan.is_latched:
            y0 = latch(t0, y0, begin, ready)
            begin = slope(t0, y0, ready)
        # At the end itself a drive may have jumped already.
        ends = y0, y1, begin, slope(t1 - 4 * np.finfo(float).eps * jnp.abs(t1), y1, ready)

        def at(x):
            y = between(ends, h, x, plan)
            here = relative_motions(t0 + x * h, y, ready)[index]
            return here, plan.split(y).memory[name]

        def slip(x):
            here, _ = at(x)
            return pin.by_section(pin.points(here).slip[0])[0]

        def halve(_, bracket):
            low, high = bracket
            middle = 0.5 * (low + high)
            same = slip(middle) * first > 0  # the slip at the begin, below
            return jnp.where(same, middle, low), jnp.where(same, high, middle)

        first, last = slip(0.0), slip(1.0)
        turns = first * last < 0
        cut = jax.lax.fori_loop(0, HALVINGS, halve, (jnp.zeros(()), jnp.ones(())))[0]
        cut = jnp.where(turns, cut, 0.5)
        places = jnp.concatenate([cut * nodes, cut + (1 - cut) * nodes])
        weights = h * jnp.concatenate([cut * shares, (1 - cut) * shares])

        def node(x, weight):
            here, memory = at(x)
            points, points_do = pin.points(here), clearance.act(here, memory).points
            numbers = points.normal[:2], points_do.normal_force, points_do.traction, points_do.slip
            normal, force, traction, slips = pin.by_section(numbers)
            pressed = force > 0
            rubs = safe_sqrt(sum(z * z for z in traction)) / jnp.where(pressed, force, 1.0)
            # A contact force acts along the gradient of its penetration, which is shorter than 1 on a rounded profile.
            borne = force * safe_sqrt(sum(z * z for z in normal))
            angle = jnp.where(pressed, jnp.arctan2(normal[1], normal[0]), 0.0)
            speed = safe_sqrt(sum(z * z for z in slips))
            rubs = jnp.where(pressed, rubs, 0.0)
            return Contacts(t0 + x * h, weight, borne, angle, speed, rubs, pin.centres(here), _turn(here))

        return jax.vmap(node)(places, weights)

    seen = jax.vmap(of_step)(times[:-1], times[1:], states[:-1], states[1:])
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), seen)


def _turn(here: Relative) -> Array:
    """The rotation of the pin about the sleeve's axis, without tilt (the twist of its rotation) [rad]."""
    if here.rows is None:
        return jnp.asarray(here.angle, float)
    (xx, xy, _), (yx, yy, _), _ = here.rows
    return jnp.arctan2(jnp.asarray(yx - xy, float), jnp.asarray(xx + yy, float))
