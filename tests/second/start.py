"""The state with which a motion begins: the tree by its initial values, then every loop closed as if it and the drives
were ideal, by the smallest change in the norm of the kinetic energy: a mechanism that is free to move closes at many
poses.
"""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from .gears import MOTOR, Coupling, Form
from .model import DIRECTIONS, HELD, Joint, Model
from .quantities import Vector, about, cross, quaternion
from .system import Now, System

Places = dict[str, tuple[Vector, Vector, Vector, Vector]]


def initial(system: System) -> Vector:
    """The state at t = 0."""
    model = system.model
    places = _tree(model)
    # Until loops are closed pins stay in the middle of their sleeves, or at their eccentricity, as do drives and flanks
    ties = _ties(model)
    joints = tuple(_ideal(joint) for joint in model.joints)
    closed = System(model._replace(joints=joints, couplings=(*model.couplings, *ties)))
    y, bodies, motors = np.zeros(closed.size), 13 * len(system.names), [model.motors[k] for k in system.turned]
    _fill(system, y, places)
    y[closed.motors : closed.held_efforts] = [*(motor.start for motor in motors), *(motor.rate for motor in motors)]
    _close(closed, y, len(ties))
    out = np.zeros(system.size)
    out[:bodies], out[system.motors : system.held_efforts] = y[:bodies], y[closed.motors : closed.held_efforts]
    return out


def _ideal(joint: Joint) -> Joint:
    axes = np.eye(3) if joint.play is None else joint.play.axes
    return joint._replace(held=HELD[joint.kind], play=None, eccentricity=axes @ joint.eccentricity)


def _ties(model: Model) -> list[Coupling]:
    """What holds links to motors and flanks to flanks."""
    every = [*(c for joint in model.joints for c in joint.coordinates), *model.motors]
    start = {one.name: one.start if one.drive is None else one.drive.at(0.0)[0] for one in every}
    moved = [{name.removesuffix(MOTOR.format("")): 1.0, name: -1.0} for name in (one.name for one in model.motors)]
    forms = [*moved, *(gap.form.terms for gap in model.gaps if len(gap.form.terms) > 1 and not gap.form.motor)]
    return [Coupling("", Form(terms, sum(f * start[name] for name, f in terms.items())), False) for terms in forms]


def _tree(model: Model, found: dict[str, tuple[Vector, Vector]] | None = None) -> Places:
    """Place of the origin, matrix, velocity of the origin and turning of every body that the tree places, or of bodies
    whose places and matrices were `found`.
    """
    still = np.zeros(3)
    out: Places = {"ground": (still, np.eye(3), still, still)}
    for joint in model.joints:
        if joint.child in out:
            continue
        origin, matrix, velocity, turning = out[joint.parent]
        frame = matrix @ joint.on_parent
        place = origin + matrix @ joint.at_parent
        slid, turned = np.array(joint.eccentricity), np.eye(3)
        if joint.play is not None:
            slid = joint.play.axes @ slid
        fast, spun = np.zeros(3), np.zeros(3)
        for coordinate in joint.coordinates:
            value, rate = coordinate.start, coordinate.rate
            if coordinate.drive is not None:
                value, rate, _ = coordinate.drive.at(0.0)
            k = DIRECTIONS[coordinate.direction[-1]]
            if coordinate.direction.startswith("turn"):
                turned, spun = about(k, value), rate * np.eye(3)[k]
            else:
                slid, fast = slid + value * np.eye(3)[k], rate * np.eye(3)[k]
        if joint.kind in ("spherical", "free"):
            turned, spun = joint.ball[0], joint.ball[0] @ joint.ball[1]
        spin = turning + frame @ spun
        child = frame @ turned @ joint.on_child.T
        start = place + frame @ slid - child @ joint.at_child
        if found:
            start, child = found[joint.child]
        arm = child @ joint.at_child
        speed = velocity + cross(turning, start + arm - origin) + frame @ fast
        out[joint.child] = start, child, speed - cross(spin, arm), spin
    return out


def _fill(system: System, y: Vector, places: Places) -> None:
    n = len(system.names)
    for i, name in enumerate(system.names):
        origin, matrix, velocity, turning = places[name]
        arm = matrix @ system.centre[i]
        y[3 * i : 3 * i + 3] = origin + arm
        y[3 * n + 4 * i : 3 * n + 4 * i + 4] = quaternion(matrix)
        y[7 * n + 3 * i : 7 * n + 3 * i + 3] = velocity + cross(turning, arm)
        y[10 * n + 3 * i : 10 * n + 3 * i + 3] = turning


def _close(system: System, y: Vector, ties: int) -> None:
    """Newton for places, then the nearest velocities that the constraints allow, in place; both by `_nearest`. What the
    last `ties` of the couplings hold keeps its velocity.
    """
    n, keep, turned = len(system.names), system.keep, len(system.turned)
    if not len(system.active) + len(system.follows):
        return
    step = np.zeros(6 * n + 6 + turned)
    for _ in range(12):
        now = system.now(y)
        miss = _misses(system, now)
        step[keep] = _nearest(system, now, -miss)
        y[system.motors : system.motors + turned] += step[6 * n + 6 :]
        for i, change in enumerate(step[: 6 * n].reshape(n, 6)):
            y[3 * i : 3 * i + 3] += change[:3]
            moved = Rotation.from_rotvec(change[3:]).as_matrix() @ now.matrix[i]
            y[3 * n + 4 * i : 3 * n + 4 * i + 4] = quaternion(moved)
        if np.abs(step).max() < 1e-15:
            break
    if np.abs(step).max() > 1e-12:
        raise ValueError(f"The loops do not close: the last step is {np.abs(step).max():.1e}.")
    # The rates that joints are given are those of the closed mechanism.
    now = system.now(y)
    found = {
        name: (now.place[i] - now.matrix[i] @ system.centre[i], now.matrix[i]) for i, name in enumerate(system.names)
    }
    _fill(system, y, _tree(system.model, found))
    now = system.now(y)
    rows, rates, _ = _constraints(system, now)
    speeds = system.speeds(now)
    change = rates - rows @ speeds
    change[len(change) - ties :] = 0.0
    speeds[keep] += _nearest(system, now, change)
    y[system.motors + turned : system.held_efforts] = speeds[6 * n + 6 :]
    speeds = speeds[: 6 * n].reshape(n, 6)
    y[7 * n : 10 * n], y[10 * n : 13 * n] = speeds[:, :3].ravel(), speeds[:, 3:].ravel()


def _nearest(system: System, now: Now, change: Vector) -> Vector:
    """The motion of the kept directions that changes what is held by so much, with the least kinetic energy."""
    keep, moves = system.keep, system.moves(now, *system.jacobian(now))
    matrix = system.masses(now, moves, np.zeros(3))[0][np.ix_(keep, keep)]
    rows = _constraints(system, now)[0][:, keep]
    # Of z with step = root^-T z half the square is the energy.
    root = np.linalg.cholesky(matrix)
    least = np.linalg.lstsq(np.linalg.solve(root, rows.T).T, change, rcond=1e-10)[0]
    out: Any = np.linalg.solve(root.T, least)
    return out


def _constraints(system: System, now: Now):
    jacobian, bias = system.jacobian(now)
    return system.constraints(now, system.moves(now, jacobian, bias), jacobian, bias, 0.0)


def _misses(system: System, now: Now) -> Vector:
    """By how much every held or driven direction is off."""
    out = []
    for joint, way in system.held:
        pose = system.pose(joint, now)
        k = DIRECTIONS[way[-1]]
        if not way.startswith("turn"):
            out.append(pose.place[k] - joint.eccentricity[k])
            continue
        turned = pose.rotation
        if any(c.direction == "turn z" for c in joint.coordinates):
            turned = turned @ about(2, -np.arctan2(turned[1, 0], turned[0, 0]))
        i, j = (k + 1) % 3, (k + 2) % 3
        out.append(0.5 * (turned[j, i] - turned[i, j]))
    for i in system.driven:
        out.append(system.coordinate(i, now) - system.own[i][1].drive.at(0.0)[0])
    # A turn may be whole turns away from its drive.
    turns = [system.own[i][1].direction.startswith("turn") for i in system.driven]
    for k, is_turn in enumerate(turns):
        if is_turn:
            at = len(system.held) + k
            out[at] = (out[at] + np.pi) % (2 * np.pi) - np.pi
    moves = system.moves(now, *system.jacobian(now))
    return np.array([*out, *(system.place(one.form, moves)[0] for one in system.model.couplings)])
