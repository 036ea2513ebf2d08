"""The revolute clearance joint of space: a pin of some length in a sleeve, with radial play, tilt, and axial play.

Along the sleeve stand stations, at each of which the plane joint's contact is made for the pin's section there; the
sum, by weights, is a quadrature of the contact along its length. Axial play ends at two faces of the sleeve, on which a
collar of the pin bears at points of a ring.

A force is along the gradient of its penetration, and acts where that gradient's moment is, so that power balances
exactly, tilted too. What is left out is of second order in the tilt: a tilted pin's section is not quite round.
"""

from typing import ClassVar, Literal

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax._numerics import safe_unit
from clearance_jax._types import Scalar
from clearance_jax.errors import ClearanceError, quoted
from clearance_jax.joints._base import AbstractClearance, AbstractElement, ContactPoint, PlayCoordinate, Relative
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, Geometry, Material
from clearance_jax.parameters import described, physical
from clearance_jax.spatial import Vector, X, Y, Z, add, dot, minus, plus, scale, subtract, times

# Beyond so many stations the quadrature of a contact that begins somewhere between two of them gains little.
MOST = 64
PINS = ("through", "inside")


class SleeveClearance(AbstractClearance):
    """Radial play, tilt and axial play of a pin in a sleeve.

    **Arguments:**

    - `radial_clearance`: sleeve radius minus pin radius [m], > 0.
    - `pin_radius`, `length` of the sleeve [m], > 0.
    - `normal`: the normal law, of the whole sleeve: each station has its share of it, and so has each point of a face.
    - `friction`: the friction law, or `None`.
    - `axial_clearance`: how far the pin may slide to either side [m], > 0; `None`: it is held axially.
    - `element`: what acts without touch, or `None`.
    - `stations`: how many along the sleeve, both edges among them (at least 2).
    - `pin`: "through": longer than the sleeve, whose edges bear; "inside": shorter, `length` is its own.
    - `collar_radius` [m]: where faces bear, by default one and a half pin radii; `ring`: at how many points.
    - `pin_material`, `sleeve_material`: for laws that ask for them.
    """

    radial_clearance: Scalar = physical("m", above=0.0, help="sleeve radius minus pin radius", example='"0.1 mm"')
    pin_radius: Scalar = physical("m", above=0.0, help="radius of the pin", example='"10 mm"')
    length: Scalar = physical("m", above=0.0, help="length of the sleeve", example='"40 mm"')
    normal: AbstractNormalLaw
    friction: AbstractFrictionLaw | None = None
    axial_clearance: Scalar | None = physical(
        "m", above=0.0, default=None, help="axial play to either side", example='"0.1 mm"', absent="held axially"
    )
    element: AbstractElement | None = None
    stations: int = described("points along the sleeve, both edges among them", "8", static=True, default=8)
    pin: Literal["through", "inside"] = described(
        "whether it is longer than the sleeve (`through`) or shorter (`inside`)",
        '"inside"',
        static=True,
        default="through",
    )
    collar_radius: Scalar | None = physical(
        "m",
        above=0.0,
        default=None,
        help="radius at which the faces bear",
        example='"15 mm"',
        absent="one and a half pin radii",
    )
    ring: int = described("points of a face", "8", static=True, default=8)
    pin_material: Material | None = None
    sleeve_material: Material | None = None
    tangents: ClassVar[int] = 2

    def __check_init__(self):
        if not 2 <= self.stations <= MOST:
            raise ClearanceError(f"`stations` must be from 2 to {MOST}, but it is {self.stations}.")
        if not 3 <= self.ring <= MOST:
            raise ClearanceError(f"`ring` must be from 3 to {MOST}, but it is {self.ring}.")
        if self.pin not in PINS:
            raise ClearanceError(f"`pin` must be {' or '.join(PINS)}, but it is {quoted(self.pin)}.")

    @property
    def count(self) -> int:
        return self.stations + (0 if self.axial_clearance is None else self.ring)

    @property
    def sleeve_radius(self) -> Scalar:
        """Pin radius plus radial clearance [m]."""
        return self.pin_radius + self.radial_clearance

    @property
    def largest_tilt(self) -> Scalar:
        """The tilt at which both edges touch [rad]."""
        return 2 * self.radial_clearance / self.length

    def play(self):
        """Slides along the sleeve's axes, tilts about those across."""
        slides = [
            PlayCoordinate(".play_x", self.radial_clearance, slides=X),
            PlayCoordinate(".play_y", self.radial_clearance, slides=Y),
        ]
        if self.axial_clearance is not None:
            slides.append(PlayCoordinate(".play_z", self.axial_clearance, slides=Z))
        tilt = self.largest_tilt
        return (*slides, PlayCoordinate(".tilt_x", tilt, turns=X), PlayCoordinate(".tilt_y", tilt, turns=Y))

    def geometry(self):
        return Geometry(
            self.pin_radius,
            self.sleeve_radius,
            self.radial_clearance,
            self.length,
            self.pin_material,
            self.sleeve_material,
            "line",
        )

    def points(self, at):
        along = self._stations(at)
        if self.axial_clearance is None:
            return along
        return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), along, self._faces(at))

    def _stations(self, at: Relative) -> ContactPoint:
        places, weights = lobatto(self.stations)
        heights, axis = 0.5 * self.length * places, at.axis
        # Of a pin that is longer: at the sleeve's heights, where the pin's axis comes by.
        through = self.pin == "through"
        arm = scale((heights - jnp.asarray(at.place[2], float)) / axis[2] if through else heights, axis)
        centre = add(at.place, arm)
        distance, nx, ny = safe_unit(*(jnp.broadcast_to(jnp.asarray(c, float), heights.shape) for c in centre[:2]))
        radial: Vector = (nx, ny, 0.0)
        normal = radial
        if through:
            # An edge presses square to the pin, which tilts.
            normal = nx, ny, minus(0.0, plus(times(nx, axis[0]), times(ny, axis[1])) / axis[2])
        arm = add(arm, scale(self.sleeve_radius - distance, normal))
        return self._point(at, distance - self.radial_clearance, normal, ((-ny, nx, 0.0), Z), arm, weights)

    def _faces(self, at: Relative) -> ContactPoint:
        """Where a ring of the collar comes nearest to the one face or the other: none comes near both."""
        assert self.axial_clearance is not None
        radius = 1.5 * self.pin_radius if self.collar_radius is None else self.collar_radius
        angles = jnp.asarray(2 * np.pi * np.arange(self.ring) / self.ring)
        outward: Vector = (jnp.cos(angles), jnp.sin(angles), 0.0)
        # The collar is square to the pin's axis: its height over a place of the face.
        arm = subtract((radius * outward[0], radius * outward[1], 0.0), (*at.place[:2], 0.0))
        slope = scale(1.0 / jnp.asarray(at.axis[2], float), at.axis)
        fall = plus(times(slope[0], arm[0]), times(slope[1], arm[1]))
        height = jnp.broadcast_to(jnp.asarray(at.place[2], float) - fall, angles.shape)
        side = jnp.where(height < 0, -1.0, 1.0)
        normal = scale(side, slope)
        around: Vector = (-outward[1], outward[0], 0.0)
        arm = arm[0], arm[1], minus(0.0, fall)
        share = np.full(self.ring, 1.0 / self.ring)
        return self._point(at, side * height - self.axial_clearance, normal, (around, outward), arm, share)

    def _point(self, at: Relative, depth, normal: Vector, tangents, arm: Vector, share) -> ContactPoint:
        velocity = at.velocity_at(arm)
        count = depth.shape

        def whole(term):
            return jnp.broadcast_to(jnp.asarray(term, float), count)

        slip = tuple(whole(dot(tangent, velocity)) for tangent in tangents)
        vectors = [(whole(v[0]), whole(v[1]), whole(v[2])) for v in (normal, *tangents, arm)]
        return ContactPoint(
            depth, whole(dot(normal, velocity)), slip, vectors[0], tuple(vectors[1:-1]), vectors[-1], None, whole(share)
        )

    def pattern(self, points):
        """0 nowhere, 1 at one edge, 2 along a line from edge to edge, 3 at two edges on opposite sides; and 4 more
        where a face bears.
        """
        touching = points.penetration > 0
        along, last = touching[: self.stations], self.stations - 1
        x, y = (jnp.asarray(term) for term in points.normal[:2])
        same = x[0] * x[last] + y[0] * y[last] > 0
        both = jnp.where(same, 2.0, 3.0)
        radial = jnp.where(along[0] & along[last], both, jnp.where(jnp.any(along), 1.0, 0.0))
        return radial + jnp.where(jnp.any(touching[self.stations :]), 4.0, 0.0)

    def travel(self, along):
        return self.radial_clearance


def lobatto(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Places on [-1, 1], both ends among them, and weights that add up to one, of the Gauss-Lobatto quadrature."""
    legendre = np.polynomial.legendre.Legendre.basis(count - 1)
    places = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
    places = (places - places[::-1]) / 2
    return places, 1 / (count * (count - 1) * legendre(places) ** 2)
