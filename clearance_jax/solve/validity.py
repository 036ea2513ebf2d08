"""Validity of a quasi-static motion, estimated from its poses alone.

A pin that is pressed at its wall swings about it, slowest at the lowest frequency f of the pose, mostly with hardly any
damping. Such an oscillator departs from a path that leads it by as much as the path bends within its own time:

    b(t) = |e(t + h) - 2 e(t) + e(t - h)|   with h = 1 / (2 pi f(t))

for a point's error e along the poses. It is the jump where e jumps (as a drive's acceleration does), the change of
slope times h at a kink, and h^2 e'' where e is smooth, as for an oscillator that is driven slowly. Its largest value
over the motion is the expected ringing. The ratio of ringing to the largest error decides the level.

The two thresholds are those of `experiments/quasi_static.py`; docs/benchmarks/quasi_static.md says how often they hold.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.pose import StaticPose
from clearance_jax.dynamics.quantities import evaluate
from clearance_jax.joints.seating import size_of
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.units import format_quantity

FOLLOWS, PEAK_ONLY, NOT_VALID = range(3)
WORDS = ("follows", "peak only", "not valid")
# The ringing over the error up to which a motion follows its poses, and up to which it has their peaks.
SMALL, LARGE = 0.12, 0.6
# A point whose error is less than this part of the largest one decides nothing.
COUNTS = 1e-3


class Validity(Module):
    """How far a quasi-static motion can be believed. It prints itself.

    - `level`: 0 where the motion *follows* the poses; 1 where its *peak only* is that of the poses; 2: *not valid*.
    - `error`: by point, the largest position error along the poses [m]; `ringing`: by point, what the motion will swing
      about them [m], before damping. Of a mechanism without points: by joint, in parts of its play.
    - `frequency`: the lowest one about any of the poses [Hz], at `time` [s]; `span`: how long the motion takes [s].
    """

    level: Int[Array, ""]
    error: Float[Array, " names"]
    ringing: Float[Array, " names"]
    frequency: Scalar
    time: Scalar
    span: Scalar
    names: tuple[str, ...] = eqx.field(static=True, default=())
    unit: str = eqx.field(static=True, default="m")

    @property
    def word(self) -> str:
        """The level of a single motion in words: "follows", "peak only" or "not valid"."""
        return WORDS[int(self.level)]

    @property
    def periods(self) -> Scalar:
        """The number of periods of the lowest frequency in the motion."""
        return self.frequency * self.span

    def __repr__(self) -> str:
        if isinstance(self.level, Tracer) or np.ndim(self.level):
            return eqx.tree_pformat(self)
        return described(self)


def described(validity: Validity) -> str:
    """The level and its reason, in a sentence or two."""
    error, ringing = np.asarray(validity.error), np.asarray(validity.ringing)
    worst = int(np.argmax(np.nan_to_num(ringing / _floor(error, np), nan=np.inf)))
    name, spent = validity.names[worst], float(validity.periods)
    text = (
        f"{validity.word}: the lowest frequency of pins at walls and of drives, {float(validity.frequency):.3g} Hz "
        f"at t = {float(validity.time):.3g} s, has {spent:.3g} periods in the motion's {float(validity.span):.3g} s. "
        f"Ringing to be expected of `{name}`: {_amount(ringing[worst], validity.unit)}, of an error of "
        f"{_amount(error[worst], validity.unit)}"
    )
    if int(validity.level) == PEAK_ONLY:
        return text + ". Believe the peak, not its course."
    if int(validity.level) == NOT_VALID:
        return text + '. Do not build on it: use `fidelity = "dynamics"`.'
    return text + "."


def _amount(value: float, unit: str) -> str:
    return format_quantity(float(value), unit) if unit else f"{float(value):.3g} of the play"


def _floor(error, numbers=jnp):
    """The errors, at least a part of the largest; 1 if all are zero."""
    least = numbers.maximum(error, COUNTS * numbers.max(error))
    return numbers.where(least > 0, least, 1.0)


def validity_of(
    times: Float[Array, " times"],
    poses: StaticPose,
    frequency: Float[Array, " times"],
    ideal: Float[Array, "times n"],
    mechanism: PreparedMechanism,
) -> Validity:
    """The validity of poses on a grid of equally spaced times, with the lowest `frequency` about each [Hz]; `ideal`:
    the ideal mechanism's states then.
    """
    names, unit = tuple(point.name for point in mechanism.points), "m"
    joints = mechanism.clearance_joints()
    if names:
        without = mechanism.intended()
        here = jax.vmap(lambda time, y: evaluate("position", time, y, mechanism))(times, poses.y)
        error = here - jax.vmap(lambda time, y: evaluate("position", time, y, without))(times, ideal)
    elif not joints:
        plan = layout(mechanism)
        names, error = plan.positions, poses.y[:, plan.q, None]
        unit = ""
    else:
        names, unit = tuple(joint.name for joint in joints), ""
        sizes = [size_of(joint.joint.play()) for joint in joints]
        parts = [play / size[None] for play, size in zip(poses.play, sizes, strict=True)]
        widest = max(part.shape[1] for part in parts)
        error = jnp.stack([jnp.pad(part, ((0, 0), (0, widest - part.shape[1]))) for part in parts], axis=1)
    bend = bends(times, error, frequency)
    largest, ringing = jnp.max(jnp.linalg.norm(error, axis=-1), axis=0), jnp.max(bend, axis=0)
    part = jnp.max(ringing / _floor(largest))
    # NaN is not valid, and neither is a pin that nothing holds.
    part = jnp.where(jnp.min(frequency) > 0, part, jnp.inf)
    level = jnp.where(part <= SMALL, FOLLOWS, jnp.where(part <= LARGE, PEAK_ONLY, NOT_VALID))
    slowest = jnp.argmin(frequency)
    span = times[-1] - times[0]
    return Validity(level, largest, ringing, frequency[slowest], times[slowest], span, names, unit)


def bends(
    times: Float[Array, " times"], error: Float[Array, "times points axes"], frequency: Float[Array, " times"]
) -> Float[Array, "times points"]:
    """How much errors bend within 1 / (2 pi f), or between two of the times if that is longer."""
    step, last = times[1] - times[0], len(times) - 1
    wait = jnp.maximum(1 / jnp.maximum(2 * jnp.pi * frequency * step, 1 / last), 1.0)
    here = jnp.arange(last + 1.0)

    def at(place):
        place = jnp.clip(place, 0.0, last)
        k = jnp.minimum(place.astype(int), last - 1)
        return error[k] + (place - k)[:, None, None] * (error[k + 1] - error[k])

    return jnp.linalg.norm(at(here + wait) - 2 * error + at(here - wait), axis=-1)
