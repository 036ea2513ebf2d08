"""Gaps of coordinates: backlash of drives and of couplings, the stops of joints, and friction that sticks.

Each is a contact along one number x = sum k_i q_i - o of the mechanism's coordinates q_i. Its effort T acts on every
one of them by k_i T. It is no wrench between two bodies: a motor does not feel the teeth of the gear behind it, but
what the gear lets through.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.joints.gap import Gap, Rub, ToothGap
from clearance_jax.laws.normal.flank import FlankSpring
from clearance_jax.mechanism.actuators import DriveLoss, DriveSpring, JointFriction, Wave
from clearance_jax.mechanism.body import Motion
from clearance_jax.mechanism.couplings import Coupling
from clearance_jax.mechanism.tree.coordinate import Coordinate
from clearance_jax.mechanism.tree.tree import AbstractJoint, Revolute
from clearance_jax.mechanism.variants import DRIVE, FRICTION, STOP, gives_way, has_gap, motor_of, motors_of, rubs
from clearance_jax.spatial import Pair

What = Literal["backlash", "elasticity", "stops", "teeth", "friction"]


class CoordinateGap(Module):
    """The gap of a place x = sum k_i q_i - o: `coordinates` with their `factors` (`None`: 1), the `offset` o (`None`:
    0), and the `clearance`, a `Gap` or `Rub`, or one with its laws' constants.

    - `in_tree`: whether all coordinates are states, so that the place is one too.
    - `turns`: whether x is an angle [rad], else a length [m].
    - `what` it is.
    - `teeth`: of a pair of gears, where its force acts: between two bodies, and not on coordinates.
    - `wave`: a transmission error A sin(n q + p) by the coordinate q of the `motor`, by which x is less.
    - `loss`: friction of the `motor`, which grows with the effort.
    """

    name: str = eqx.field(static=True)
    coordinates: tuple[str, ...] = eqx.field(static=True)
    factors: tuple[Scalar | None, ...]
    offset: Scalar | None
    clearance: Any
    in_tree: bool = eqx.field(static=True)
    turns: bool = eqx.field(static=True)
    what: What = eqx.field(static=True)
    wave: Wave | None = None
    motor: str = eqx.field(static=True, default="")
    teeth: "Teeth | None" = None
    loss: DriveLoss | None = None

    @property
    def is_play(self) -> bool:
        """Whether it is backlash."""
        return self.what == "backlash"

    @property
    def lasts(self) -> bool:
        """Whether ideal mechanisms have it: friction, but not of bristles, which are unbent where they begin."""
        return self.what == "friction" and not self.clearance.remembers

    @property
    def joint(self) -> "CoordinateGap":
        """Itself, for what asks a clearance joint for its joint."""
        return self

    @property
    def laws(self) -> tuple[Any, ...]:
        """Its contact laws, as the user gave them."""
        return self.clearance.laws

    @property
    def has_points(self) -> bool:
        """Whether it can touch at several points."""
        return getattr(self.clearance, "joint", self.clearance).count > 1

    @property
    def size(self) -> Array:
        """Half of its width [rad or m]; 1 of what has none."""
        has_width = self.what in ("backlash", "teeth") or self.is_between_stops
        return jnp.asarray(getattr(self.clearance, "joint", self.clearance).half if has_width else 1.0, float)

    @property
    def is_between_stops(self) -> bool:
        """Whether a stop ends it on either side."""
        return self.what == "stops" and getattr(self.clearance, "joint", self.clearance).sides == "both"

    def own_coordinates(self) -> tuple[()]:
        """None: its coordinates are those of joints."""
        return ()

    def prepare(self) -> "CoordinateGap":
        """The gap with its laws' constants."""
        return eqx.tree_at(lambda gap: gap.clearance, self, self.clearance.prepare())


def gaps_of(joints: tuple[AbstractJoint, ...], couplings: tuple[Coupling, ...]) -> tuple[CoordinateGap, ...]:
    """The gaps of drives and stops, in the order of the coordinates, then those of couplings."""
    by_name, motors = {c.name: c for joint in joints for c in joint.own_coordinates()}, motors_of(joints)
    every = [gap for c in by_name.values() if isinstance(c.motion, Motion) for gap in _of_coordinate(c, by_name)]
    for coupling in couplings:
        if coupling.base_radius is not None:
            every += _of_teeth(coupling, joints, by_name)
        elif coupling.backlash is not None:
            names = (coupling.follower, *(leader for leader, _ in coupling.terms))
            factors = (None, *(-ratio for _, ratio in coupling.terms))
            terms: dict[str, Scalar | None] = dict(zip(names, factors, strict=True))
            for name, factor in [*terms.items()]:
                if name in motors:
                    terms[motors[name]] = _sum(terms.get(motors[name], 0.0), factor)
            clearance = Gap(coupling.backlash, coupling.flank)  # pyright: ignore[reportArgumentType]
            every.append(_gap(coupling.name, terms, coupling.offset, clearance, by_name))
    return tuple(every)


def flanks_of(coupling: Coupling) -> tuple[str, ...]:
    """The names of the gaps of a coupling with backlash."""
    return (coupling.name,) if coupling.base_radius is None else (f"{coupling.name}_ahead", f"{coupling.name}_back")


class Teeth(Module):
    """Where flanks push two wheels apart: the bodies, and in the frame of the `carrier` the place `at` [m] where the
    line of action crosses that of the centres, and the direction `normal` of the force on the wheel. `sliding` [m]:
    what their flanks slide by the relative turn of both wheels; `None`: without friction.
    """

    carrier: str = eqx.field(static=True)
    pinion: str = eqx.field(static=True)
    wheel: str = eqx.field(static=True)
    at: Pair
    normal: Pair
    sliding: Scalar | None = None


def _of_teeth(
    coupling: Coupling, joints: tuple[AbstractJoint, ...], by_name: dict[str, Coordinate]
) -> Iterator[CoordinateGap]:
    """The two flanks of a pair of gears. The depth of each along its line of action is s r (q2 - k q1 - o) + n (u1 -
    u2) - j / 2, with the base radius r of the follower and the offsets u of both wheels in their bearings. (So the gap
    widens with the distance of the centres to first order.) Its slip is the mean over a pitch, by the relative turn of
    both wheels, and its friction a moment between them, by the same lever: the mean work is right, the ripple of the
    mesh is not there.
    """
    what, known = f"Coupling `{coupling.name}` has teeth (`base_radius`)", {joint.name: joint for joint in joints}
    wheel, pinion = (known.get(name) for name in (coupling.follower, coupling.leader))
    if not (isinstance(wheel, Revolute) and isinstance(pinion, Revolute) and wheel.parent == pinion.parent):
        raise ClearanceError(f"{what}: both wheels must be on pins of one body.").about(coupling.name)
    if not (wheel.is_plane and pinion.is_plane) or wheel.orientation or pinion.orientation:
        text = f"{what}, which are known in the plane only, on pins with an `angle` and no `orientation`."
        raise ClearanceError(text).about(coupling.name)
    assert coupling.base_radius is not None
    assert coupling.backlash is not None
    first, second = (joint.at_parent.vector[:2] for joint in (pinion, wheel))
    apart = [jnp.asarray(b - a, float) for a, b in zip(first, second, strict=True)]
    distance = jnp.hypot(*apart)
    x, y = (d / distance for d in apart)
    radius, gap = coupling.base_radius, coupling.base_radius * coupling.backlash
    # Both base circles touch the line of action: its angle follows from the distance of the centres.
    across = radius * (1.0 - coupling.ratio) / distance
    if not isinstance(across, Tracer) and float(across) >= 1:
        text = f"{what}, but its base circles overlap: the centres are {float(distance):.6g} m apart. Check the radii."
        raise ClearanceError(text).about(f"{coupling.name}.base_radius")
    along = jnp.sqrt(1.0 - across**2)
    reach = distance * coupling.ratio / (coupling.ratio - 1.0)
    at = first[0] + reach * x, first[1] + reach * y
    for side, name in zip((1.0, -1.0), flanks_of(coupling), strict=True):
        # The normal turns the pinion's way, and pushes the wheels apart.
        normal = along * x - side * across * y, along * y + side * across * x
        terms: dict[str, Scalar | None] = {wheel.name: side * radius, pinion.name: -side * coupling.ratio * radius}
        for joint, sign in ((pinion, 1.0), (wheel, -1.0)):
            turned = 0.0 if joint.angle is None else joint.angle
            cos, sin = jnp.cos(turned), jnp.sin(turned)
            inside = cos * normal[0] + sin * normal[1], cos * normal[1] - sin * normal[0]
            for play in joint.play_coordinates():
                terms[play.name] = sign * (inside[0] if play.name.endswith("x") else inside[1])
        kind = Gap if coupling.friction is None else ToothGap
        flank = kind(gap, coupling.flank, "upper", coupling.friction)  # pyright: ignore[reportArgumentType]
        made = _gap(name, terms, side * radius * coupling.offset + 0.5 * gap, flank, by_name, "teeth")
        teeth = Teeth(pinion.parent, pinion.child, wheel.child, at, normal, coupling.sliding)
        yield dataclasses.replace(made, turns=False, teeth=teeth)


def _sum(known: Scalar | float | None, factor: Scalar | None) -> Any:
    """The sum of two factors, of which `None` stands for 1; not of nothing."""
    if isinstance(known, float):
        return factor
    return (1.0 if known is None else known) + (1.0 if factor is None else factor)


def _of_coordinate(c: Coordinate, by_name: dict[str, Coordinate]) -> Iterator[CoordinateGap]:
    motor: dict[str, None] = {motor_of(c.name): None} if gives_way(c.motion) else {}
    frictions = 0
    for actuator in c.motion.actuators if c.motion.is_free else ():
        if isinstance(actuator, DriveSpring) and has_gap(actuator):
            flank = actuator.flank if actuator.backlash is not None else FlankSpring(**vars(actuator.flank))
            width = 0.0 if actuator.backlash is None else actuator.backlash
            what: What = "elasticity" if actuator.backlash is None else "backlash"
            clearance = Gap(width, flank, "spring" if actuator.backlash is None else "both")
            made = _gap(DRIVE.format(c.name), {c.name: None}, actuator.rest, clearance, by_name, what)
            driven = actuator.wave is not None and not by_name[motor_of(c.name)].motion.is_free
            more: Any = {"wave": actuator.wave, "loss": actuator.loss, "motor": motor_of(c.name)}
            yield dataclasses.replace(made, in_tree=made.in_tree and not driven, **more)
        elif isinstance(actuator, JointFriction) and rubs(actuator, c.motion):
            name = FRICTION.format(c.name) + f"_{frictions}" * bool(frictions)
            yield _gap(name, {c.name: None} | motor, None, actuator.rub(), by_name, "friction")
            frictions += 1
    stops = c.motion.stops
    if stops is not None and c.motion.is_free:
        yield _gap(STOP.format(c.name), {c.name: None} | motor, stops.offset, stops.gap(), by_name, "stops")


def _gap(
    name: str, terms: Mapping[str, Scalar | None], offset: Scalar | None, clearance: Gap | Rub,
    by_name: dict[str, Coordinate], what: What = "backlash",
) -> CoordinateGap:  # fmt: skip
    in_tree = all(by_name[each].motion.is_free for each in terms)
    turns = by_name[next(iter(terms))].slides is None
    return CoordinateGap(name, tuple(terms), tuple(terms.values()), offset, clearance, in_tree, turns, what)
