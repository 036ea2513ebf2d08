"""The spherical clearance joint: a ball in a socket that is a little larger."""

from typing import ClassVar

import jax.numpy as jnp

from clearance_jax._basis.numerics import safe_sqrt
from clearance_jax._basis.types import Scalar
from clearance_jax.joints._base import AbstractClearance, AbstractElement
from clearance_jax.joints.checks import GRIPS
from clearance_jax.joints.contact import ContactPoint, JointOutline, PlayCoordinate
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, Geometry, Material
from clearance_jax.parameters import Demand, physical
from clearance_jax.spatial import UNIT, Vector, X, Y, Z, across, cross, dot, scale, subtract


class SphericalClearance(AbstractClearance):
    """The play of a ball in its socket.

    As for a pin in a sleeve (see `pin`), the contact point lies on the surface of the socket (Flores et al. 2006).

    The bristles of a friction law are a vector in the socket's axes, square to the normal. As the contact moves over
    the socket the plane of contact carries them with it, without turning them about the normal (parallel transport),
    so that no direction of the socket is special and their length stays. A ball that turns about the normal alone does
    not slip, and nothing resists it.

    **Arguments:** `radial_clearance`: socket radius minus ball radius [m], > 0; `ball_radius` [m], > 0; `normal` and
    `friction` laws; `element`: what acts without touch; `ball_material`, `socket_material`: for laws that need them.
    """

    radial_clearance: Scalar = physical("m", "socket radius minus ball radius", '"0.1 mm"', above=0.0, instead=GRIPS)
    ball_radius: Scalar = physical("m", "radius of the ball", '"10 mm"', above=0.0)
    normal: AbstractNormalLaw  # pyright: ignore[reportGeneralTypeIssues]
    friction: AbstractFrictionLaw | None = None
    element: AbstractElement | None = None
    ball_material: Material | None = None
    socket_material: Material | None = None
    kind: ClassVar[str] = "ball"
    tangents: ClassVar[int] = 2

    @property
    def slip_components(self):
        # No two directions are continuous over a whole socket: bristles have all three axes.
        return 3 if self.friction is not None and self.friction.bristles else 2

    def demands(self):
        least = self.radial_clearance
        yield Demand("ball_radius", self.ball_radius > least, lambda: f"must be greater than the clearance {least:g} m")

    def play(self):
        """Three slides: the place of the ball's centre."""
        names = zip((".play_x", ".play_y", ".play_z"), (X, Y, Z), strict=True)
        return tuple(PlayCoordinate(name, self.radial_clearance, slides=axis) for name, axis in names)

    def geometry(self):
        socket = self.ball_radius + self.radial_clearance
        materials = self.ball_material, self.socket_material
        return Geometry(self.ball_radius, socket, self.radial_clearance, None, *materials)

    def points(self, at):
        x, y, z = (jnp.asarray(term, float) for term in at.place)
        distance = safe_sqrt(x * x + y * y + z * z)
        normal: Vector = scale(1.0 / jnp.where(distance > 0, distance, 1.0), (x, y, z))
        arm = scale(self.ball_radius + self.radial_clearance - distance, normal)
        velocity, turning = at.velocity_at(arm), None
        if self.slip_components == 3:
            tangents, turning = UNIT, scale(1.0 / jnp.where(distance > 0, distance, 1.0), cross(normal, at.velocity))
            slip = subtract(velocity, scale(dot(normal, velocity), normal))
        else:
            tangents = across(normal)
            slip = tuple(dot(tangent, velocity) for tangent in tangents)
        return ContactPoint(
            penetration=distance - self.radial_clearance,
            penetration_rate=jnp.asarray(dot(normal, at.velocity), float),
            slip=tuple(jnp.asarray(term, float) for term in slip),
            normal=normal,
            tangents=tangents,
            arm=arm,
            turning=turning,
        )

    def outline(self):
        return JointOutline(self.ball_radius, self.radial_clearance, ball=True)

    def travel(self, along):
        return self.radial_clearance
