"""The mechanism as a solve uses it."""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax.mechanism._base import AbstractMechanism, sampling_periods
from clearance_jax.mechanism.body import Body, Point, Spring, Wrench
from clearance_jax.mechanism.controllers import AbstractController
from clearance_jax.mechanism.couplings import Coupling
from clearance_jax.mechanism.followers import mark_followers, with_followed_drives
from clearance_jax.mechanism.gaps import CoordinateGap
from clearance_jax.mechanism.placement import Gravity, Inertia
from clearance_jax.mechanism.state import layout
from clearance_jax.mechanism.tree.links import ONCE, Links, links_of
from clearance_jax.mechanism.tree.tree import AbstractJoint
from clearance_jax.mechanism.variants import without_sampling


class PreparedMechanism(AbstractMechanism):
    """A mechanism with everything computed that depends only on its numbers (once a solve, not once a step): its
    drives, actuators, loads, controllers and clearances have the types that a step evaluates.

    `Mechanism.prepare` makes it, with parts of the same names. All dynamics use it.

    - `chosen`: in a solve, the conditions of its closures that a step asks for (`conditions.choice`).
    - `links`: the table of a large mechanism.
    """

    bodies: tuple[Body, ...]
    joints: tuple[AbstractJoint, ...]
    loops: tuple[AbstractJoint, ...]
    springs: tuple[Spring, ...]
    points: tuple[Point, ...]
    gravity: Gravity
    assemble: bool = eqx.field(static=True)
    wrenches: tuple[Wrench, ...]
    controllers: tuple[AbstractController, ...]
    couplings: tuple[Coupling, ...] = ()
    gaps: tuple[CoordinateGap, ...] = ()  # pyright: ignore[reportIncompatibleMethodOverride]
    chosen: Array | None = None
    friction_in_motions: ClassVar[bool] = False
    links: Links | None = None

    @property
    def is_tabled(self) -> bool:
        """Whether its dynamics is loops over a table of its links."""
        return self.links is not None or self.form.is_table

    def _with_joints(self, change):
        return dataclasses.replace(super()._with_joints(change), chosen=None, links=None)

    def _without_gaps(self):
        firm = dataclasses.replace(super()._without_gaps(), gaps=tuple(gap for gap in self.gaps if gap.lasts))
        marked = dataclasses.replace(firm, joints=mark_followers(firm, firm.couplings))
        return dataclasses.replace(marked, joints=with_followed_drives(marked))

    def at(self, time: Scalar) -> "PreparedMechanism":
        """The mechanism with the payloads that it has at a time."""
        if not self.has_payloads:
            return self
        links = self.links
        if links is not None:
            there = jnp.stack([body.presence(time) for body in self.bodies])
            links = dataclasses.replace(links, mass=there * links.mass, inertia=there[:, None, None] * links.inertia)
        return dataclasses.replace(self, bodies=tuple(body.at(time) for body in self.bodies), links=links)

    def without_sampling(self) -> "PreparedMechanism":
        """The same mechanism as it acts where a solve starts: everything digital continuously, integrals still 0."""
        if not (sampling_periods(self) or layout(self).integrals):
            return self
        controllers = tuple(dataclasses.replace(controller, period=None) for controller in self.controllers)
        return dataclasses.replace(super()._with_joints(without_sampling), controllers=controllers)

    def as_table(self) -> "PreparedMechanism":
        """The same mechanism as a table, however small; a plane mechanism stays as it is."""
        if self.is_plane:
            return self
        return dataclasses.replace(self, links=self.links or links_of(self.bodies, self.joints))

    def as_small_program(self) -> "PreparedMechanism":
        """The same mechanism for a single evaluation: if large and in space, as a table, which compiles sooner."""
        # A body that stays in its plane may have one moment of inertia, but a table needs six.
        whole = all(body.inertia is None or isinstance(body.inertia, Inertia) for body in self.bodies)
        return self.as_table() if whole and len(list(self.coordinates())) > ONCE else self
