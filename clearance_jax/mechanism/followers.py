"""Coordinates that follow others: what they follow in the end, and their motion where drives prescribe that."""

import dataclasses
from collections.abc import Sequence

from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.body import Motion
from clearance_jax.mechanism.couplings import Coupling, Following, Follows, Resolved, relations
from clearance_jax.mechanism.tree.coordinate import Coordinate
from clearance_jax.mechanism.tree.tree import AbstractJoint
from clearance_jax.mechanism.variants import gives_way, motor_of, with_motions


def relations_of(mechanism: AbstractMechanism) -> dict[str, Resolved]:
    """By follower what it follows in the end, and how."""
    motors = {c.name: motor_of(c.name) for c in mechanism.moved_coordinates() if gives_way(c.motion)}
    return relations(mechanism.firm_couplings, motors)


def mark_followers(
    mechanism: AbstractMechanism, couplings: Sequence[Coupling] | None = None
) -> tuple[AbstractJoint, ...]:
    """The joints of the tree, where a follower of driven coordinates has the drive `Follows`, and no other coordinate
    has it; by other `couplings` its stops go.

    **Raises:** `ClearanceError` by its own ones, where such a follower has stops: nothing would give way to them.
    """
    given = mechanism.firm_couplings if couplings is None else couplings
    by_name = {coupling.follower: coupling for coupling in given}
    drives = {c.name: c.motion.drive for c in mechanism.coordinates()}
    if not by_name and not any(isinstance(drive, Follows) for drive in drives.values()):
        return mechanism.joints

    def is_driven(name: str, deep: int = 0) -> bool:
        if name not in by_name:
            return drives.get(name) is not None
        # A circle is found, and refused, later.
        return deep <= len(by_name) and all(is_driven(leader, deep + 1) for leader, _ in by_name[name].terms)

    def change(c: Coordinate) -> Motion:
        marked, follows = isinstance(c.motion.drive, Follows), c.name in by_name and is_driven(c.name)
        if marked == follows or (follows and c.motion.drive is not None):
            return c.motion
        if couplings is None and follows and c.motion.stops is not None:
            text = f"`{c.name}` follows driven coordinates, so it takes no stops: nothing would give way to them."
            raise ClearanceError(text).about(c.name)
        # Its actuators stay, unused: its leader's drive may come to give way, and then they act.
        return dataclasses.replace(c.motion, drive=Follows() if follows else None, stops=None)

    return tuple(with_motions(joint, change) for joint in mechanism.joints)


def with_followed_drives(mechanism: AbstractMechanism) -> tuple[AbstractJoint, ...]:
    """The joints of the tree, where each `Follows` is the motion itself."""
    if not mechanism.firm_couplings:
        return mechanism.joints
    drives = {c.name: c.motion.drive for c in mechanism.coordinates()}
    every = relations_of(mechanism)

    def change(c: Coordinate) -> Motion:
        if not isinstance(c.motion.drive, Follows):
            return c.motion
        terms, offset = every[c.name]
        laws = [drives[name] for name in terms]
        prepared = tuple(law.prepare() for law in laws if law is not None)
        return dataclasses.replace(c.motion, drive=Following(tuple(terms.values()), prepared, offset))

    return tuple(with_motions(joint, change) for joint in mechanism.joints)
