"""What a clearance joint is: a geometry that says where surfaces meet, and contact laws mapped over these points.

Everything is measured in the axes of the sleeve, from the sleeve's centre, so that a penetration of 1e-11 m keeps its
digits on a robot that is metres long; also where the joint closes a loop, so that a worn wall is where it is.

A joint says three things of its own: its play coordinates in the tree, its contact points for a relative pose and
twist, and its geometry as the laws may know it. All else (forces, memory, switches) is the same for every joint and is
done here, by the joint with its laws' constants: `PreparedClearance`.
"""

import abc
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._numerics import safe_unit
from clearance_jax._types import Flag, Scalar
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, Geometry, Touch
from clearance_jax.laws._base import Memory, PreparedFriction, PreparedNormal, Slip
from clearance_jax.laws.geometry import Local
from clearance_jax.parameters import Parametrised
from clearance_jax.spatial import Pair, Term, add, dot, plane_cross, scale


class Relative(NamedTuple):
    """Pose and twist of the pin relative to the sleeve, in the sleeve's axes: place of the pin's centre from the
    sleeve's, angle between them, and their rates as an observer on the sleeve sees them.
    """

    place: Pair
    angle: Term
    velocity: Pair
    spin: Term


class PlayCoordinate(NamedTuple):
    """One coordinate that play adds to a joint of the tree: what its name ends in, the axis it slides along (`None`: it
    turns), and its magnitude (a clearance [m], or an angle [rad]) for error control.
    """

    suffix: str
    slides: Pair | None
    scale: Scalar


class ContactPoint(NamedTuple):
    """Where two surfaces meet, or are nearest, in the sleeve's axes.

    `penetration` [m] (negative: apart) and its rate, `slip` of the pin's surface on the sleeve's [m/s] along
    `tangents`, `normal` from the pin's surface into the sleeve's, `arm` from the pin's centre to the point [m];
    `local`: what distinguishes this point for the laws.
    """

    penetration: Scalar
    penetration_rate: Scalar
    slip: Slip
    normal: Pair
    tangents: tuple[Pair, ...]
    arm: Pair
    local: Local = None


class PointAction(NamedTuple):
    """What one contact point does: forces on the pin [N], rate of its memory, elastic energy [J]."""

    penetration: Scalar
    penetration_rate: Scalar
    slip: Slip
    normal_force: Scalar
    traction: Slip
    memory_rate: Memory
    elastic_energy: Scalar


class Action(NamedTuple):
    """What a joint does to the pin at one instant, in the sleeve's axes: force [N] at the pin's centre, torque about it
    [N m]; its points; the rate of its memory; elastic energy [J] and the power that it absorbs beside friction [W].
    """

    force: Pair
    torque: Term
    points: tuple[PointAction, ...]
    memory_rate: Memory
    elastic_energy: Scalar
    absorbed_power: Scalar
    friction_power: Scalar

    @property
    def normal_force(self) -> Scalar:
        """The sum of its points' normal forces [N]."""
        return sum((point.normal_force for point in self.points[1:]), self.points[0].normal_force)

    @property
    def deepest(self) -> PointAction:
        """What happens at the point of largest penetration."""
        if len(self.points) == 1:
            return self.points[0]
        every = jax.tree.map(lambda *values: jnp.stack(values), *self.points)
        return jax.tree.map(lambda values: values[jnp.argmax(every.penetration)], every)


class AbstractElement(Parametrised):
    """What fills a joint's play and acts without touch: a film, a soft liner."""

    @abc.abstractmethod
    def wrench(self, at: Relative, geometry: Geometry) -> tuple[Pair, Term]:
        """Force on the pin [N] and torque about its centre [N m], in the sleeve's axes. Its work counts as absorbed."""


class AbstractClearance(Parametrised):
    """A joint with play."""

    normal: eqx.AbstractVar[AbstractNormalLaw]
    friction: eqx.AbstractVar[AbstractFrictionLaw | None]
    element: eqx.AbstractVar[AbstractElement | None]
    count: eqx.AbstractClassVar[int]
    """Number of contact points."""
    tangents: eqx.AbstractClassVar[int]
    """Number of components of the slip."""

    @abc.abstractmethod
    def play(self) -> tuple[PlayCoordinate, ...]:
        """The coordinates that it adds to the tree, in the order in which they act."""

    @abc.abstractmethod
    def geometry(self) -> Geometry:
        """What its laws may know of it."""

    @abc.abstractmethod
    def points(self, at: Relative) -> tuple[ContactPoint, ...]:
        """Its contact points."""

    @abc.abstractmethod
    def travel(self, along: Pair) -> Scalar:
        """How far the pin's centre may go from the sleeve's along a direction before it touches [m]."""

    def prepared(self) -> "PreparedClearance":
        """The joint with its laws' constants (once a solve)."""
        geometry = self.geometry()
        friction = None if self.friction is None else self.friction.prepared(geometry)
        return PreparedClearance(self, self.normal.prepared(geometry), friction)

    @property
    def remembers(self) -> tuple[str, ...]:
        """Names of its memory variables, point by point: the laws', and whether the point touched (a law with memory
        needs to know).
        """
        own = self.normal.remembers
        if self.friction is not None:
            ends = ("",) if self.tangents == 1 else tuple(f"_{k + 1}" for k in range(self.tangents))
            own += tuple(name + end for name in self.friction.bristles for end in ends)
        own = (*own, "touching") if own else ()
        return own if self.count == 1 else tuple(f"{name}_{i + 1}" for i in range(self.count) for name in own)


def each(function: Callable, *sequences):
    """`function` of the first members, of the second ones, ...: called where there is one, mapped where there are more,
    so that the laws stand once in the program.
    """
    if len(sequences[0]) == 1:
        return (function(*(members[0] for members in sequences)),)
    stacked = [
        jax.tree.map(lambda *x: jnp.stack([jnp.asarray(v, float) for v in x]), *members) for members in sequences
    ]
    out = jax.vmap(function)(*stacked)
    return tuple(jax.tree.map(lambda x, i=i: x[i], out) for i in range(len(sequences[0])))


# A force that would press a pin less deep than this part of its play is round-off: it does not say where.
TOUCHING = 1e-9
# Newton iterations for a depth; the longest of them, in powers of e.
SEARCH, STRIDE = 16, 5.0


def depth_of(borne: Callable[[Scalar], Scalar], force: Scalar, start: Scalar) -> Scalar:
    """The penetration at which a joint bears a force > 0, by Newton in logarithms, in which every power law is a
    straight line.

    Differentiable twice, though the slope is hidden from differentiation: at the solution each iteration makes the
    derivatives of the next order right.
    """

    def newton(_, logarithm):
        depth = jnp.exp(logarithm)
        now, stiffness = borne(depth), jax.lax.stop_gradient(jax.grad(borne)(jax.lax.stop_gradient(depth)))
        presses = (now > 0) & (stiffness > 0)
        now, stiffness = jnp.where(presses, now, force), jnp.where(presses, stiffness, 1.0)
        step = jnp.log(now / force) * jax.lax.stop_gradient(now / (stiffness * depth))
        return logarithm - jnp.where(presses, jnp.clip(step, -STRIDE, STRIDE), -1.0)

    return jnp.exp(jax.lax.fori_loop(0, SEARCH, newton, jnp.log(start)))


class PreparedClearance(eqx.Module):
    """A clearance joint with its laws' constants: what a step evaluates."""

    joint: AbstractClearance
    normal: PreparedNormal
    friction: PreparedFriction | None

    @property
    def remembers(self) -> tuple[str, ...]:
        """Names of its memory variables."""
        return self.joint.remembers

    def act(self, at: Relative, memory: Memory) -> Action:
        """Forces on the pin for a relative motion and the joint's memory."""
        points = self.joint.points(at)
        actions = each(self._act_at, points, self._by_point(memory))
        force: Pair = (0.0, 0.0)
        torque: Term = 0.0
        absorbed, rubbed, stored = jnp.zeros(()), jnp.zeros(()), jnp.zeros(())
        for point, action in zip(points, actions, strict=True):
            push = scale(-action.normal_force, point.normal)
            for traction, tangent in zip(action.traction, point.tangents, strict=True):
                push = add(push, scale(traction, tangent))
            force, torque = add(force, push), torque + plane_cross(point.arm, push)
            absorbed += action.normal_force * action.penetration_rate
            rubbed -= sum(t * s for t, s in zip(action.traction, action.slip, strict=True))
            stored += action.elastic_energy
        if self.joint.element is not None:
            push, twist = self.joint.element.wrench(at, self.joint.geometry())
            force, torque = add(force, push), torque + twist
            absorbed -= dot(push, at.velocity) + twist * at.spin
        rates = tuple(rate for action in actions for rate in action.memory_rate)
        return Action(force, torque, actions, rates, stored, absorbed, rubbed)

    def _act_at(self, point: ContactPoint, memory: Memory) -> PointAction:
        normal, (own, rest, _) = self.normal.at(point.local), self._parts(memory)
        depth, rate, slip = point.penetration, point.penetration_rate, point.slip
        force = normal.force(depth, rate, own)
        rates = normal.memory_rate(depth, rate, own)
        traction: Slip = tuple(jnp.zeros_like(s) for s in slip)
        if self.friction is not None:
            friction = self.friction.at(point.local)
            traction = friction.traction(slip, force, rest)
            rates = (*rates, *friction.memory_rate(depth, slip, force, rest))
        rates = (*rates, jnp.zeros_like(force)) if memory else ()
        return PointAction(depth, rate, slip, force, traction, rates, normal.energy(depth))

    def switches(
        self, now: tuple[ContactPoint, ...], memory: Memory, before: tuple[ContactPoint, ...]
    ) -> tuple[Scalar, ...]:
        """Functions of the contact points whose signs make the regime of every law. `before`: the points at the start
        of the step.
        """
        every = each(self._switches_at, now, self._by_point(memory), before)
        return tuple(function for one in every for function in one)

    def _switches_at(self, point: ContactPoint, memory: Memory, before: ContactPoint) -> tuple[Scalar, ...]:
        normal, (own, rest, _) = self.normal.at(point.local), self._parts(memory)
        depth, rate = point.penetration, point.penetration_rate
        out, presses = normal.switches(depth, rate, own)
        if self.friction is not None:
            friction, force = self.friction.at(point.local), normal.force(depth, rate, own)
            out = (*out, *friction.switches(point.slip, force, rest, presses, before.slip))
        return out

    def latch(self, memory: Memory, now: Relative, rate: Relative) -> Memory:
        """The memory at the start of a step: rewritten by the laws where contact has just begun or ended.

        **Arguments:** the relative motion `now`, and its time derivative (`rate`).
        """

        def moving(at: Relative):
            return tuple((p.penetration, p.penetration_rate, p.slip) for p in self.joint.points(at))

        here, rates = jax.jvp(moving, (now,), (rate,))
        return tuple(
            m
            for point, r, own in zip(here, rates, self._by_point(memory), strict=True)
            for m in self._latch_at(point, r, own)
        )

    def _latch_at(self, point, rates, memory: Memory) -> Memory:
        (depth, speed, slip), (_, change, _) = point, rates
        own, rest, touched = self._parts(memory)
        touching, touched = depth > 0, touched[0] > 0.5
        # A solve may start deep in contact; only a touch at which little has changed since can be traced back.
        recent = jnp.abs(change * depth) < 0.01 * speed**2
        elapsed = jnp.where(recent, depth / jnp.where(recent, speed, 1.0), 0.0)
        then = jnp.where(recent, speed - change * elapsed, speed)
        touch = Touch(touching & ~touched, touched & ~touching, then, slip, elapsed)
        own = self.normal.latch(own, touch)
        if self.friction is not None:
            rest = self.friction.latch(rest, touch)
        return (*own, *rest, jnp.where(touching, 1.0, 0.0))

    def seat(self, force: Pair) -> tuple[Pair, Flag]:
        """Where in its sleeve the pin is at rest under a force that the sleeve exerts on it [N], in the sleeve's axes:
        pressed against the wall so deep that the joint, without friction, gives this force; and whether the force
        presses it at all.
        """
        size, x, y = safe_unit(*(jnp.asarray(component, float) for component in force))
        wall = -x, -y
        free, still = self.joint.travel(wall), tuple(jnp.zeros(()) for _ in self.remembers)
        smooth = PreparedClearance(self.joint, self.normal, None)

        def borne(depth):
            at = Relative(scale(free + depth, wall), 0.0, (0.0, 0.0), 0.0)
            return -jnp.asarray(dot(smooth.act(at, still).force, wall), float)

        loaded = size > 0
        depth = depth_of(borne, jnp.where(loaded, size, 1.0), free)
        return scale(free + depth, wall), loaded & (depth > TOUCHING * free)

    def depths(self, at: Relative) -> tuple[Array, Array]:
        """Penetration [m] and its rate [m/s] at every point, shape (points,) each."""
        points = self.joint.points(at)
        return jnp.stack([p.penetration for p in points]), jnp.stack([p.penetration_rate for p in points])

    def stored(self, at: Relative) -> Scalar:
        """Elastic energy [J]."""
        points = self.joint.points(at)
        return sum(each(lambda p: self.normal.at(p.local).energy(p.penetration), points), jnp.zeros(()))

    def memory_scale(self) -> Memory:
        """Magnitude of each memory variable for error control; infinite for one that only changes by latching."""
        if not self.remembers:
            return ()
        friction = () if self.friction is None else self.friction.memory_scale(self.joint.tangents)
        return (*self.normal.memory_scale(), *friction, jnp.asarray(jnp.inf)) * self.joint.count

    def _by_point(self, memory: Memory) -> tuple[Memory, ...]:
        width = len(memory) // self.joint.count
        return tuple(tuple(memory[i * width : (i + 1) * width]) for i in range(self.joint.count))

    def _parts(self, memory: Memory) -> tuple[Memory, Memory, Memory]:
        """Of the normal law, of the friction law, and whether the point touched."""
        n = len(self.normal.law.remembers)
        return memory[:n], memory[n:-1], memory[-1:]
