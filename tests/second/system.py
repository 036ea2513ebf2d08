"""The equations of motion in redundant coordinates: every body has its place, its quaternion, and its velocities; what
joints hold or drive are constraints with Lagrange multipliers.

    [M  J'] [acceleration]   [forces]
    [J  0 ] [-multipliers] = [ -bias ]

In the plane the same equations keep x, y and the turn about z of every body. The state is [places, quaternions,
velocities, angular velocities (world axes), memory of the laws, integrals of drive work, absorbed work, friction loss].
"""

from typing import NamedTuple

import numpy as np

from . import kernels
from .kernels import cross
from .model import DIRECTIONS, GROUND, Joint, Model
from .play import Pose, Push
from .quantities import Vector

INTEGRALS = ("drive_work", "absorbed", "friction_loss")


class Rows(NamedTuple):
    """Slides along and turns about an axis that is fixed to the parent: of each its indices of parent and child, the
    axis and the joint's place in the parent, its place in the child (all from the centres of mass), whether it turns,
    and of a pin that may tilt its axis in the child (of others zero).
    """

    parent: Vector
    child: Vector
    axis: Vector
    on_parent: Vector
    on_child: Vector
    turns: Vector
    pin: Vector


class Now(NamedTuple):
    """The bodies at an instant, the ground last: places of the centres of mass, matrices, velocities, turning."""

    place: Vector
    matrix: Vector
    velocity: Vector
    turning: Vector


class Regime(NamedTuple):
    """Of every joint with play which points touch and which of them press, and the impact speeds that they keep."""

    touches: tuple[Vector, ...]
    presses: tuple[Vector, ...]
    speeds: tuple[Vector, ...]


def tilts(joint: Joint, way: str) -> bool:
    """Whether a joint's direction is the turn of a pin that tilts in its sleeve."""
    return way == "turn z" and joint.play is not None and "turn x" not in joint.held


def straight(p: Vector) -> Vector:
    """The turn about an axis across z that takes z to the direction p."""
    x, y, z = p
    skew = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    return np.eye(3) + skew + skew @ skew / (1 + z)


class System:
    """The equations of a model."""

    def __init__(self, model: Model):
        self.model = model
        self.names, self.plays = list(model.bodies), model.plays
        n = len(self.names)
        self.index = {name: i for i, name in enumerate([*self.names, GROUND])}
        self.mass = np.array([body.mass for body in model.bodies.values()])
        self.inertia = np.array([body.inertia for body in model.bodies.values()])
        self.centre = np.array([*(body.centre for body in model.bodies.values()), np.zeros(3)])
        self.kept = np.array([0, 1, 5]) if model.plane else np.arange(6)
        self.size = 13 * n + sum(joint.play.memories for joint in self.plays if joint.play) + len(INTEGRALS)
        held, own = [], []
        for joint in model.joints:
            held += [(joint, way) for way in joint.held]
            for coordinate in joint.coordinates:
                own.append((joint, coordinate))
        self.own = own
        self.driven = [i for i, (_, coordinate) in enumerate(own) if coordinate.drive is not None]
        self.free = [i for i, (_, coordinate) in enumerate(own) if coordinate.drive is None]
        ways = [*held, *((joint, coordinate.direction) for joint, coordinate in own)]
        # In the plane rows that leave it hold nothing.
        keeps = [i for i, way in enumerate(ways) if not model.plane or self._in_plane(*way)]
        self.held = [ways[i] for i in keeps if i < len(held)]
        self.rows = self._rows([*self.held, *ways[len(held) :]])
        axes = [joint.play.axes if joint.play else np.eye(3) for joint in model.joints]
        self.frames = {joint.name: self._frame(joint, own) for joint, own in zip(model.joints, axes, strict=True)}
        self.own_frames = [self._frame(joint, np.eye(3)) for joint, _ in own]
        self.active = np.array([*range(len(self.held)), *(len(self.held) + i for i in self.driven)], int)
        self.keep = (6 * np.arange(n)[:, None] + self.kept).ravel()

    def _in_plane(self, joint: Joint, way: str) -> bool:
        axis = joint.on_parent[:, DIRECTIONS[way[-1]]]
        return (abs(axis[2]) > 0.5) == way.startswith("turn")

    def _frame(self, joint: Joint, axes: Vector):
        """Indices, arms and axes of a joint for `kernels.pose`."""
        a, b = self.index[joint.parent], self.index[joint.child]
        arms = joint.at_parent - self.centre[a], joint.at_child - self.centre[b]
        return a, b, *arms, joint.on_parent @ axes, joint.on_child @ axes

    def _rows(self, ways) -> Rows:
        columns = []
        for joint, way in ways:
            axis = joint.on_parent[:, DIRECTIONS[way[-1]]]
            a, b = self.index[joint.parent], self.index[joint.child]
            arms = joint.at_parent - self.centre[a], joint.at_child - self.centre[b]
            pin = joint.on_child[:, 2] if tilts(joint, way) else np.zeros(3)
            columns.append((a, b, axis, *arms, way.startswith("turn"), pin))
        return Rows(*(np.array(column) for column in zip(*columns, strict=True)))

    # Kinematics ------------------------------------------------------------------------------------------------------

    def now(self, y: Vector) -> Now:
        """The bodies of a state."""
        return Now(*kernels.bodies(y, len(self.names)))

    def jacobian(self, at: Now) -> tuple[Vector, Vector]:
        """Of every row its dependence on all velocities, shape (rows, 6 (bodies and ground)), and the bias of its
        second rate.
        """
        return kernels.jacobian(*at, *self.rows)

    def pose(self, joint: Joint, at: Now) -> Pose:
        """The relative motion in a joint, in the axes of its play."""
        return Pose(*kernels.pose(*at, *self.frames[joint.name]))

    def coordinate(self, i: int, at: Now) -> float:
        """The value of a joint's own coordinate; a turn within half a turn of its start."""
        coordinate, pose = self.own[i][1], Pose(*kernels.pose(*at, *self.own_frames[i]))
        if not coordinate.direction.startswith("turn"):
            return pose.place[DIRECTIONS[coordinate.direction]]
        turned = pose.rotation
        if tilts(self.own[i][0], coordinate.direction):
            turned = straight(turned[:, 2]).T @ turned
        angle = np.arctan2(turned[1, 0], turned[0, 0])
        return coordinate.start + (angle - coordinate.start + np.pi) % (2 * np.pi) - np.pi

    # Dynamics --------------------------------------------------------------------------------------------------------

    def memory(self, y: Vector) -> list[Vector]:
        """The memory of the laws of each joint with play."""
        out, begin = [], 13 * len(self.names)
        for joint in self.plays:
            assert joint.play is not None
            out.append(y[begin : begin + joint.play.memories])
            begin += joint.play.memories
        return out

    def rates(self, t: float, y: Vector, regime: Regime) -> Vector:
        """The rate of the state in a regime."""
        now = self.now(y)
        n = len(self.names)
        pushes = [
            joint.play.act(self.pose(joint, now), memory, speed, touches, presses)
            for joint, memory, touches, presses, speed in zip(
                self.plays, self.memory(y), *regime._asdict().values(), strict=True
            )
            if joint.play is not None
        ]
        acceleration, work, dampers, dry = self._accelerations(t, now, pushes)
        out = np.zeros_like(y)
        out[: 3 * n], out[7 * n : 13 * n] = now.velocity[:-1].ravel(), acceleration
        out[3 * n : 7 * n] = kernels.quaternion_rates(y, n)
        out[13 * n : -3] = self._remembered(pushes)
        out[-3:] = work, sum(p.absorbed for p in pushes) + dampers, sum(p.rubbed for p in pushes) + dry
        return out

    def _remembered(self, pushes: list[Push]) -> Vector:
        rates = []
        for joint, push in zip(self.plays, pushes, strict=True):
            assert joint.play is not None
            rates += [push.flows] if joint.play.normal.memories else []
            rates += [push.bends.ravel()] if joint.play.friction is not None and joint.play.friction.remembers else []
        return np.concatenate(rates) if rates else np.zeros(0)

    def _accelerations(self, t: float, now: Now, pushes: list[Push]) -> tuple[Vector, float, float, float]:
        """Accelerations [all places, all turns], the power of drives, actuators and loads, and those of dampers and of
        the friction of actuators.
        """
        n, rows = len(self.names), len(self.held)
        jacobian, bias = self.jacobian(now)
        matrix, force = kernels.mass_and_weight(now.matrix, now.turning, self.mass, self.inertia, self.model.gravity)
        power, lost, rubbed = self._loaded(t, now, force), self._sprung(now, force), 0.0
        for joint, push in zip(self.plays, pushes, strict=True):
            self._push(force, joint, now, push)
        force = force.ravel()
        both = np.concatenate([now.velocity, now.turning], 1).ravel()
        for i in self.free:
            coordinate, row = self.own[i][1], jacobian[rows + i]
            if not (coordinate.efforts or coordinate.rotor):
                continue
            rate = float(row @ both)
            effort = sum(effort.of(t, self.coordinate(i, now), rate) for effort in coordinate.efforts)
            damped = sum(effort.damped(rate) for effort in coordinate.efforts)
            dry = sum(effort.rubbed(rate) for effort in coordinate.efforts)
            power, lost, rubbed = power + effort * rate + damped + dry, lost + damped, rubbed + dry
            force += (effort - coordinate.rotor * bias[rows + i]) * row
            matrix += coordinate.rotor * np.outer(row[:-6], row[:-6])
        drives = [self.own[i][1].drive.at(t) for i in self.driven]
        wanted = np.array([0.0] * rows + [second for _, _, second in drives]) - bias[self.active]
        right = kernels.saddle(matrix, jacobian[self.active], force, wanted, self.keep)
        out = kernels.solve(*right) if self.model.plane else self._least(*right)
        acceleration, multipliers = np.zeros(6 * n), out[len(self.keep) + rows :]
        acceleration[self.keep] = out[: len(self.keep)]
        power += sum(m * rate for m, (_, rate, _) in zip(multipliers, drives, strict=True))
        acceleration = acceleration.reshape(n, 6)
        return np.concatenate([acceleration[:, :3].ravel(), acceleration[:, 3:].ravel()]), power, lost, rubbed

    def _least(self, matrix: Vector, right: Vector) -> Vector:
        """In space constraints may repeat each other: then the smallest multipliers."""
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            return np.full(len(right), np.nan)
        m = len(self.keep)
        unit = np.sqrt(np.trace(matrix[:m, :m]) / m)
        size = np.where(np.arange(len(matrix)) < m, 1 / unit, unit)
        return size * np.linalg.lstsq(size[:, None] * matrix * size, size * right, rcond=1e-11)[0]

    def _push(self, force: Vector, joint: Joint, now: Now, push: Push) -> None:
        """Adds a joint's force on the pin, and the opposite one on the sleeve at the same places."""
        assert joint.play is not None
        a, b = self.index[joint.parent], self.index[joint.child]
        frame = now.matrix[a] @ joint.on_parent @ joint.play.axes
        f, moment = frame @ push.force, frame @ push.moment
        arm = now.matrix[b] @ (joint.at_child - self.centre[b])
        force[b, :3] += f
        force[b, 3:] += cross(arm, f) + moment
        force[a, :3] -= f
        force[a, 3:] -= cross(now.place[b] + arm - now.place[a], f) + moment

    def point(self, body: str, at: Vector, now: Now) -> tuple[Vector, Vector, Vector]:
        """Place, velocity, and the arm from the centre of mass, of a body's point."""
        i = self.index[body]
        arm = now.matrix[i] @ (at - self.centre[i])
        return now.place[i] + arm, now.velocity[i] + cross(now.turning[i], arm), arm

    def _sprung(self, now: Now, force: Vector) -> float:
        """Adds the pull of springs; the power that their dampers take."""
        lost = 0.0
        for spring in self.model.springs:
            ends = [self.point(body, at, now) for body, at in zip(spring.bodies, spring.ends, strict=True)]
            along = ends[1][0] - ends[0][0]
            length = np.sqrt(along @ along)
            along = along / length
            rate = along @ (ends[1][1] - ends[0][1])
            tension = spring.stiffness * (length - spring.free_length) + spring.damping * rate
            lost += float(spring.damping * rate**2)
            for body, (_, _, arm), sign in zip(spring.bodies, ends, (1.0, -1.0), strict=True):
                pull = sign * tension * along
                force[self.index[body]] += np.concatenate([pull, cross(arm, pull)])
        return lost

    def _loaded(self, t: float, now: Now, force: Vector) -> float:
        """Adds the loads; their power."""
        power = 0.0
        for load in self.model.loads:
            i = self.index[load.body]
            axes = now.matrix[i] if load.turns_along else np.eye(3)
            factor = load.course.at(t)[0]
            f, torque = factor * axes @ load.force, factor * axes @ load.torque
            _, velocity, arm = self.point(load.body, load.at, now)
            force[i] += np.concatenate([f, cross(arm, f) + torque])
            power += float(f @ velocity + torque @ now.turning[i])
        return power
