"""Checks that the parts of a mechanism fit together: names, the tree, attached parts, control."""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from jax.core import Tracer

from clearance_jax.errors import ClearanceError, unknown_name
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.body import GROUND, Body, Motion, Motor, Spring
from clearance_jax.mechanism.controllers import AbstractController
from clearance_jax.mechanism.couplings import Coupling, check_couplings, leaders_of
from clearance_jax.mechanism.followers import Follows
from clearance_jax.mechanism.placement import Inertia, Position
from clearance_jax.mechanism.tree.coordinate import Coordinate
from clearance_jax.mechanism.tree.tree import AbstractJoint, AbstractPlayed, Fixed, Prismatic, Revolute
from clearance_jax.mechanism.variants import gives_way, motor_of

RESERVED = (GROUND, "gravity", "drive", "target")
# Degrees of freedom between two frames.
SPACE = 6


def check_structure(mechanism: AbstractMechanism) -> None:
    """Raise where the parts of a mechanism do not fit together."""
    bodies, joints, loops = mechanism.bodies, mechanism.joints, mechanism.loops
    _check_names(mechanism)
    _check_tree(bodies, joints, loops)
    _check_attached(bodies, mechanism.springs, (*mechanism.points, *mechanism.wrenches))
    _check_payloads(bodies, joints)
    _check_coupled(mechanism)
    _check_control(mechanism.controllers, tuple(mechanism.coordinates()), mechanism.firm_couplings)
    if not mechanism.is_plane:
        _check_tilting(bodies, joints)
        _check_loose(loops)


def _check_names(mechanism: AbstractMechanism) -> None:
    """Raise where two parts have one name."""
    parts = (*mechanism.bodies, *mechanism.all_joints(), *mechanism.springs, *mechanism.points, *mechanism.wrenches)
    motors = [joint.motor for joint in mechanism.joints if isinstance(joint, Revolute | Prismatic)]
    meshes = {coupling.name for coupling in mechanism.couplings}
    seen: set[str] = set()
    for part in (
        *parts,
        *mechanism.couplings,
        *mechanism.controllers,
        *(motor for motor in motors if motor is not None),
        *(gap for gap in mechanism.gaps if gap.name not in meshes),
    ):
        if part.name in seen or part.name in RESERVED:
            raise ClearanceError(f"The name `{part.name}` is used twice or reserved. Rename one of the parts.")
        seen.add(part.name)


def _check_tree(bodies: Sequence[Body], joints: Sequence[AbstractJoint], loops: Sequence[AbstractJoint]) -> None:
    """Raise unless the joints place every body once, parents first, and loops join two that are placed."""
    if not bodies:
        raise ClearanceError("A mechanism needs at least one body (in a scene file a table `[body.NAME]`).")
    names, placed = {body.name for body in bodies}, {GROUND}
    for joint in joints:
        _check_known(joint.name, "parent", joint.parent, placed)
        _check_known(joint.name, "child", joint.child, names - placed)
        placed.add(joint.child)
    loose = names - placed
    if loose:
        raise ClearanceError(f"No joint connects body `{min(loose)}` to the ground. Add a joint with it as child.")
    for loop in loops:
        _check_known(loop.name, "parent", loop.parent, placed)
        _check_known(loop.name, "child", loop.child, placed)
        _distinct(loop.name, "parent", "child", loop.parent, loop.child)


def _check_loose(loops: Sequence[AbstractJoint]) -> None:
    """Raise for a loop joint with clearance in space that has neither play nor motion in some direction."""
    for loop in loops:
        if not isinstance(loop, AbstractPlayed) or loop.clearance is None:
            continue
        directions = sum(len(coordinate.velocities) for coordinate in loop.own_coordinates())
        if directions < SPACE:
            key = _tilting(loop)
            raise ClearanceError(
                f"Joint `{loop.name}` closes a loop in space, where nothing but its contacts holds it, and has no play "
                f"in {SPACE - directions} of {SPACE} directions. Give it play there (a sleeve `axial_clearance`, a "
                "guide `width`), or put it into the tree and close the loop at another joint."
                + ("" if key is None else f" If the mechanism is a plane one, leave the joint's `{key}` out.")
            ).about(loop.name, directions)


def _check_tilting(bodies: Sequence[Body], joints: Sequence[AbstractJoint]) -> None:
    """Raise, naming the play, if play takes bodies with only one moment of inertia out of the plane."""
    tilted: dict[str, AbstractJoint] = {}  # what a body hangs on, by the body
    for joint in joints:
        above = joint if _tilting(joint) is not None else tilted.get(joint.parent)
        if above is not None:
            tilted[joint.child] = above
    for body in bodies:
        if body.name in tilted and body.inertia is not None and not isinstance(body.inertia, Inertia):
            joint = tilted[body.name]
            key = _tilting(joint)
            what = "has a `width`" if key == "width" else "is a sleeve (a bearing of an arm's joint too)"
            raise ClearanceError(
                f"Joint `{joint.name}` {what}, so that what it carries may turn out of the plane, but body "
                f"`{body.name}` has one moment of inertia (about z). Leave `{key}` out, or give the body three or six "
                "moments (xx, yy, zz, xy, xz, yz)."
            ).about(f"{body.name}.inertia")


def _tilting(joint: AbstractJoint) -> str | None:
    """The number of a joint's play that takes it out of the plane, if it stays there without play."""
    if not isinstance(joint, AbstractPlayed) or joint.clearance is None or joint.is_plane:
        return None
    key = "width" if isinstance(joint, Prismatic) else "kind"
    ideal: Any = dataclasses.replace(joint, clearance=None, eccentricity=Position())
    return key if ideal.is_plane and getattr(joint.clearance, key, None) is not None else None


def _check_attached(bodies: Sequence[Body], springs: Sequence[Spring], points: Iterable[Any]) -> None:
    """Raise where a spring, a point or a load refers to an unknown body."""
    placed = {GROUND, *(body.name for body in bodies)}
    for spring in springs:
        _check_known(spring.name, "body_a", spring.body_a, placed)
        _check_known(spring.name, "body_b", spring.body_b, placed)
        _distinct(spring.name, "body_a", "body_b", spring.body_a, spring.body_b)
    for point in points:
        _check_known(point.name, "body", point.body, placed)


def _check_payloads(bodies: Sequence[Body], joints: Sequence[AbstractJoint]) -> None:
    """Raise for a payload that moves on its carrier, carries something itself, or is put down before it is there."""
    for body in bodies:
        if body.is_always_there:
            continue
        carrying = next(joint for joint in joints if joint.child == body.name)
        if not isinstance(carrying, Fixed):
            raise ClearanceError(
                f"`{body.name}` is a payload that comes or goes (`picked_up`, `put_down`), so joint `{carrying.name}`, "
                "which carries it, must be fixed."
            )
        hanging = [joint.name for joint in joints if joint.parent == body.name and joint.own_coordinates()]
        if hanging:
            text = f"`{body.name}` is a payload that comes or goes: joint `{hanging[0]}` may not move on it."
            raise ClearanceError(text)
        begin, end = body.picked_up, body.put_down
        if begin is None or end is None or isinstance(begin, Tracer) or isinstance(end, Tracer):
            continue
        if not np.all(end > begin):
            raise ClearanceError(f"`{body.name}.put_down` must be later than `{body.name}.picked_up`.")


def _check_coupled(mechanism: AbstractMechanism) -> None:
    """Raise where a coupling does not fit, or where an actuator acts on a follower that nothing can give way to."""
    every = list(mechanism.coordinates())
    motors = {c.name for c in every if isinstance(c.motion, Motor) or gives_way(c.motion)}
    driven = {c.name for c in every if c.motion.drive is not None and not isinstance(c.motion.drive, Follows)}
    known = {c.name: c.play is None and not c.is_ball for c in every}
    check_couplings(mechanism.couplings, known, driven, motors)
    followers = {coupling.follower for coupling in mechanism.firm_couplings}
    for c in every:
        acts = c.name in followers and c.motion.is_free and c.motion.actuators
        roots = leaders_of(c.name, mechanism.firm_couplings) if acts else set()
        # A link whose drive gives way is moved by its motor too.
        firm = driven.intersection(roots | {motor_of(name) for name in roots})
        if firm:
            leader = min(firm)
            text = f"`{c.name}` follows the driven `{leader}`, so it takes no actuators, friction or springs."
            raise ClearanceError(text).about(c.name)


def _check_control(
    controllers: Sequence[AbstractController], coordinates: Sequence[Coordinate], couplings: Sequence[Coupling]
) -> None:
    """Raise where an actuator measures, or a controller commands, a coordinate that it cannot."""
    every = {c.name: c for c in coordinates if not c.is_ball}
    followers = {coupling.follower for coupling in couplings}
    free = {name for name, c in every.items() if c.motion.is_free and c.play is None and name not in followers}
    for c in every.values():
        if c.motion.actuators and not (c.motion.is_free or isinstance(c.motion.drive, Follows)):
            raise ClearanceError(
                f"`{c.name}` must have a drive or actuators, but it has both: a drive prescribes its motion, whatever "
                "else acts on it. Leave out the drive or the actuators (friction and springs among them)."
            )
        for actuator in c.motion.actuators:
            seen = (*actuator.measures(), *actuator.measures_rate())
            # A joint may name the motor that `with_compliance` is about to give it; `check_encoders` looks again.
            known = every if isinstance(c.motion, Motor) or gives_way(c.motion) else every | {motor_of(c.name): c}
            _check_encoder(f"An actuator of `{c.name}`", seen, c, known)
    owner: dict[str, str] = {}
    for controller in controllers:
        for reference in controller.references:
            name, what = reference.name, f"Controller `{controller.name}`"
            if name not in free:
                raise unknown_name(f"{what} commands `{name}`, which is no free coordinate.", name, free)
            if name in owner:
                raise ClearanceError(f"{what} commands `{name}`, which controller `{owner[name]}` commands already.")
            owner[name] = controller.name
            _check_encoder(what, reference.encoder, every[name], every)


def check_encoders(coordinates: Sequence[Coordinate]) -> None:
    """Raise where an actuator measures a motor that its joint does not have."""
    names = {c.name for c in coordinates}
    for c in coordinates:
        for actuator in c.motion.actuators if isinstance(c.motion, Motion) else ():
            if {*actuator.measures(), *actuator.measures_rate()} - names:
                raise ClearanceError(
                    f"An actuator of `{c.name}` measures its motor, but the joint has none: give its drive compliance."
                ).about(motor_of(c.name))


def _check_encoder(what: str, encoder: Sequence[str], coordinate: Coordinate, every: dict[str, Coordinate]) -> None:
    for name in encoder:
        if name not in every:
            raise unknown_name(f"{what} measures `{name}`, but there is no such coordinate.", name, every)
        if (every[name].slides is None) != (coordinate.slides is None):
            raise ClearanceError(f"{what} measures `{name}`: an angle and a length cannot stand for each other.")


def check_model(controller: AbstractController, model: Any) -> Any:
    """The model of a controller. **Raises** `ClearanceError` for loops, and if references miss free coordinates."""
    what = f"The model of controller `{controller.name}`"
    if model.loops:
        raise ClearanceError(
            f"{what} has the loop `{model.loops[0].name}`, but inverse dynamics is of trees only. Give it a `model` "
            "without loops."
        )
    free, named = ({c.name for c in model.free_coordinates()}, {reference.name for reference in controller.references})
    for name in sorted(free ^ named):
        reason = "and its references do not name it" if name in free else "but its references name it"
        raise ClearanceError(f"{what} has {'the' if name in free else 'no'} free coordinate `{name}`, {reason}.")
    return model


def _check_known(owner: str, key: str, word: str, allowed: set[str]) -> None:
    if word not in allowed:
        text = f"`{owner}.{key}` must name a body, but `{word}` is not one that fits."
        raise unknown_name(text, word, allowed, f"{owner}.{key}")


def _distinct(owner: str, key: str, other_key: str, first: str, second: str) -> None:
    if first == second:
        text = f"`{owner}.{key}` and `{owner}.{other_key}` must name two bodies, but both name `{first}`. Change one."
        raise ClearanceError(text)
