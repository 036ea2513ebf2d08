"""The revolute clearance joint of space: a pin of some length in a sleeve, with radial play, tilt, and axial play.

At stations along the sleeve the plane joint's contact is evaluated for the pin's section; the weighted sum is a
quadrature of the contact along its length. Two faces of the sleeve limit axial play; a collar of the pin bears on them
at points of a ring.

A force is along the gradient of its penetration by the pin's place. It acts at the point where its moment is the
gradient by the pin's tilt. So power balances exactly, for a tilted pin too. The penetrations leave out terms of second
order in the tilt: a tilted pin's section is not quite round. Friction leaves out terms of first order: it acts along
the directions of the sleeve, which are not quite normal to the gradient of a tilted pin.

A worn sleeve has its own bore at every station (see `joints.bore`).
"""

import dataclasses
from typing import Any, ClassVar, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.numerics import safe_unit
from clearance_jax._basis.types import Scalar
from clearance_jax._compile.barriers import with_barriers
from clearance_jax.errors import ClearanceError, wrong_value
from clearance_jax.joints._base import AbstractElement
from clearance_jax.joints.bore import FEWEST, Bore, finer
from clearance_jax.joints.checks import GRIPS
from clearance_jax.joints.contact import ContactPoint, JointOutline, PlayCoordinate, Relative
from clearance_jax.joints.fitting import Tolerance
from clearance_jax.joints.pin import AbstractPin, Sections, depth_demand
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, Material
from clearance_jax.parameters import Demand, describe, physical
from clearance_jax.spatial import Vector, X, Y, Z, add, dot, is_zero, minus, plus, scale, subtract, times

# Most stations or ring points. More gain little: contact may still begin between two stations.
MOST = 64
PINS = ("through", "inside")
# Largest error of a penetration at the largest tilt, in parts of the clearance: the pin's section is taken as round.
OVAL = 0.1


class Meeting(NamedTuple):
    """By contact point: penetration, normal, arm (see `ContactPoint`)."""

    depth: Array
    normal: Vector
    arm: Vector


class SleeveClearance(AbstractPin):
    """The radial play, the tilt and the axial play of a pin in a sleeve, in space.

    **Arguments:**

    - `radial_clearance`: sleeve radius minus pin radius [m], > 0.
    - `pin_radius`, and `length` of the sleeve [m], > 0.
    - `normal`: the normal law of the whole sleeve: each station has a share of it, and so has each point of a face.
    - `friction`: the friction law, or `None`.
    - `axial_clearance`: how far the pin may slide to either side [m], > 0; `None`: it is held axially.
    - `element`: what acts without touch, or `None`.
    - `stations`: how many there are along the sleeve, both edges included (at least 2).
    - `pin`: "through": the pin is longer than the sleeve, and touches its edges; "inside": the pin is shorter, its own
      edges touch the sleeve, and `length` is that of the pin.
    - `collar_radius` [m]: where the faces touch, by default one and a half pin radii; `ring`: at how many points. Faces
      exist with axial clearance only.
    - `pin_material`, `sleeve_material`: for laws that need them.
    - `tolerance`: between which values the radial clearance lies as it is made, for information.
    - `depth` [m]: the wear of the sleeve, shape (stations, sectors), at least 16 sectors: the first in the direction of
      the sleeve's x, the others evenly around it. `None`: the sleeve is round, and the program has nothing for wear.
    """

    radial_clearance: Scalar = physical("m", "sleeve radius minus pin radius", '"0.1 mm"', above=0.0, instead=GRIPS)
    pin_radius: Scalar = physical("m", "radius of the pin", '"10 mm"', above=0.0)
    length: Scalar = physical("m", "length of the contact along the sleeve", '"40 mm"', above=0.0)
    normal: AbstractNormalLaw
    friction: AbstractFrictionLaw | None = None
    axial_clearance: Scalar | None = physical(
        "m", "axial play to either side", '"0.1 mm"', "held axially", above=0.0, default=None, instead=GRIPS
    )
    element: AbstractElement | None = None
    stations: int = describe("points along the sleeve, both edges among them", "8", static=True, default=8)
    pin: Literal["through", "inside"] = describe(
        "whether it is longer than the sleeve (`through`) or shorter (`inside`)",
        '"inside"',
        static=True,
        default="through",
    )
    collar_radius: Scalar | None = physical(
        "m", "radius at which the faces bear", '"15 mm"', "one and a half pin radii", above=0.0, default=None
    )
    ring: int = describe("points of a face", "8", static=True, default=8)
    pin_material: Material | None = None
    sleeve_material: Material | None = None
    tolerance: Tolerance | None = None
    depth: Float[Array, "*batch stations sectors"] | None = physical("m", least=0.0, default=None)
    kind: ClassVar[str] = "sleeve"
    tangents: ClassVar[int] = 2
    contact: ClassVar[Literal["point", "line"]] = "line"

    def __check_init__(self):
        if not 2 <= self.stations <= MOST:
            raise wrong_value("`stations`", f"from 2 to {MOST}", self.stations, str(self.stations))
        shape = () if self.depth is None else np.shape(self.depth)
        if shape and (shape[:-1] != (self.stations,) or shape[-1] < FEWEST):
            raise ClearanceError(
                f"`depth` must be one number a station and sector, {self.stations} stations with at least {FEWEST} "
                f"sectors, but it has shape {shape}."
            ).about("depth", shape)
        if not 3 <= self.ring <= MOST:
            raise wrong_value("`ring`", f"from 3 to {MOST}", self.ring, str(self.ring))
        if self.pin not in PINS:
            raise wrong_value("`pin`", " or ".join(PINS), self.pin)
        if self.collar_radius is not None and self.axial_clearance is None:
            raise ClearanceError("`collar_radius` has no effect without `axial_clearance`: only then are there faces.")

    def demands(self):
        radius, clearance = self.pin_radius, self.radial_clearance
        yield Demand("pin_radius", radius > clearance, lambda: f"must be greater than the clearance {clearance:g} m")
        # At the largest tilt the pin's section, an ellipse, reaches r (2c/L)^2 / 2 further than the round one.
        square = 2 * radius * clearance / OVAL
        why = "a shorter sleeve lets its pin tilt so far that its section is not round"
        fits = self.length**2 > square
        yield Demand("length", fits, lambda: f"must be greater than {np.sqrt(square):.3g} m: {why}")
        yield from depth_demand(self)
        if self.collar_radius is not None:
            bore = radius + clearance
            yield Demand("collar_radius", self.collar_radius > bore, lambda: f"must be above the bore's {bore:g} m")

    @property
    def count(self) -> int:
        return self.stations + (0 if self.axial_clearance is None else self.ring)

    @property
    def largest_tilt(self) -> Any:
        """The tilt at which both edges touch [rad]."""
        return 2 * self.radial_clearance / self.length

    def play(self):
        """Slides along the sleeve's axes, and tilts about the two across."""
        slides = self.across()
        if self.axial_clearance is not None:
            slides = (*slides, PlayCoordinate(".play_z", self.axial_clearance, slides=Z))
        tilt, tilts = self.largest_tilt, ((".tilt_x", X), (".tilt_y", Y))
        return (*slides, *(PlayCoordinate(name, tilt, turns=axis, swings=True) for name, axis in tilts))

    def points(self, at):
        places, weights = lobatto(self.stations)
        if self.axial_clearance is None:
            meeting = with_barriers(self._stations(at, places))
            return self._contact_points(at, meeting, _around(self._radial(meeting)), weights)
        # Every point is computed as a station and as a point of a face, and one of both is selected. A concatenation is
        # slower: compiled, it finds out for each number from which part it comes.
        angles, share = 2 * np.pi * np.arange(self.ring) / self.ring, np.full(self.ring, 1.0 / self.ring)
        is_station = np.arange(self.count) < self.stations
        angles = np.append(np.zeros(self.stations), angles)
        stations = self._stations(at, np.append(places, np.zeros(self.ring)))
        meeting = with_barriers(_choose(is_station, stations, self._faces(at, angles)))
        outward: Vector = (jnp.asarray(np.cos(angles)), jnp.asarray(np.sin(angles)), 0.0)
        tangents = _choose(is_station, _around(self._radial(meeting)), (_around(outward)[0], outward))
        return self._contact_points(at, meeting, tangents, np.append(weights, share))

    def _stations(self, at: Relative, places: np.ndarray) -> "Meeting":
        """The contact at places from -1 to 1 along the sleeve."""
        arm, slope = self._axis(at, places)
        centre = add(at.place, arm)
        x, y = (jnp.broadcast_to(jnp.asarray(c, float), places.shape) for c in centre[:2])
        if self.depth is not None:
            return self._in_bores(arm, slope, x, y)
        distance, nx, ny = safe_unit(x, y)
        # An edge presses normal to the tilted pin.
        along = minus(0.0, plus(times(nx, slope[0]), times(ny, slope[1])))
        normal: Vector = (nx, ny, along)
        arm = add(arm, scale(self.sleeve_radius - distance, normal))
        return Meeting(distance - self.radial_clearance, normal, arm)

    def _axis(self, at: Relative, places: np.ndarray) -> tuple[Vector, Vector]:
        """The pin's axis at places from -1 to 1 along the sleeve: arms from the pin's centre to it, and its slope."""
        heights = 0.5 * self.length * places
        if self.pin == "inside":
            return scale(heights, at.axis), Z
        # A longer pin: where its axis passes the sleeve's heights.
        slope = self._slope(at)
        return scale(heights - jnp.asarray(at.place[2], float), slope), slope

    @property
    def section_count(self):
        return self.stations

    def sections(self):
        """The stations, each with its part of the length."""
        places, weights = lobatto(self.stations)
        return Sections(self.geometry(), 0.5 * self.length * places, self.length * jnp.asarray(weights))

    def worn(self, depth: Any) -> "SleeveClearance":
        depth = jnp.asarray(depth, float)
        return dataclasses.replace(self, depth=depth if depth.ndim > 1 else jnp.tile(depth, (self.stations, 1)))

    def centres(self, at):
        places, _ = lobatto(self.stations)
        x, y, _ = add(at.place, self._axis(at, places)[0])
        return jnp.stack([jnp.broadcast_to(jnp.asarray(c, float), places.shape) for c in (x, y)], axis=-1)

    def _in_bores(self, arm: Vector, slope: Vector, x: Array, y: Array) -> "Meeting":
        """The contact at worn stations; places beyond them (points of faces) are zero."""
        assert self.depth is not None
        among, beyond = slice(self.stations), (0, x.size - self.stations)
        depths = jax.vmap(lambda depth, x, y: Bore(self.radial_clearance, depth).depth_at(x, y))(
            finer(self.depth), x[among], y[among]
        )
        deep, gx, gy = (jnp.pad(term, beyond) for term in depths)
        along = minus(0.0, plus(times(gx, slope[0]), times(gy, slope[1])))
        # The arm is along the force, from the pin's axis: a force has no moment about a round pin.
        size, *_ = safe_unit(gx, gy)
        reach = (self.pin_radius - deep) / jnp.where(size > 0, size, 1.0)
        return Meeting(deep, (gx, gy, along), add(arm, scale(reach, (gx, gy, along))))

    def _radial(self, meeting: "Meeting") -> Vector:
        """The direction of a force in its section. (A worn bore's gradient is shorter where it bears at two places.)"""
        if self.depth is None:
            return meeting.normal
        _, x, y = safe_unit(*(jnp.asarray(c) for c in meeting.normal[:2]))
        return (x, y, 0.0)

    def _faces(self, at: Relative, angles: np.ndarray) -> "Meeting":
        """Where points of the collar's ring come nearest to the nearer one of the two faces."""
        assert self.axial_clearance is not None
        # The collar is a plane normal to the pin's axis. Its height over a point of the face is `height`.
        radius, slope = self._face_radius, self._slope(at)
        arm = subtract((radius * np.cos(angles), radius * np.sin(angles), 0.0), (*at.place[:2], 0.0))
        fall = with_barriers(plus(times(slope[0], arm[0]), times(slope[1], arm[1])))
        height = with_barriers(jnp.broadcast_to(jnp.asarray(at.place[2], float) - fall, angles.shape))
        side = jnp.where(height < 0, -1.0, 1.0)
        arm = arm[0], arm[1], minus(0.0, fall)
        return Meeting(side * height - self.axial_clearance, scale(side, slope), arm)

    @property
    def _face_radius(self) -> Scalar:
        """Where the faces touch [m]."""
        return 1.5 * self.pin_radius if self.collar_radius is None else self.collar_radius

    def _slope(self, at: Relative) -> Vector:
        """The pin's axis per unit of height along the sleeve."""
        x, y, z = at.axis
        if is_zero(x) and is_zero(y):
            return Z
        return *with_barriers((times(x, 1.0 / z), times(y, 1.0 / z))), 1.0

    def _contact_points(self, at: Relative, where: "Meeting", tangents, share: np.ndarray) -> ContactPoint:
        velocity = at.velocity_at(where.arm)

        def along(direction):
            part = jnp.asarray(dot(direction, velocity), float)
            return with_barriers(jnp.broadcast_to(part, where.depth.shape))

        rate, *slip = (along(direction) for direction in (where.normal, *tangents))
        return ContactPoint(where.depth, rate, tuple(slip), where.normal, tangents, where.arm, None, jnp.asarray(share))

    def pattern(self, points):
        """0 nowhere, 1 one edge, 2 a line from edge to edge, 3 edges on opposite sides; 4 more where a face bears."""
        touching = points.penetration > 0
        along, last = touching[: self.stations], self.stations - 1
        x, y = (jnp.asarray(term) for term in points.normal[:2])
        same = x[0] * x[last] + y[0] * y[last] > 0
        both = jnp.where(same, 2.0, 3.0)
        radial = jnp.where(along[0] & along[last], both, jnp.where(jnp.any(along), 1.0, 0.0))
        return radial + jnp.where(jnp.any(touching[self.stations :]), 4.0, 0.0)

    def outline(self):
        faces = {"axial": self.axial_clearance, "collar": self._face_radius, "ring": self.ring}
        heights, through = 0.5 * self.length * lobatto(self.stations)[0], self.pin == "through"
        wall = self.pin_radius, self.radial_clearance, self.depth
        return JointOutline(*wall, self.length, heights, edges=True, through=through, **faces)

    def travel(self, along):
        if self.depth is None:
            return self.radial_clearance
        x, y = (jnp.asarray(c, float) for c in along[:2])
        bores = jax.vmap(lambda depth: Bore(self.radial_clearance, depth).distance(x, y, jnp.zeros(())))
        return jnp.min(bores(finer(self.depth)))


def lobatto(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Places on [-1, 1], both ends included, and weights that add up to one, of the Gauss-Lobatto quadrature."""
    legendre = np.polynomial.legendre.Legendre.basis(count - 1)
    places = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
    places = (places - places[::-1]) / 2
    return places, 1 / (count * (count - 1) * legendre(places) ** 2)


def _choose(here: np.ndarray, these: Any, others: Any) -> Any:
    """By point `these` where `here` is set, else `others`; equal constants stay constants."""

    def choose(a, b):
        return a if isinstance(a, float) and isinstance(b, float) and a == b else jnp.where(here, a, b)

    return jax.tree.map(choose, these, others)


def _around(radial: Vector) -> tuple[Vector, Vector]:
    """The directions around the sleeve and along it, normal to a radial one."""
    return (-radial[1], radial[0], 0.0), Z
