"""Robots by Newton and Euler in plain numpy, link by link as their files have them: nothing is merged, and nothing of
this library's dynamics is used. Slow, short, and for joints of one coordinate, on a fixed or a free base.
"""

import numpy as np

from clearance_jax.io.urdf.robot import Robot

GRAVITY = np.array([0.0, 0.0, -9.81])
# The speed at which a joint's friction turns round: its default [rad/s or m/s].
TURNING = 0.01


def turn(axis, angle):
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew


def of_rpy(rpy):
    x, y, z = np.eye(3)
    return turn(z, rpy[2]) @ turn(y, rpy[1]) @ turn(x, rpy[0])


def of_quaternion(q):
    w, v = q[0], q[1:]
    skew = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * skew


class Motion:
    """A link's pose, velocity and spin, their rates where no velocity changes, and its Jacobian (place, then spin)."""

    def __init__(self, rotation, place, n):
        self.rotation, self.place = rotation, place
        self.velocity, self.spin, self.acceleration, self.spin_rate = (np.zeros(3) for _ in range(4))
        self.jacobian = np.zeros((6, n))

    def carried(self, place, rotation) -> "Motion":
        """A frame that is fixed to the link, at a place of the world, with axes in the world."""
        out, arm = Motion(rotation, place, self.jacobian.shape[1]), place - self.place
        out.velocity = self.velocity + np.cross(self.spin, arm)
        out.acceleration = self.acceleration + np.cross(self.spin_rate, arm)
        out.acceleration += np.cross(self.spin, np.cross(self.spin, arm))
        out.spin, out.spin_rate = self.spin.copy(), self.spin_rate.copy()
        out.jacobian = self.jacobian.copy()
        out.jacobian[:3] += np.cross(self.jacobian[3:].T, arm).T
        return out

    def beyond(self, slides, axis, q, v, index) -> "Motion":
        """What a joint at this frame carries."""
        along = self.rotation @ axis
        if slides:
            out = self.carried(self.place + q * along, self.rotation)
            out.acceleration += 2 * np.cross(self.spin, v * along)
            out.velocity, out.jacobian[:3, index] = out.velocity + v * along, along
            return out
        out = self.carried(self.place, self.rotation @ turn(axis, q))
        out.spin_rate = out.spin_rate + np.cross(self.spin, v * along)
        out.spin, out.jacobian[3:, index] = out.spin + v * along, along
        return out


def base(q, v, n, free):
    """The root link."""
    if not free:
        return Motion(np.eye(3), np.zeros(3), n)
    out = Motion(of_quaternion(q[3:7]), q[:3], n)
    out.velocity, out.spin = v[:3], out.rotation @ v[3:6]
    out.jacobian[:3, :3], out.jacobian[3:, 3:6] = np.eye(3), out.rotation
    return out


def motions(robot: Robot, q, v, free):
    """Every link's, by its name."""
    moving = [joint for joint in robot.joints if joint.moves]
    first, n = (7, 6 + len(moving)) if free else (0, len(moving))
    found, count = {robot.root: base(q, v, n, free)}, 0
    for joint in robot.joints:
        parent = found[joint.parent]
        place, rotation = parent.place + parent.rotation @ joint.xyz, parent.rotation @ of_rpy(joint.rpy)
        frame = parent.carried(place, rotation)
        if joint.moves:
            index, slides = n - len(moving) + count, joint.kind == "prismatic"
            frame = frame.beyond(slides, np.array(joint.axis), q[first + count], v[index], index)
            count += 1
        found[joint.child] = frame
    return found


def of_state(robot: Robot, q, v, free: bool, frames) -> dict:
    """Mass matrix, terms of gravity and of velocities, accelerations under the joints' damping and friction, poses and
    Jacobians.
    """
    links, n = motions(robot, q, v, free), len(v)
    mass, gravity, bias = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    for link in robot.links:
        at = links[link.name]
        center = at.carried(at.place + at.rotation @ link.center, at.rotation)
        inertia = at.rotation @ link.inertia @ at.rotation.T
        linear, angular = center.jacobian[:3], center.jacobian[3:]
        mass += link.mass * linear.T @ linear + angular.T @ inertia @ angular
        gravity -= link.mass * linear.T @ GRAVITY
        bias += link.mass * linear.T @ center.acceleration
        bias += angular.T @ (inertia @ center.spin_rate + np.cross(center.spin, inertia @ center.spin))
    own = [(joint.damping, joint.friction) for joint in robot.joints if joint.moves]
    damping, friction = np.array([*([(0.0, 0.0)] * (6 if free else 0)), *own]).T
    resisted = damping * v + friction * np.tanh(v / TURNING)
    return {
        "acceleration": np.linalg.solve(mass, -resisted - bias - gravity),
        "gravity": gravity,
        "coriolis": bias,
        "mass": mass,
        "poses": np.array([np.column_stack([links[name].rotation, links[name].place]) for name in frames]),
        "jacobians": np.array([links[name].jacobian for name in frames]),
    }


def random_states(robot: Robot, free: bool, count: int, seed: int):
    """Places and rates of so many states."""
    rng = np.random.default_rng(seed)
    moving = [joint for joint in robot.joints if joint.moves]
    reach = np.array([1.0 if joint.kind == "prismatic" else np.pi for joint in moving])
    q = rng.uniform(-reach, reach, (count, len(moving)))
    if free:
        quaternion = rng.normal(size=(count, 4))
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        q = np.concatenate([rng.normal(size=(count, 3)), quaternion, q], axis=1)
    return q, rng.normal(size=(count, len(moving) + (6 if free else 0)))
