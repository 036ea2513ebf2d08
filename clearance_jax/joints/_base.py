"""The base of clearance joints: a geometry that gives the contact points, and contact laws mapped over these points.

Everything is measured in the axes of the sleeve, from the sleeve's centre. So a penetration of 1e-11 m keeps its digits
on a robot of some metres, and a worn wall keeps its place where the joint closes a loop.

A joint defines its play coordinates in the tree, its contact points for a relative pose and twist, and its geometry for
the laws. The rest (forces, memory, event functions) is the same for every joint and is done here, by the joint with its
laws' constants: `PreparedClearance`.
"""

import abc
import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.module import Module
from clearance_jax._basis.numerics import safe_unit
from clearance_jax._basis.roots import newton_in_logarithms
from clearance_jax._basis.types import Flag, Scalar
from clearance_jax._compile.barriers import with_barriers
from clearance_jax.joints.contact import Action, ContactPoint, JointOutline, PlayCoordinate, PointAction, Relative
from clearance_jax.joints.elements import AbstractElement, Offset
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, Geometry, Touch
from clearance_jax.laws._base import Memory, PreparedNormal, Slip
from clearance_jax.laws._friction import PreparedFriction
from clearance_jax.parameters import Parametrised
from clearance_jax.spatial import ZERO, Pair, Vector, add, cross, dot, plus, scale, times


class AbstractClearance(Parametrised):
    """The play of a joint: where its parts can touch, and the laws that act there.

    A joint kind of your own has `play`, `geometry`, `points` and `travel`.
    """

    normal: eqx.AbstractVar[AbstractNormalLaw]
    friction: eqx.AbstractVar[AbstractFrictionLaw | None]
    element: eqx.AbstractVar[AbstractElement | None]
    tangents: eqx.AbstractClassVar[int]
    """Number of directions in which it can slip."""
    kind: ClassVar[str] = ""
    """What scenes and datasets call it; empty: a kind of your own."""
    flat: ClassVar[bool] = False
    """Whether its walls are flat: each limits one slide. A round wall limits the distance from the middle."""

    @property
    def count(self) -> int:
        """Number of contact points."""
        return 1

    @property
    def slip_components(self) -> int:
        """Number of components of the slip and of the bristles: one along each tangent."""
        return self.tangents

    @classmethod
    def sizes(cls) -> dict[str, bool]:
        """The lengths that a designer gives, by name: whether each is play (an error budget shrinks play). By default
        every length but wear; names that end in `clearance` are play.
        """
        lengths = [f.name for f in dataclasses.fields(cls) if f.metadata.get("unit") == "m" and f.name != "depth"]
        return {name: name.endswith("clearance") for name in lengths}

    @abc.abstractmethod
    def play(self) -> tuple[PlayCoordinate, ...]:
        """The coordinates that it adds to the tree, in the order in which they act."""

    @abc.abstractmethod
    def geometry(self) -> Geometry:
        """The geometry as its laws see it."""

    @abc.abstractmethod
    def points(self, at: Relative) -> ContactPoint:
        """Its contact point; of several points each number is an array."""

    def pattern(self, points: ContactPoint) -> Scalar:
        """A code for where it bears: 0 nowhere, 1 somewhere; a joint may distinguish more."""
        return jnp.where(jnp.any(points.penetration > 0), 1.0, 0.0)

    @abc.abstractmethod
    def travel(self, along: Vector) -> Scalar:
        """How far the pin's centre may go along a direction across the axis before it touches [m]."""

    def outline(self) -> JointOutline | None:
        """What pictures show of it: by default a pin in a round sleeve, as its laws see it. `None`: nothing."""
        return JointOutline(self.geometry().pin_radius, self.geometry().radial_clearance)

    @property
    def has_ends(self) -> bool:
        """Whether its walls end somewhere, beyond which its formulas do not hold (see `overhang`); by default not."""
        return False

    def overhang(self, at: Relative) -> Scalar:
        """How far a part of the pin is beyond the end of its walls [m] (negative: within them)."""
        raise NotImplementedError(f"{type(self).__name__} has walls without ends.")

    def press(self, along: Vector, depth: Scalar) -> Vector:
        """The place of the pin's centre if a force along a direction (normal to the axis) presses it so deep [m]."""
        return scale(self.travel(along) + depth, along)

    def offset(self, at: Relative) -> Offset:
        """The part of a relative motion that is play, for an element that fills it."""
        return Offset.of(self.play(), at)

    @property
    def laws(self) -> tuple[AbstractNormalLaw | AbstractFrictionLaw, ...]:
        """Its contact laws."""
        return (self.normal,) if self.friction is None else (self.normal, self.friction)

    def prepare(self) -> "PreparedClearance":
        """The joint with its laws' constants (once a solve)."""
        geometry = self.geometry()
        friction = None if self.friction is None else self.friction.prepare(geometry)
        return PreparedClearance(self.ready(), self.normal.prepare(geometry), friction)

    def ready(self) -> "AbstractClearance":
        """The joint with everything computed that depends on its numbers alone (once a solve); by default nothing."""
        return self

    @property
    def remembers(self) -> tuple[str, ...]:
        """Names of its memory, point by point: that of the laws, and whether the point touched, if a law remembers."""
        names = self.normal.remembers
        if self.friction is not None:
            ends = ("",) if self.slip_components == 1 else tuple(f"_{k + 1}" for k in range(self.slip_components))
            names += tuple(name + end for name in self.friction.bristles for end in ends)
        names = (*names, "touching") if names else ()
        return names if self.count == 1 else tuple(f"{name}_{i + 1}" for i in range(self.count) for name in names)


# A force that presses a pin less deep than this part of its play is round-off, and its direction is unknown.
TOUCHING = 1e-9


class PreparedClearance(Module):
    """A `joint` with clearance and the constants of its `normal` and `friction` laws: what a step evaluates."""

    joint: AbstractClearance
    normal: PreparedNormal
    friction: PreparedFriction | None

    @property
    def laws(self) -> tuple[AbstractNormalLaw | AbstractFrictionLaw, ...]:
        """Its contact laws, as the user gave them."""
        return self.joint.laws

    @property
    def remembers(self) -> tuple[str, ...]:
        """Names of its memory variables."""
        return self.joint.remembers

    def play(self) -> tuple[PlayCoordinate, ...]:
        """The coordinates that it adds to the tree."""
        return self.joint.play()

    @property
    def blank(self) -> Memory:
        """The memory of a contact that nothing has happened to."""
        return tuple(jnp.zeros(()) for _ in self.remembers)

    def without_friction(self) -> "PreparedClearance":
        """The same joint without its friction law."""
        return PreparedClearance(self.joint, self.normal, None)

    def act(self, at: Relative, memory: Memory) -> Action:
        """Forces on the pin for a relative motion and the joint's memory."""
        points = self.points(at)
        action = self._map(self._act_at)(points, self._by_point(memory))
        if self.joint.count > 1:
            # Six sums use it; each would compute it anew.
            action = action._replace(normal_force=with_barriers(action.normal_force))
        push = scale(-action.normal_force, points.normal)
        for traction, tangent in zip(action.traction, points.tangents, strict=True):
            push = add(push, scale(traction, tangent))
        force, torque = self._sum(push), self._sum(cross(points.arm, push))
        rubbed = -sum(t * s for t, s in zip(action.traction, action.slip, strict=True))
        if points.lever is not None:
            torque = add(torque, self._sum((0.0, 0.0, points.lever * action.traction[0])))
            rubbed -= points.sweep * action.traction[0]
        absorbed = action.normal_force * action.penetration_rate
        absorbed, rubbed, stored = self._sum((absorbed, rubbed, action.elastic_energy))
        if self.joint.element is not None:
            push, twist = self.joint.element.wrench(self.joint.offset(at), self.joint.geometry())
            force, torque = add(force, push), add(torque, twist)
            absorbed -= plus(dot(push, at.velocity), dot(twist, at.spin))
            stored += self._filling_energy(at)
        return Action(force, torque, action, self._by_variable(action.memory_rate), stored, absorbed, rubbed)

    def points(self, at: Relative) -> ContactPoint:
        """The contact points, with the lever of the friction around the pin, if the normal law has one."""
        points, normal = self.joint.points(at), self.normal
        if self.friction is None:
            return points
        lever = self._map(lambda depth: normal.law.friction_lever(normal.constants, depth))(points.penetration)
        return points if lever is None else points.rubbing_around(lever, at.spin[2])

    def _act_at(self, point: ContactPoint, memory: Memory) -> PointAction:
        normal, (normal_memory, rest, touched) = self.normal.at(point.local), self._parts(memory)
        depth, rate, slip = point.penetration, point.penetration_rate, point.rubbing
        force = times(point.part, normal.force(depth, rate, normal_memory))
        rates = while_touching(normal.law, touched, normal.memory_rate(depth, rate, normal_memory))
        traction: Slip = tuple(jnp.zeros_like(s) for s in slip)
        if self.friction is not None:
            friction = self.friction.at(point.local)
            traction = friction.traction(slip, force, rest)
            changes = while_touching(friction.law, touched, friction.memory_rate(slip, force, rest))
            rates = (*rates, *point.carry(changes, rest))
        rates = (*rates, jnp.zeros_like(force)) if memory else ()
        return PointAction(depth, rate, point.slip, force, traction, rates, times(point.part, normal.energy(depth)))

    def event_functions(self, now: ContactPoint, memory: Memory, before: ContactPoint) -> tuple[Array, ...]:
        """Functions of the points `now` (and `before`, at the step's start) whose signs define the laws' regimes."""
        return self._map(self._event_functions_at)(now, self._by_point(memory), before)

    def _event_functions_at(self, point: ContactPoint, memory: Memory, before: ContactPoint) -> tuple[Scalar, ...]:
        normal, (normal_memory, rest, _) = self.normal.at(point.local), self._parts(memory)
        depth, rate = point.penetration, point.penetration_rate
        out, presses = normal.event_functions(depth, rate, normal_memory)
        if self.friction is not None:
            force = times(point.part, normal.force(depth, rate, normal_memory))
            friction = self.friction.at(point.local)
            out = (*out, *friction.event_functions(point.rubbing, force, rest, presses, before.rubbing))
        return out

    def remembered_touch(self, memory: Memory) -> Array:
        """Above 0.5 where a point touched when the laws were told last."""
        return self._by_point(memory)[-1]

    def latch(self, memory: Memory, now: Relative, rate: Relative) -> Memory:
        """The memory at the start of a step, rewritten by the laws where contact has just begun or ended: from the
        relative motion `now` and its time derivative (`rate`).
        """
        numbers, constants = eqx.partition(now, eqx.is_array)

        def moving(numbers):
            p = self.joint.points(eqx.combine(numbers, constants))
            return p.penetration, p.penetration_rate, p.slip

        here, rates = jax.jvp(moving, (numbers,), (eqx.filter(rate, jax.tree.map(eqx.is_array, now)),))
        return self._by_variable(self._map(self._latch_at)(here, rates, self._by_point(memory)))

    def _latch_at(self, point, rates, memory: Memory) -> Memory:
        (depth, speed, slip), (_, change, _) = point, rates
        normal_memory, rest, touched = self._parts(memory)
        touching, touched = depth > 0, touched[0] > 0.5
        # Time since the touch at constant speed; 0 if the speed has changed since (a start deep in contact).
        recent = jnp.abs(change * depth) < 0.01 * speed**2
        elapsed = jnp.where(recent, depth / jnp.where(recent, speed, 1.0), 0.0)
        then = jnp.where(recent, speed - change * elapsed, speed)
        touch = Touch(touching & ~touched, touched & ~touching, then, slip, elapsed)
        normal_memory = self.normal.latch(normal_memory, touch)
        if self.friction is not None:
            rest = self.friction.latch(rest, touch)
        return (*normal_memory, *rest, jnp.where(touching, 1.0, 0.0))

    def seat(self, force: Pair) -> tuple[Pair, Flag]:
        """Where the pin rests under a force of the sleeve across its axis [N], in its axes: so deep that the joint,
        without friction, gives this force; and whether the force presses it at all.
        """
        size, x, y = safe_unit(*(jnp.asarray(component, float) for component in force))
        wall: Vector = (-x, -y, 0.0)
        free, smooth = self.joint.travel(wall), self.without_friction()

        def borne(depth):
            at = Relative(self.joint.press(wall, depth), 0.0, ZERO, ZERO)
            return -jnp.asarray(dot(smooth.act(at, smooth.blank).force, wall), float)

        loaded = size > 0
        depth = newton_in_logarithms(borne, jnp.where(loaded, size, 1.0), free)
        return self.joint.press(wall, depth)[:2], loaded & (depth > TOUCHING * free)

    def depths(self, at: Relative) -> tuple[Array, Array]:
        """Penetration [m] and its rate [m/s] at every point, shape (points,) each."""
        points = self.joint.points(at)
        return jnp.atleast_1d(points.penetration), jnp.atleast_1d(points.penetration_rate)

    def elastic_energy(self, at: Relative) -> Scalar:
        """Elastic energy [J]."""
        energy = self._map(lambda point: times(point.part, self.normal.at(point.local).energy(point.penetration)))
        return jnp.sum(energy(self.joint.points(at))) + self._filling_energy(at)

    def _filling_energy(self, at: Relative) -> Scalar | float:
        """Elastic energy of the element that fills the play [J]."""
        element = self.joint.element
        return 0.0 if element is None else element.energy(self.joint.offset(at), self.joint.geometry())

    def memory_scale(self) -> Memory:
        """Magnitude of each memory variable for error control; infinite for one that only changes by latching."""
        if not self.remembers:
            return ()
        friction = () if self.friction is None else self.friction.memory_scale(self.joint.slip_components)
        return (*self.normal.memory_scale(), *friction, jnp.asarray(jnp.inf)) * self.joint.count

    def memory_growth(self) -> tuple[float, ...]:
        """By memory variable: 1 if its tolerance also grows with its size (a normal law's: it can be large), else 0."""
        growing, every = len(self.normal.law.remembers), len(self.memory_scale()) // self.joint.count
        return ((1.0,) * growing + (0.0,) * (every - growing)) * self.joint.count

    def _map(self, function: Callable) -> Callable:
        if self.joint.count == 1:
            return function
        return lambda points, *rest: jax.vmap(function)(getattr(points, "law_view", points), *rest)

    def _sum(self, terms: Any) -> Any:
        """By term: the sum over the points; absent terms stay absent."""
        if self.joint.count == 1:
            return terms
        return tuple(jnp.sum(term) if eqx.is_array(term) else term for term in terms)

    def _by_point(self, memory: Memory) -> tuple[Array, ...]:
        """The memory by variable; for several points as arrays."""
        if self.joint.count == 1:
            return tuple(memory)
        width = len(memory) // self.joint.count
        return tuple(jnp.stack(memory[i::width]) for i in range(width))

    def _by_variable(self, memory: tuple[Array, ...]) -> Memory:
        """The memory as in a state: point by point."""
        if self.joint.count == 1:
            return tuple(memory)
        return tuple(variable[i] for i in range(self.joint.count) for variable in memory)

    def _parts(self, memory: Memory) -> tuple[Memory, Memory, Memory]:
        """The memory of the normal law, of the friction law, and whether the point touched."""
        n = len(self.normal.law.remembers)
        return memory[:n], memory[n:-1], memory[-1:]


def while_touching(law: AbstractNormalLaw | AbstractFrictionLaw, touched: Memory, rates: Memory) -> Memory:
    """The rates of a law's memory; zero while apart, except for a law that acts there.

    Whether they are apart was latched at the start of the step. If the sign of the penetration decided, the rate would
    jump within a trial step across a touch. Steps would be rejected until they end at the touch, and event location
    could not cut one there.
    """
    return rates if law.acts_apart else tuple(jnp.where(touched[0] > 0.5, rate, 0.0) for rate in rates)
