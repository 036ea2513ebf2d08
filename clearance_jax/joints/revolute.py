"""The plane revolute clearance joint: a pin in a sleeve, with one normal law and one friction law.

Everything is measured in a frame fixed to the sleeve, from the sleeve's centre, so that a penetration of 1e-11 m keeps
its digits on a robot that is metres long. The contact point lies on the sleeve's surface, P = R n with n = e/|e|; both
wrenches act there, so momentum and power balance exactly. (FACTS formulas that use the pin's own radius as its arm
differ from this by the penetration.)
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._numerics import positive_part, safe_sqrt, safe_unit
from clearance_jax._types import Scalar, physical
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw
from clearance_jax.laws._base import CONTACT, Touch
from clearance_jax.spatial import Vector, cross, dot


class Contact(NamedTuple):
    """What happens in one joint at one instant; forces act on the pin, vectors are along the axes of `eccentricity`."""

    force: Vector
    torque: Scalar
    """About the pin's centre, on the pin."""
    penetration: Scalar
    penetration_rate: Scalar
    slip_velocity: Scalar
    normal_force: Scalar
    traction: Scalar
    elastic_energy: Scalar
    memory_rate: Array


class Signals(NamedTuple):
    """What the solver watches: smooth functions of the state whose crossings mark every switch of the laws."""

    overlap: Array
    """(|e|^2 - c^2) / (2 c) [m]: has the sign of the penetration, equals it at first touch, and stays smooth where the
    pin crosses the sleeve's centre (the penetration itself has a kink there)."""
    overlap_rate: Array
    slip_velocity: Array


class RevoluteClearance(eqx.Module):
    """Radial play of a pin in a sleeve.

    **Arguments:**

    - `radial_clearance`: sleeve radius minus pin radius [m], > 0.
    - `pin_radius`: [m], > 0.
    - `normal`: the normal law.
    - `friction`: the friction law, or `None`: then no friction code is compiled.
    """

    radial_clearance: Scalar = physical("m", above=0.0)
    pin_radius: Scalar = physical("m", above=0.0)
    normal: AbstractNormalLaw  # pyright: ignore[reportGeneralTypeIssues]
    friction: AbstractFrictionLaw | None = None

    def prepared(self) -> "RevoluteClearance":
        """The joint with its laws' geometry-dependent numbers computed."""
        geometry = self.pin_radius, self.radial_clearance
        friction = None if self.friction is None else self.friction.prepared(*geometry)
        normal = self.normal.prepared(*geometry)
        return RevoluteClearance(self.radial_clearance, self.pin_radius, normal, friction)

    @property
    def sleeve_radius(self) -> Scalar:
        """Pin radius plus radial clearance [m]."""
        return self.pin_radius + self.radial_clearance

    @property
    def remembers(self) -> tuple[str, ...]:
        """Names of the laws' memory variables, and whether the pin was touching (a law with memory needs to know)."""
        names = self.normal.remembers + (() if self.friction is None else self.friction.remembers)
        return (*names, "touching") if names else ()

    def contact(self, eccentricity: Vector, eccentricity_rate: Vector, spin: Scalar, memory: Array) -> Contact:
        """Forces for an eccentricity (pin centre from sleeve centre), its rate and the pin's relative spin.

        The rate is the one seen by an observer on the sleeve; any pair of axes will do, fixed or turning.
        """
        distance, nx, ny = safe_unit(jnp.asarray(eccentricity[0]), jnp.asarray(eccentricity[1]))
        normal_memory, friction_memory = self._split(memory)
        penetration = distance - self.radial_clearance
        penetration_rate = jnp.asarray(dot((nx, ny), eccentricity_rate))
        normal_force = self.normal(penetration, penetration_rate, normal_memory)
        slip = jnp.asarray(cross((nx, ny), eccentricity_rate)) + spin * (self.sleeve_radius - distance)
        if self.friction is None:
            traction, friction_rate = jnp.zeros_like(slip), friction_memory
        else:
            traction = self.friction(slip, normal_force, friction_memory)
            friction_rate = self.friction.memory_rate(slip, normal_force, friction_memory)
            friction_rate = jnp.where(penetration > 0, friction_rate, jnp.zeros_like(friction_rate))
        return Contact(
            force=(-normal_force * nx - traction * ny, -normal_force * ny + traction * nx),
            torque=traction * (self.sleeve_radius - distance),
            penetration=penetration,
            penetration_rate=penetration_rate,
            slip_velocity=slip,
            normal_force=normal_force,
            traction=traction,
            elastic_energy=self.normal.energy(penetration),
            memory_rate=self._join(jnp.zeros_like(normal_memory), friction_rate, jnp.zeros(())),
        )

    def signals(self, eccentricity: Vector, eccentricity_rate: Vector, spin: Scalar) -> Signals:
        """The watched functions of the state (kinematics only, no force)."""
        ex, ey = jnp.asarray(eccentricity[0]), jnp.asarray(eccentricity[1])
        distance, nx, ny = safe_unit(ex, ey)
        clearance = self.radial_clearance
        # (|e| - c)(|e| + c) / 2c rather than |e|^2 - c^2: the difference of squares would lose half the digits.
        overlap = (distance - clearance) * (distance + clearance) / (2 * clearance)
        slip = jnp.asarray(cross((nx, ny), eccentricity_rate)) + spin * (self.sleeve_radius - distance)
        overlap_rate = jnp.asarray(dot((ex, ey), eccentricity_rate)) / clearance
        return Signals(overlap, overlap_rate, slip)

    def penetration_of(self, overlap: Array, overlap_rate: Array) -> tuple[Array, Array]:
        """Penetration and its rate from the overlap signal and its rate (arrays of any one shape)."""
        clearance = self.radial_clearance
        # |e| = sqrt(c^2 + 2 c overlap); overlap >= -c/2 always, an interpolant of it may undershoot a little.
        distance = safe_sqrt(positive_part(clearance * (clearance + 2 * overlap)))
        penetration = 2 * clearance * overlap / (distance + clearance)
        return penetration, overlap_rate * clearance / jnp.where(distance > 0, distance, clearance)

    def regime(self, overlap: Array, overlap_rate: Array, slip_velocity: Array, memory: Array) -> Array:
        """One integer per smooth piece of the joint's laws, for arrays of samples of the signals."""
        normal_memory, _ = self._split(memory)
        penetration, rate = self.penetration_of(overlap, overlap_rate)
        regime = self.normal.regime(penetration, rate, normal_memory)
        zone = None if self.friction is None else self.friction.regime(slip_velocity)
        return regime if zone is None else jnp.where(regime >= CONTACT, 3 * regime + zone, regime)

    def latch(self, memory: Array, now: Signals, rate: Signals) -> Array:
        """The memory at the start of a step: rewritten by the laws where contact has just begun or ended.

        **Arguments:** the signals `now`, and their time derivatives (`rate`).
        """
        normal_memory, friction_memory = self._split(memory)
        touching, touched = now.overlap > 0, memory[-1] > 0.5
        # A solve may start deep in contact; only a touch at which little has changed since can be traced back.
        recent = jnp.abs(rate.overlap_rate * now.overlap) < 0.01 * now.overlap_rate**2
        elapsed = jnp.where(recent, now.overlap / jnp.where(recent, now.overlap_rate, 1.0), 0.0)
        _, speed = self.penetration_of(now.overlap, now.overlap_rate)
        # Where the overlap is zero its rate is the penetration's.
        speed = jnp.where(recent, now.overlap_rate - rate.overlap_rate * elapsed, speed)
        touch = Touch(touching & ~touched, touched & ~touching, speed, now.slip_velocity, elapsed)
        normal_memory = self.normal.latch(normal_memory, touch)
        if self.friction is not None:
            friction_memory = self.friction.latch(friction_memory, touch)
        return self._join(normal_memory, friction_memory, jnp.where(touching, 1.0, 0.0))

    def memory_scale(self) -> Array:
        """Magnitude of each memory variable for error control; infinite for one that only changes by latching."""
        friction = jnp.zeros(0) if self.friction is None else self.friction.memory_scale()
        return self._join(self.normal.memory_scale(), friction, jnp.asarray(jnp.inf))

    def _split(self, memory: Array) -> tuple[Array, Array]:
        n = len(self.normal.remembers)
        m = 0 if self.friction is None else len(self.friction.remembers)
        return memory[:n], memory[n : n + m]

    def _join(self, normal: Array, friction: Array, touching: Array) -> Array:
        return jnp.concatenate([normal, friction, touching[None]]) if self.remembers else jnp.zeros(0)
