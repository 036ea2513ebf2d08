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
    model, extra = system.model, _extra(system.model)
    joints = tuple(_ideal(_turning(joint, extra, -1.0)) for joint in model.joints)
    # Until loops are closed pins stay in the middle of their sleeves, or at their eccentricity; drives and flanks stay.
    ties = _ties(model)
    closed = System(model._replace(joints=joints, couplings=(*model.couplings, *ties)))
    y, bodies, motors = np.zeros(closed.size), 13 * len(system.names), [model.motors[k] for k in system.turned]
    _fill(system, y, _tree(model))
    y[closed.motors : closed.held_efforts] = [*(motor.start for motor in motors), *(motor.rate for motor in motors)]
    if ties or len(closed.active) + len(closed.follows):
        _close(closed, y)
        # The rates that joints are given are those of the closed mechanism.
        _fill(system, y, _tree(closed.model, _found(closed, y)))
        _hasten(closed, y, len(ties))
    if extra:
        # Then what followers with backlash are given beside their leaders.
        ties = ties[: len(model.motors)]
        closed = System(closed.model._replace(couplings=(*model.couplings, *ties)))
        still = tuple(_turning(joint, extra) for joint in joints)
        faster = np.zeros_like(y)
        _fill(system, faster, _tree(model._replace(joints=still), _found(closed, y)))
        y[7 * len(system.names) : bodies] += faster[7 * len(system.names) : bodies]
        _hasten(closed, y, len(ties))
    out = np.zeros(system.size)
    out[:bodies], out[system.motors : system.held_efforts] = y[:bodies], y[closed.motors : closed.held_efforts]
    return out


def _ideal(joint: Joint) -> Joint:
    axes = np.eye(3) if joint.play is None else joint.play.axes
    return joint._replace(held=HELD[joint.kind], play=None, eccentricity=axes @ joint.eccentricity)


def _extra(model: Model) -> dict[str, float]:
    """By follower with backlash the rate that it is given beside its leaders."""
    every = [*(c for joint in model.joints for c in joint.coordinates), *model.motors]
    rate = {one.name: one.rate if one.drive is None else one.drive.at(0.0)[1] for one in every}
    forms = [gap.form.terms for gap in model.gaps if len(gap.form.terms) > 1 and not gap.form.motor]
    return {next(iter(terms)): sum(factor * rate[name] for name, factor in terms.items()) for terms in forms}


def _turning(joint: Joint, extra: dict[str, float], share: float = 0.0) -> Joint:
    """The joint with a share of these rates more; without a share with these rates alone."""
    if share:
        rates = [c.rate + share * extra.get(c.name, 0.0) for c in joint.coordinates]
        return joint._replace(
            coordinates=tuple(c._replace(rate=r) for c, r in zip(joint.coordinates, rates, strict=True))
        )
    alone = tuple(c._replace(rate=extra.get(c.name, 0.0), drive=None) for c in joint.coordinates)
    return joint._replace(coordinates=alone, ball=(joint.ball[0], np.zeros(3)))


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


def _close(system: System, y: Vector) -> None:
    """Newton for places, by `_nearest`, in place."""
    n, keep, turned = len(system.names), system.keep, len(system.turned)
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


def _found(system: System, y: Vector) -> dict[str, tuple[Vector, Vector]]:
    """Places of the origins and matrices of all bodies."""
    now = system.now(y)
    return {
        name: (now.place[i] - now.matrix[i] @ system.centre[i], now.matrix[i]) for i, name in enumerate(system.names)
    }


def _hasten(system: System, y: Vector, ties: int) -> None:
    """The nearest velocities that the constraints allow, by `_nearest`, in place; what the last `ties` of the couplings
    hold keeps its velocity.
    """
    now, n, keep = system.now(y), len(system.names), system.keep
    rows, rates, _ = _constraints(system, now)
    speeds = system.speeds(now)
    change = rates - rows @ speeds
    change[len(change) - ties :] = 0.0
    speeds[keep] += _nearest(system, now, change)
    y[system.motors + len(system.turned) : system.held_efforts] = speeds[6 * n + 6 :]
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
