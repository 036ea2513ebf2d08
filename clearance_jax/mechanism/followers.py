"""Coordinates that follow others: what they follow in the end, and their motion where drives prescribe that."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.body import Motion
from clearance_jax.mechanism.couplings import Coupling
from clearance_jax.mechanism.motion.motion_laws import AbstractMotionLaw
from clearance_jax.mechanism.tree.coordinate import Coordinate
from clearance_jax.mechanism.tree.tree import AbstractJoint
from clearance_jax.mechanism.variants import motors_of, with_motions
from clearance_jax.spatial import Term, plus, times


class Resolved(NamedTuple):
    """A follower's value by coordinates that follow none: the sum of `terms` (a factor by name) and an `offset`."""

    terms: dict[str, Term]
    offset: Term


def relations(couplings: Sequence[Coupling], motors: Mapping[str, str]) -> dict[str, Resolved]:
    """By follower its relation; a link's angle is the sum of its motor's and its spring's (`motors`: by link)."""
    by_name, out = {c.follower: c for c in couplings}, {}

    def of(name: str) -> Resolved:
        if name not in by_name:
            return Resolved({name: 1.0} | ({motors[name]: 1.0} if name in motors else {}), 0.0)
        if name not in out:
            terms: dict[str, Term] = {}
            offset: Term = by_name[name].offset
            for leader, ratio in by_name[name].terms:
                inner = of(leader)
                offset = plus(offset, times(ratio, inner.offset))
                for root, factor in inner.terms.items():
                    terms[root] = plus(terms.get(root, 0.0), times(ratio, factor))
            out[name] = Resolved(terms, offset)
        return out[name]

    return {name: of(name) for name in by_name}


class Following(AbstractMotionLaw):
    """The motion of a follower whose leaders are all driven, by the couplings' numbers (`relations`)."""

    factors: tuple[Term, ...]
    laws: tuple[AbstractMotionLaw, ...]
    offset: Term

    def __call__(self, time):
        whole: list[Term] = [self.offset, 0.0, 0.0]
        for factor, law in zip(self.factors, self.laws, strict=True):
            whole = [plus(term, times(factor, now)) for term, now in zip(whole, law(time), strict=True)]
        return whole[0], whole[1], whole[2]


class Follows(AbstractMotionLaw):
    """Stands for the motion of a follower whose leaders are all driven: preparing the mechanism puts `Following` in its
    place.
    """

    def __call__(self, time):
        raise ClearanceError("A follower's motion is known where its mechanism is prepared.")


def relations_of(mechanism: AbstractMechanism) -> dict[str, Resolved]:
    """By follower what it follows in the end, and how."""
    return relations(mechanism.firm_couplings, motors_of(mechanism.joints))


def mark_followers(
    mechanism: AbstractMechanism, couplings: Sequence[Coupling] | None = None
) -> tuple[AbstractJoint, ...]:
    """The joints of the tree, where a follower of driven coordinates has the drive `Follows`, and no other coordinate
    has it; by other `couplings` its stops go.

    **Raises:** `ClearanceError` by its own ones, where such a follower has stops: nothing would give way to them.
    """
    given = mechanism.firm_couplings if couplings is None else couplings
    by_name = {coupling.follower: coupling for coupling in given}
    drives, motors = {c.name: c.motion.drive for c in mechanism.coordinates()}, motors_of(mechanism.joints)
    if not by_name and not any(isinstance(drive, Follows) for drive in drives.values()):
        return mechanism.joints

    def is_driven(name: str, deep: int = 0) -> bool:
        if name not in by_name:
            return all(drives.get(each) is not None for each in (name, motors.get(name, name)))
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
