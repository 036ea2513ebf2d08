"""Times at which a mechanism's motion is not smooth, and sampling periods."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.sampling import instants


def drive_breaks(mechanism: AbstractMechanism) -> Array:
    """Times at which a drive, an actuator, a controller's reference or a load has a break, or a payload comes or goes
    [s]; those of controllers' models included.
    """
    motions = [coordinate.motion for coordinate in mechanism.coordinates()]
    laws: list[Any] = [motion.drive for motion in motions if motion.drive is not None]
    laws += [actuator for motion in motions for actuator in motion.actuators]
    laws += [reference.target for controller in mechanism.controllers for reference in controller.references]
    handed = [time for body in mechanism.bodies for time in (body.picked_up, body.put_down) if time is not None]
    handed = [jnp.asarray(time, float)[None] for time in handed]
    believed = [drive_breaks(c.model) for c in mechanism.controllers if c.model is not None]
    breaks = [law.breaks() for law in (*laws, *mechanism.wrenches)]
    return jnp.concatenate([jnp.zeros(0), *breaks, *handed, *believed])


def sampling_periods(mechanism: AbstractMechanism) -> tuple[float, ...]:
    """The sampling periods [s]."""
    periods = [actuator.sampling_period() for c in mechanism.free_coordinates() for actuator in c.motion.actuators]
    periods += [controller.period for controller in mechanism.controllers]
    return tuple(sorted({period for period in periods if period is not None}))


def breaks_near(mechanism: AbstractMechanism, time: Scalar) -> Array:
    """`drive_breaks`, and the sampling instants near a time."""
    sampled = [instants(period, time) for period in sampling_periods(mechanism)]
    return jnp.concatenate([drive_breaks(mechanism), *sampled])
