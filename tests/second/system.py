"""The equations of motion in redundant coordinates: every body has its place, its quaternion, and its velocities; what
joints hold or drive are constraints with Lagrange multipliers.

    [M  J'] [acceleration]   [forces]
    [J  0 ] [-multipliers] = [ -bias ]

In the plane the same equations keep x, y and the turn about z of every body. The state is [places, quaternions,
velocities, angular velocities (world axes), memory of the laws, integrals of drive work, absorbed work, friction loss].
"""

from typing import NamedTuple

import numpy as np

from .model import DIRECTIONS, GROUND, Joint, Model
from .play import Pose, Push
from .quantities import Vector, cross, dot, matrices

INTEGRALS = ("drive_work", "absorbed", "friction_loss")


class Rows(NamedTuple):
    """Slides along and turns about an axis that is fixed to the parent: of each its indices of parent and child, the
    axis and the joint's place in the parent, its place in the child (all from the centres of mass), whether it turns.
    """

    parent: Vector
    child: Vector
    axis: Vector
    on_parent: Vector
    on_child: Vector
    turns: Vector


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


class System:
    """The equations of a model."""

    def __init__(self, model: Model):
        self.model = model
        self.names = list(model.bodies)
        n = len(self.names)
        self.index = {name: i for i, name in enumerate([*self.names, GROUND])}
        self.mass = np.array([body.mass for body in model.bodies.values()])
        self.inertia = np.array([body.inertia for body in model.bodies.values()])
        self.centre = np.array([*(body.centre for body in model.bodies.values()), np.zeros(3)])
        self.kept = np.array([0, 1, 5]) if model.plane else np.arange(6)
        self.size = 13 * n + sum(joint.play.memories for joint in model.plays if joint.play) + len(INTEGRALS)
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

    def _in_plane(self, joint: Joint, way: str) -> bool:
        axis = joint.on_parent[:, DIRECTIONS[way[-1]]]
        return (abs(axis[2]) > 0.5) == way.startswith("turn")

    def _rows(self, ways) -> Rows:
        columns = []
        for joint, way in ways:
            axis = joint.on_parent[:, DIRECTIONS[way[-1]]]
            a, b = self.index[joint.parent], self.index[joint.child]
            arms = joint.at_parent - self.centre[a], joint.at_child - self.centre[b]
            columns.append((a, b, axis, *arms, way.startswith("turn")))
        return Rows(*(np.array(column) for column in zip(*columns, strict=True)))

    # Kinematics ------------------------------------------------------------------------------------------------------

    def now(self, y: Vector) -> Now:
        """The bodies of a state."""
        n = len(self.names)
        still = np.zeros((1, 3))
        place, turning = y[: 3 * n].reshape(n, 3), y[10 * n : 13 * n].reshape(n, 3)
        velocity, matrix = y[7 * n : 10 * n].reshape(n, 3), matrices(y[3 * n : 7 * n].reshape(n, 4))
        return Now(
            np.concatenate([place, still]),
            np.concatenate([matrix, np.eye(3)[None]]),
            np.concatenate([velocity, still]),
            np.concatenate([turning, still]),
        )

    def jacobian(self, at: Now) -> tuple[Vector, Vector]:
        """Of every row its dependence on all velocities, shape (rows, bodies and ground, 6), and the bias of its
        second rate.
        """
        rows, (r, matrix, v, w) = self.rows, at
        p, c = rows.parent, rows.child
        n = (matrix[p] @ rows.axis[:, :, None])[:, :, 0]
        arm_p = (matrix[p] @ rows.on_parent[:, :, None])[:, :, 0]
        arm_c = (matrix[c] @ rows.on_child[:, :, None])[:, :, 0]
        apart = r[c] + arm_c - r[p] - arm_p
        fast_c, fast_p = cross(w[c], arm_c), cross(w[p], arm_p)
        relative = v[c] + fast_c - v[p] - fast_p
        turned = cross(w[p], n)
        out, every = np.zeros((len(n), len(r), 6)), np.arange(len(n))
        slides = ~rows.turns[:, None]
        out[every, c, :3] += slides * n
        out[every, p, :3] -= slides * n
        out[every, c, 3:] += np.where(slides, cross(arm_c, n), n)
        out[every, p, 3:] -= np.where(slides, cross(apart + arm_p, n), n)
        slide = dot(n, cross(w[c], fast_c) - cross(w[p], fast_p)) + 2 * dot(turned, relative)
        slide = slide + dot(cross(w[p], turned), apart)
        return out, np.where(rows.turns, dot(turned, w[c] - w[p]), slide)

    def pose(self, joint: Joint, at: Now) -> Pose:
        """The relative motion in a joint, in the axes of its play."""
        a, b = self.index[joint.parent], self.index[joint.child]
        axes = joint.on_parent if joint.play is None else joint.on_parent @ joint.play.axes
        frame = at.matrix[a] @ axes
        arm_p = at.matrix[a] @ (joint.at_parent - self.centre[a])
        arm_c = at.matrix[b] @ (joint.at_child - self.centre[b])
        apart = at.place[b] + arm_c - at.place[a] - arm_p
        velocity = at.velocity[b] + cross(at.turning[b], arm_c) - at.velocity[a] - cross(at.turning[a], arm_p + apart)
        child = at.matrix[b] @ (joint.on_child if joint.play is None else joint.on_child @ joint.play.axes)
        back = frame.T
        return Pose(back @ apart, back @ child, back @ velocity, back @ (at.turning[b] - at.turning[a]))

    def coordinate(self, i: int, at: Now) -> float:
        """The value of a joint's own coordinate; a turn within half a turn of its start."""
        joint, coordinate = self.own[i]
        pose = self.pose(joint._replace(play=None), at)
        if not coordinate.direction.startswith("turn"):
            return pose.place[DIRECTIONS[coordinate.direction]]
        angle = np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])
        return coordinate.start + (angle - coordinate.start + np.pi) % (2 * np.pi) - np.pi

    # Dynamics --------------------------------------------------------------------------------------------------------

    def memory(self, y: Vector) -> list[Vector]:
        """The memory of the laws of each joint with play."""
        out, begin = [], 13 * len(self.names)
        for joint in self.model.plays:
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
                self.model.plays, self.memory(y), *regime._asdict().values(), strict=True
            )
            if joint.play is not None
        ]
        acceleration, work, dampers = self._accelerations(t, now, pushes)
        out = np.zeros_like(y)
        out[: 3 * n], out[7 * n : 13 * n] = now.velocity[:-1].ravel(), acceleration
        w, q = now.turning[:-1], y[3 * n : 7 * n].reshape(n, 4)
        turned = np.concatenate([-dot(w, q[:, 1:])[:, None], q[:, :1] * w + cross(w, q[:, 1:])], 1)
        out[3 * n : 7 * n] = 0.5 * turned.ravel()
        out[13 * n : -3] = self._remembered(pushes)
        out[-3:] = work, sum(p.absorbed for p in pushes) + dampers, sum(p.rubbed for p in pushes)
        return out

    def _remembered(self, pushes: list[Push]) -> Vector:
        rates = []
        for joint, push in zip(self.model.plays, pushes, strict=True):
            assert joint.play is not None
            rates += [push.flows] if joint.play.normal.memories else []
            rates += [push.bends.ravel()] if joint.play.friction is not None and joint.play.friction.remembers else []
        return np.concatenate(rates) if rates else np.zeros(0)

    def _accelerations(self, t: float, now: Now, pushes: list[Push]) -> tuple[Vector, float, float]:
        """Accelerations [all places, all turns], the power of drives, actuators and loads, and that of dampers."""
        n, rows = len(self.names), len(self.held)
        jacobian, bias = self.jacobian(now)
        force = self._applied(now)
        loads, power = self._loaded(t, now)
        springs, lost = self._sprung(now)
        force += loads + springs
        for joint, push in zip(self.model.plays, pushes, strict=True):
            self._push(force, joint, now, push)
        both = np.concatenate([now.velocity, now.turning], 1)
        matrix = self._mass_matrix(now)
        for i in self.free:
            coordinate, row = self.own[i][1], jacobian[rows + i]
            rate = float((row * both).sum())
            effort = sum(effort(t, self.coordinate(i, now), rate) for effort in coordinate.efforts)
            power += effort * rate
            force += (effort - coordinate.rotor * bias[rows + i]) * row
            if coordinate.rotor:
                flat = row[:-1].reshape(-1)
                matrix += coordinate.rotor * np.outer(flat, flat)
        active = [*range(rows), *(rows + i for i in self.driven)]
        drives = [self.own[i][1].drive.at(t) for i in self.driven]
        wanted = np.concatenate([np.zeros(rows), [second for _, _, second in drives]]) - bias[active]
        keep = (6 * np.arange(n)[:, None] + self.kept).ravel()
        held = jacobian[active][:, :-1].reshape(len(active), -1)[:, keep]
        acceleration, multipliers = self._solve(matrix[np.ix_(keep, keep)], held, force[:-1].reshape(-1)[keep], wanted)
        power += sum(m * rate for m, (_, rate, _) in zip(multipliers[rows:], drives, strict=True))
        whole = np.zeros(6 * n)
        whole[keep] = acceleration
        whole = whole.reshape(n, 6)
        return np.concatenate([whole[:, :3].ravel(), whole[:, 3:].ravel()]), power, lost

    def _solve(self, mass, held, force, wanted):
        """Accelerations and multipliers; constraints may repeat each other in space."""
        m, k = len(mass), len(held)
        whole = np.zeros((m + k, m + k))
        whole[:m, :m], whole[m:, :m], whole[:m, m:] = mass, held, -held.T
        right = np.concatenate([force, wanted])
        if self.model.plane:
            out = np.linalg.solve(whole, right)
        else:
            size = np.concatenate([np.full(m, 1 / np.sqrt(np.trace(mass) / m)), np.full(k, np.sqrt(np.trace(mass) / m))])
            out = size * np.linalg.lstsq(size[:, None] * whole * size, size * right, rcond=1e-11)[0]
        return out[:m], out[m:]

    def _mass_matrix(self, now: Now) -> Vector:
        n = len(self.names)
        out = np.zeros((6 * n, 6 * n))
        turned = now.matrix[:-1] @ self.inertia @ now.matrix[:-1].transpose(0, 2, 1)
        for i in range(n):
            out[6 * i : 6 * i + 3, 6 * i : 6 * i + 3] = self.mass[i] * np.eye(3)
            out[6 * i + 3 : 6 * i + 6, 6 * i + 3 : 6 * i + 6] = turned[i]
        return out

    def _applied(self, now: Now) -> Vector:
        """Weight and gyroscopic moments of every body, shape (bodies and ground, 6)."""
        out = np.zeros((len(self.names) + 1, 6))
        out[:-1, :3] = self.mass[:, None] * self.model.gravity
        turned = now.matrix[:-1] @ self.inertia @ now.matrix[:-1].transpose(0, 2, 1)
        w = now.turning[:-1]
        out[:-1, 3:] = -cross(w, (turned @ w[:, :, None])[:, :, 0])
        return out

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

    def _sprung(self, now: Now) -> tuple[Vector, float]:
        out, lost = np.zeros((len(self.names) + 1, 6)), 0.0
        for spring in self.model.springs:
            ends = [self.point(body, at, now) for body, at in zip(spring.bodies, spring.ends, strict=True)]
            along = ends[1][0] - ends[0][0]
            length = np.sqrt(along @ along)
            along = along / length
            rate = along @ (ends[1][1] - ends[0][1])
            tension = spring.stiffness * (length - spring.free_length) + spring.damping * rate
            lost += spring.damping * rate**2
            for body, (_, _, arm), sign in zip(spring.bodies, ends, (1.0, -1.0), strict=True):
                pull = sign * tension * along
                out[self.index[body]] += np.concatenate([pull, cross(arm, pull)])
        return out, lost

    def _loaded(self, t: float, now: Now) -> tuple[Vector, float]:
        out, power = np.zeros((len(self.names) + 1, 6)), 0.0
        for load in self.model.loads:
            i = self.index[load.body]
            axes = now.matrix[i] if load.turns_along else np.eye(3)
            factor = load.course.at(t)[0]
            f, torque = factor * axes @ load.force, factor * axes @ load.torque
            _, velocity, arm = self.point(load.body, load.at, now)
            out[i] += np.concatenate([f, cross(arm, f) + torque])
            power += f @ velocity + torque @ now.turning[i]
        return out, power
