"""The equations of motion in redundant coordinates: every body has its place, its quaternion, and its velocities; what
joints hold or drive are constraints with Lagrange multipliers.

    [M  J'] [acceleration]   [forces]
    [J  0 ] [-multipliers] = [ -bias ]

In the plane the same equations keep x, y and the turn about z of every body. The state is [places, quaternions,
velocities, angular velocities (world axes), memory of the laws, places and rates of motors behind springs, held efforts
of digital servos, integrals of servos' errors, and of drive work, absorbed work, friction loss]. Such a motor adds a
velocity of its own.
"""

from typing import Any, NamedTuple

import numpy as np

from . import kernels
from .gears import MOTOR, Form, Gap
from .kernels import cross
from .model import DIRECTIONS, GROUND, Effort, Joint, Model
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
    """The bodies at an instant, the ground last: places of the centres of mass, matrices, velocities, turning; of
    motors behind springs their places, rates, and, if driven, second rates.
    """

    place: Vector
    matrix: Vector
    velocity: Vector
    turning: Vector
    motors: Vector


class Moves(NamedTuple):
    """Of all own coordinates of joints, and of motors: their values, rates, dependence on the velocities, biases of the
    second rates, and the rates that drives give to motors.
    """

    value: Vector
    rate: Vector
    rows: Vector
    bias: Vector
    given: Vector


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
        self.names, self.plays = list(model.bodies), (*model.plays, *model.gaps)
        n = len(self.names)
        self.index = {name: i for i, name in enumerate([*self.names, GROUND])}
        self.mass = np.array([body.mass for body in model.bodies.values()])
        self.inertia = np.array([body.inertia for body in model.bodies.values()])
        self.centre = np.array([*(body.centre for body in model.bodies.values()), np.zeros(3)])
        self.kept = np.array([0, 1, 5]) if model.plane else np.arange(6)
        self.motors = 13 * n + sum(joint.play.memories for joint in self.plays if joint.play)
        self.turned = [k for k, motor in enumerate(model.motors) if motor.drive is None]
        self.held_efforts = self.motors + 2 * len(self.turned)
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
        velocities = 6 * n + 6 + np.arange(len(self.turned))
        self.keep = np.append((6 * np.arange(n)[:, None] + self.kept).ravel(), velocities)
        self._along()

    def _along(self) -> None:
        """What acts along coordinates, by the numbers of these: first those of joints, then those of motors."""
        every = [*(coordinate for _, coordinate in self.own), *self.model.motors]
        self.number = {coordinate.name: i for i, coordinate in enumerate(every)}
        self.efforts: list[tuple[int, Effort, Vector, Vector]] = []
        for i, coordinate in enumerate(every):
            for effort in coordinate.efforts if coordinate.drive is None else ():
                places = effort.encoder or (coordinate.name,)
                rates = effort.rate_encoder or places
                self.efforts.append((i, effort, self._sum(places), self._sum(rates)))
        self.digital = [k for k, (_, effort, _, _) in enumerate(self.efforts) if effort.period]
        self.integrating = [k for k, (_, effort, _, _) in enumerate(self.efforts) if effort.error]
        self.integrals = self.held_efforts + len(self.digital)
        self.follows = np.array([self.factors(one.form.terms) for one in self.model.couplings]).reshape(-1, len(every))
        self.size = self.integrals + len(self.integrating) + len(INTEGRALS)

    def _sum(self, names: tuple[str, ...]) -> Vector:
        """What an encoder sees. A joint behind a spring is there by how much the link is ahead of its motor."""
        motors = {motor.name for motor in self.model.motors}
        ahead = [{name: 1.0, MOTOR.format(name): -float(MOTOR.format(name) in motors)} for name in names]
        return np.sum([self.factors(terms) for terms in ahead], 0)

    def factors(self, terms: dict[str, float]) -> Vector:
        """Factors of all coordinates, by those of some names."""
        out = np.zeros(len(self.number))
        for name, factor in terms.items():
            if factor:
                out[self.number[name]] = factor
        return out

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

    def now(self, y: Vector, t: float = 0.0) -> Now:
        """The bodies and motors of a state."""
        motors = np.zeros((3, len(self.model.motors)))
        motors[:2, self.turned] = y[self.motors : self.held_efforts].reshape(2, -1)
        for k, motor in enumerate(self.model.motors):
            if motor.drive is not None:
                motors[:, k] = motor.drive.at(t)
        return Now(*kernels.bodies(y, len(self.names)), motors)

    def moves(self, at: Now, jacobian: Vector, bias: Vector) -> Moves:
        """All coordinates; the jacobian is that of all rows."""
        n, motors, rows = len(self.own), len(self.model.motors), len(self.held)
        out = np.zeros((n + motors, jacobian.shape[1] + len(self.turned)))
        out[:n, : jacobian.shape[1]] = jacobian[rows:]
        out[[n + k for k in self.turned], jacobian.shape[1] + np.arange(len(self.turned))] = 1.0
        given = np.zeros(n + motors)
        given[n:] = at.motors[1]
        given[[n + k for k in self.turned]] = 0.0
        value = np.append([self.coordinate(i, at) for i in range(n)], at.motors[0])
        return Moves(value, out @ self.speeds(at) + given, out, np.append(bias[rows:], at.motors[2]), given)

    def speeds(self, at: Now) -> Vector:
        """All velocities: those of bodies and the ground, and of motors that no drive moves."""
        bodies = np.concatenate([at.velocity, at.turning], 1).ravel()
        return np.append(bodies, at.motors[1][self.turned])

    def place(self, form: Form, moves: Moves) -> tuple[float, float, Vector]:
        """The place of a form, its rate, and how it depends on the coordinates."""
        factors, (size, order, phase) = self.factors(form.terms), form.wave
        place = float(factors @ moves.value) - form.offset
        if form.motor and size:
            i = self.number[form.motor]
            angle = order * moves.value[i] + phase
            place -= size * np.sin(angle)
            factors[i] -= size * order * np.cos(angle)
        return place, float(factors @ moves.rate), factors

    def jacobian(self, at: Now) -> tuple[Vector, Vector]:
        """Of every row its dependence on all velocities, shape (rows, 6 (bodies and ground)), and the bias of its
        second rate.
        """
        return kernels.jacobian(*at[:4], *self.rows)

    def pose(self, joint: Joint | Gap, at: Now) -> Any:
        """The relative motion in a joint, in the axes of its play; of a gap its place and rate."""
        if isinstance(joint, Gap):
            return self.place(joint.form, self.moves(at, *self.jacobian(at)))[:2]
        return Pose(*kernels.pose(*at[:4], *self.frames[joint.name]))

    def coordinate(self, i: int, at: Now) -> float:
        """The value of a joint's own coordinate; a turn within half a turn of its start."""
        coordinate, pose = self.own[i][1], Pose(*kernels.pose(*at[:4], *self.own_frames[i]))
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
        now = self.now(y, t)
        n = len(self.names)
        pushes = self.pushes(y, now, regime)
        acceleration, motors, work, dampers, dry, _ = self.accelerations(t, y, now, pushes)
        out = np.zeros_like(y)
        out[: 3 * n], out[7 * n : 13 * n] = now.velocity[:-1].ravel(), acceleration
        out[3 * n : 7 * n] = kernels.quaternion_rates(y, n)
        out[13 * n : self.motors] = self._remembered(pushes)
        out[self.motors : self.held_efforts] = np.append(now.motors[1, self.turned], motors)
        if self.integrating:
            places = self.moves(now, *self.jacobian(now)).value
            every = [self.efforts[k] for k in self.integrating]
            errors = [effort.error(t, float(seen @ places)) for _, effort, seen, _ in every if effort.error]
            out[self.integrals : self.integrals + len(errors)] = errors
        out[-3:] = work, sum(p.absorbed for p in pushes) + dampers, sum(p.rubbed for p in pushes) + dry
        return out

    def pushes(self, y: Vector, now: Now, regime: Regime) -> list:
        """What every joint with play and every gap does."""
        return [
            joint.play.act(self.pose(joint, now), memory, speed, touches, presses)
            for joint, memory, touches, presses, speed in zip(
                self.plays, self.memory(y), *regime._asdict().values(), strict=True
            )
            if joint.play is not None
        ]

    def _remembered(self, pushes: list[Push]) -> Vector:
        rates = []
        for joint, push in zip(self.plays, pushes, strict=True):
            assert joint.play is not None
            rates += [push.flows] if joint.play.normal.memories else []
            rates += [push.bends.ravel()] if joint.play.friction is not None and joint.play.friction.remembers else []
        return np.concatenate(rates) if rates else np.zeros(0)

    def masses(self, now: Now, moves: Moves, gravity: Vector) -> tuple[Vector, Vector]:
        """The mass matrix with rotors, and the weights of the bodies and the ground."""
        n, size = 6 * len(self.names), moves.rows.shape[1]
        matrix = np.zeros((size, size))
        matrix[:n, :n], force = kernels.mass_and_weight(now.matrix, now.turning, self.mass, self.inertia, gravity)
        for i in self.free:
            if self.own[i][1].rotor:
                matrix += self.own[i][1].rotor * np.outer(moves.rows[i], moves.rows[i])
        for k, motor in enumerate(self.turned):
            matrix[n + 6 + k, n + 6 + k] = self.model.motors[motor].rotor
        return matrix, force

    def constraints(self, now: Now, moves: Moves, jacobian: Vector, bias: Vector, t: float):
        """Of all that is held, driven or coupled: rows, the velocities that they ask for, and the accelerations."""
        drives = np.array([self.own[i][1].drive.at(t) for i in self.driven]).reshape(-1, 3)
        rows = np.zeros((len(self.active) + len(self.follows), moves.rows.shape[1]))
        rows[: len(self.active), : jacobian.shape[1]] = jacobian[self.active]
        rows[len(self.active) :] = self.follows @ moves.rows
        held = np.zeros(len(self.held))
        rates = np.concatenate([held, drives[:, 1], -self.follows @ moves.given])
        wanted = np.concatenate([held, drives[:, 2], np.zeros(len(self.follows))])
        return rows, rates, wanted - np.append(bias[self.active], self.follows @ moves.bias)

    def asks(self, k: int, t: float, moves: Moves) -> float:
        """The effort that an actuator would have now."""
        _, effort, places, rates = self.efforts[k]
        return float(effort.of(t, float(places @ moves.value), float(rates @ moves.rate)))

    def _actuated(self, t, y, moves, force) -> tuple[float, float, float]:
        """Adds the efforts of actuators; their power, and those of their dampers and their friction."""
        power = lost = rubbed = 0.0
        for k, (i, effort, _, _) in enumerate(self.efforts):
            given = self.asks(k, t, moves)
            if k in self.digital:
                given = y[self.held_efforts + self.digital.index(k)]
            if k in self.integrating:
                given += effort.gain * y[self.integrals + self.integrating.index(k)]
            rate = moves.rate[i]
            damped, dry = effort.damped(rate), effort.rubbed(rate)
            power, lost, rubbed = power + given * rate + damped + dry, lost + damped, rubbed + dry
            force += given * moves.rows[i]
        return power, lost, rubbed

    def accelerations(self, t: float, y: Vector, now: Now, pushes: list):
        """Accelerations [all places, all turns], those of motors, the power of drives, actuators and loads, those of
        dampers and of the friction of actuators, and the efforts of couplings on their followers.
        """
        n, (jacobian, bias) = len(self.names), self.jacobian(now)
        moves = self.moves(now, jacobian, bias)
        matrix, bodies = self.masses(now, moves, self.model.gravity)
        power, lost = self._loaded(t, now, bodies), self._sprung(now, bodies)
        for joint, push in zip(self.plays, pushes, strict=True):
            if not isinstance(joint, Gap):
                self._push(bodies, joint, now, push)
        force = np.append(bodies.ravel(), np.zeros(len(self.turned)))
        along, worn = np.zeros(len(moves.value)), 0.0  # efforts of gaps and couplings on coordinates, lost in gears
        for gap, push in zip(self.plays, pushes, strict=True):
            if isinstance(gap, Gap):
                along += push.effort * self.place(gap.form, moves)[2]
                power += 0.0 if gap.counts else push.effort * push.rate + push.absorbed
                if gap.loss is not None:
                    motor = self.number[gap.form.motor]
                    against = gap.loss.effort(push.effort, moves.rate[motor])
                    along[motor] -= against
                    worn += against * moves.rate[motor]
        force += along @ moves.rows
        for i in self.free:
            force -= self.own[i][1].rotor * moves.bias[i] * moves.rows[i]
        acted, damped, rubbed = self._actuated(t, y, moves, force)
        rows, rates, wanted = self.constraints(now, moves, jacobian, bias, t)
        right = kernels.saddle(matrix, rows, force, wanted, self.keep)
        out = kernels.solve(*right) if self.model.plane else self._least(*right)
        acceleration, multipliers = np.zeros(6 * n + 6 + len(self.turned)), out[len(self.keep) :]
        acceleration[self.keep] = out[: len(self.keep)]
        driven, coupled = multipliers[len(self.held) : len(self.active)], multipliers[len(self.active) :]
        along += coupled @ self.follows
        # The drives of motors bear what acts on these.
        power += acted + driven @ rates[len(self.held) : len(self.active)] - along @ moves.given
        of = acceleration[: 6 * n].reshape(n, 6)
        both = np.concatenate([of[:, :3].ravel(), of[:, 3:].ravel()])
        return both, acceleration[6 * n + 6 :], power, lost + damped, rubbed + worn, coupled

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
