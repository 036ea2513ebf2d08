"""An independent derivation of a mechanism's motion: Lagrange's equations by automatic differentiation of energies that
are written with 4 x 4 matrices. Nothing of `clearance_jax.dynamics` or `spatial` is used.

Orientations are taken in local coordinates: a rotation vector theta beyond the present orientation. At theta = 0 the
body's spin is theta' and its rate is theta''.
"""

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.mechanism.state import layout, parts


def hat(a):
    return jnp.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def turn(axis, angle):
    """A matrix exponential's closed form (an axis of unit length)."""
    k = hat(axis)
    return jnp.eye(3) + jnp.sin(angle) * k + (1 - jnp.cos(angle)) * k @ k


def turn_little(theta):
    """Exp(theta) to the fourth order: exact to the third derivative at zero."""
    k = hat(theta)
    return jnp.eye(3) + k + k @ k / 2 + k @ k @ k / 6 + k @ k @ k @ k / 24


def quaternion_matrix(q):
    w, v = q[0], q[1:]
    return (w * w - v @ v) * jnp.eye(3) + 2 * jnp.outer(v, v) + 2 * w * hat(v)


def rpy(orientation):
    if orientation is None:
        return jnp.eye(3)
    roll, pitch, yaw = (0.0 if a is None else a for a in (orientation.roll, orientation.pitch, orientation.yaw))
    x, y, z = jnp.eye(3)
    return turn(z, yaw) @ turn(y, pitch) @ turn(x, roll)


def three(position):
    return jnp.array([0.0 if c is None else c for c in (position.x, position.y, position.z)])


def poses(mechanism, time, q, local):
    """Rotation and origin of every body: `q` the present positions, `local` the small change of each velocity's
    coordinate.
    """
    places = {part.coordinate.name: part for part in parts(mechanism)}
    out = {"ground": (jnp.eye(3), jnp.zeros(3))}
    for joint in mechanism.joints:
        rotation, origin = out[joint.parent]
        origin = origin + rotation @ three(joint.at_parent)
        own = turn(jnp.array([0.0, 0.0, 1.0]), joint.angle) if joint.angle is not None else rpy(joint.orientation)
        rotation = rotation @ own
        tilts = []
        for c in joint.coordinates():
            if c.is_ball:
                at = places[c.name]
                rotation = rotation @ quaternion_matrix(q[at.q]) @ turn_little(local[at.v])
                continue
            if c.name in places:
                at = places[c.name]
                value = q[at.q.start] + local[at.v.start]
            else:
                value = c.motion.drive(time)[0]
            if c.swings:
                tilts.append(jnp.array(c.turns, float) * value)
                if len(tilts) == 2:  # two tilts are one rotation: Cayley's of half their sum
                    half = hat(tilts[0] + tilts[1]) / 2
                    rotation = rotation @ jnp.linalg.solve(jnp.eye(3) - half, jnp.eye(3) + half)
            elif c.turns is not None:
                rotation = rotation @ turn(jnp.array(c.turns, float), value)
            else:
                origin = origin + rotation @ jnp.array(c.slides, float) * value
        rotation = rotation @ rpy(joint.child_orientation).T
        out[joint.child] = (rotation, origin - rotation @ three(joint.at_child))
    return out


def inertia_tensor(body):
    i = body.inertia
    if i is None:
        return jnp.zeros((3, 3))
    if not hasattr(i, "xx"):
        return jnp.diag(jnp.array([0.0, 0.0, 1.0])) * i
    xy, xz, yz = (0.0 if n is None else n for n in (i.xy, i.xz, i.yz))
    return jnp.array([[i.xx, xy, xz], [xy, i.yy, yz], [xz, yz, i.zz]])


def lagrangian_of(mechanism, q):
    """Kinetic less potential energy by (time, small changes of the positions q, speeds), without springs."""
    gravity = three(mechanism.gravity)

    def at(t, x):
        return poses(mechanism, t, q, x)

    def lagrangian(t, x, speed):
        now, rate = jax.jvp(at, (t, x), (jnp.ones_like(t), speed))
        total = 0.0
        for body in mechanism.bodies:
            (rotation, origin), (change, velocity) = now[body.name], rate[body.name]
            centre = three(body.center_of_mass)
            mass = 0.0 if body.mass is None else body.mass
            spin = rotation.T @ change
            omega = jnp.array([spin[2, 1], spin[0, 2], spin[1, 0]])
            fast = velocity + change @ centre
            total += mass * fast @ fast / 2 + omega @ inertia_tensor(body) @ omega / 2
            total += mass * gravity @ (origin + rotation @ centre)
        return total

    return lagrangian


def mass_matrix(mechanism, time, y):
    """The mass matrix of the free velocities, without rotors."""
    plan = layout(mechanism)
    x, t = jnp.zeros(plan.free), jnp.asarray(time, float)
    return jax.hessian(lagrangian_of(mechanism, y[plan.q]), 2)(t, x, y[plan.v])


def accelerations(mechanism, time, y, forces=0.0):
    """Accelerations of the free velocities of an open mechanism without springs, under generalised forces:
    M a = dL/dx - d(dL/dx')/dt + Q.
    """
    plan = layout(mechanism)
    q, v = y[plan.q], y[plan.v]
    lagrangian = lagrangian_of(mechanism, q)
    x, t = jnp.zeros(plan.free), jnp.asarray(time, float)
    momentum = jax.grad(lagrangian, 2)
    # Of the momentum with the speeds held: what time and places change in it.
    drift = jax.jvp(lambda t, x: momentum(t, x, v), (t, x), (jnp.ones_like(t), v))[1]
    return jnp.linalg.solve(mass_matrix(mechanism, time, y), jax.grad(lagrangian, 1)(t, x, v) - drift + forces)


def random_state(mechanism, rng):
    """A state with unit quaternions."""
    plan = layout(mechanism)
    y = rng.normal(size=plan.size)
    for part in parts(mechanism):
        if part.coordinate.is_ball:
            y[part.q] /= np.linalg.norm(y[part.q])
    return y
