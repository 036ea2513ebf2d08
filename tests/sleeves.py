"""Sleeves in space, relative motions in them, and what every action has to obey."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.joints import Relative

RADIAL, AXIAL, RADIUS, LENGTH = 1e-4, 5e-5, 0.01, 0.04

HERTZ, FRICTION = laws.HuntCrossley(1e9, 0.5), laws.TanhCoulomb(0.1, 0.01)


def sleeve(pin="through", stations=8, axial: Any = AXIAL, friction: Any = FRICTION, normal: Any = HERTZ):
    return cj.SleeveClearance(
        RADIAL, RADIUS, LENGTH, normal, friction, axial_clearance=axial, pin=pin, stations=stations
    )


def relative(place, tilt=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0)) -> Relative:
    def triple(vector):
        return tuple(jnp.asarray(x, float) for x in vector)

    rows = tuple(triple(row) for row in Rotation.from_rotvec(tilt).as_matrix())
    return Relative(triple(place), 0.0, triple(velocity), triple(spin), rows)


def act(joint, at) -> Any:
    """What a joint does at a relative motion, without memory."""
    return joint.prepare().act(at, ())


def checked(joint, at) -> Any:
    """What it does, whose power must be that of its wrench, and the rates of its penetrations those along the twist."""
    rows = np.array(at.rows, float)
    spun = np.cross(np.array(at.spin, float)[None], rows.T).T

    def moved(t):
        place = tuple(p + t * v for p, v in zip(at.place, at.velocity, strict=True))
        now = tuple(tuple(row) for row in jnp.asarray(rows) + t * jnp.asarray(spun))
        return joint.points(at._replace(place=place, rows=now)).penetration

    _, rate = jax.jvp(moved, (0.0,), (1.0,))
    np.testing.assert_allclose(joint.points(at).penetration_rate, rate, rtol=1e-12, atol=1e-14)
    action = act(joint, at)
    given = np.dot(action.force, at.velocity) + np.dot(action.torque, at.spin)
    np.testing.assert_allclose(given, -action.absorbed_power - action.friction_power, rtol=1e-11, atol=1e-12)
    return action


def random_states(count):
    rng = np.random.default_rng(1)
    for _ in range(count):
        sizes = (rng.normal(size=3) * size for size in (1e-4, 5e-3, 0.2, 5.0))
        yield relative(*sizes)
