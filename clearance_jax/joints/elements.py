"""Elements that fill a joint's play without touch: grease and seals damp it, preloaded rolling elements close it.

Without them a sleeve rings: a pin's modes along its wall have hardly any damping of their own.
"""

import abc
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.numerics import greater, lesser, positive_part, safe_unit, within
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.joints.bore import Bore, finer
from clearance_jax.joints.checks import check_sizes
from clearance_jax.joints.contact import PlayCoordinate, Relative
from clearance_jax.laws import Geometry
from clearance_jax.parameters import Parametrised, physical
from clearance_jax.spatial import ZERO, Term, Vector, Z, add, cross, dot, minus, plus, scale, times


class Offset(NamedTuple):
    """The part of a pin's motion that is play, in the sleeve's axes. Other components are absent.

    - `place` [m] and `velocity` [m/s] of the pin's centre; `spin` [rad/s].
    - `roll` [rad/s]: how fast the pin turns about the sleeve's axis, which is no play.
    - `sine`: the sine of the tilt, along the axis about which the pin is tilted; `cosine`: the cosine of the tilt.
    """

    place: Vector
    velocity: Vector
    sine: Vector
    cosine: Term
    spin: Vector
    roll: Term = 0.0

    @classmethod
    def of(cls, play: Sequence[PlayCoordinate], at: Relative) -> "Offset":
        """The part of a relative motion along the coordinates of a `play`."""
        slides = [any((c.slides or ZERO)[i] for c in play) for i in range(3)]
        turns = [any((c.turns or ZERO)[i] for c in play) for i in range(3)]
        sine, cosine = ZERO, 1.0
        if at.rows is not None and turns[2]:
            (_, a, b), (c, _, d), (e, f, _) = at.rows
            sine = scale(0.5, (minus(f, d), minus(b, e), minus(c, a)))
            cosine = 0.5 * (at.rows[0][0] + at.rows[1][1] + at.rows[2][2] - 1)
        elif at.rows is not None:  # a turn of the pin about its axis is no tilt
            sine, cosine = cross(Z, at.axis), at.axis[2]

        def only(axes: list[bool], vector: Vector) -> Vector:
            x, y, z = (component if has_play else 0.0 for has_play, component in zip(axes, vector, strict=True))
            return x, y, z

        place, velocity = only(slides, at.place), only(slides, at.velocity)
        return cls(place, velocity, only(turns, sine), cosine, only(turns, at.spin), at.spin[2])


class AbstractElement(Parametrised):
    """A filling of a joint's play that acts without touch: grease, a seal, a film, preloaded rolling elements."""

    stiff: ClassVar[bool] = False
    """Whether it holds its pin, so that the pin rests where the element and the wall bear the load together."""
    has_static_force: ClassVar[bool] = True
    """Whether it bears loads by its place, and not by the motion of the pin alone."""

    @abc.abstractmethod
    def wrench(self, offset: Offset, geometry: Geometry) -> tuple[Vector, Vector]:
        """Force on the pin [N] and torque about its centre [N m], in the sleeve's axes."""

    def energy(self, offset: Offset, geometry: Geometry) -> Scalar:
        """The elastic energy that it stores [J], zero by default; the rest of the work done on it is lost."""
        return jnp.zeros(())


# Places around a worn sleeve at which the pressure is summed, at least.
PLACES = 720


class ShortBearing(AbstractElement):
    """The film of a short journal bearing (Ocvirk) that carries where its pressure is positive, on one half of its
    circumference (half Sommerfeld), with squeeze and with a turning pin. It holds for lengths up to half of the pin's
    diameter.

    The film gives over to the contact of the walls: from twice the height `roughness` on, the film's height is smoothly
    held above `roughness`, so that its force stays finite where the normal law bears the rest of the load.

    Over the width z of the sleeve p = -(6 m / h^3) (L^2/4 - z^2) (h' + w h_t / 2), with the height h = c - x cos t - y
    sin t at the angle t, its rate h', its slope h_t over the angle, and the pin's turning w. The friction of a full
    film and the moment of the pressures slow the pin down. In space the film is that of the pin's middle: it does not
    know of a tilt.

    In a worn sleeve the height is h = c + d(t) - x cos t - y sin t, with the depth d of the wear at the angle t. The
    film of a sleeve that is worn by stations is not known.

    **Source:** Ocvirk 1952. The integrals over the angle are in closed form, by Sommerfeld's substitution; in a worn
    sleeve they are sums over places around it.

    **Arguments:** `viscosity` m [Pa s]; `roughness` [m]: the least height of the film.

    **Raises:** `ClearanceError` for a joint without `length`, and for a sleeve that is worn by stations.
    """

    has_static_force: ClassVar[bool] = False
    viscosity: Scalar = physical("Pa*s", "viscosity of the oil", '"0.1 Pa*s"', above=0.0)
    roughness: Scalar = physical("m", "least height of the film", '"0.5 um"', above=0.0)

    def wrench(self, offset: Offset, geometry: Geometry) -> tuple[Vector, Vector]:
        """Force and torque of the film on the pin."""
        if geometry.length is None or geometry.kind == "flat":
            raise ClearanceError("A film needs a pin in a sleeve with a `length`: give the joint its `length`.")
        x, y = (jnp.asarray(term, float) for term in offset.place[:2])
        u, v = (jnp.asarray(term, float) for term in offset.velocity[:2])
        turning = jnp.asarray(offset.roll, float)
        if geometry.depth is not None:
            fx, fy, torque = self._worn(geometry, (x, y), (u, v), turning)
            return (fx, fy, 0.0), (0.0, 0.0, torque)
        c, length, radius = geometry.radial_clearance, geometry.length, geometry.pin_radius
        distance, nx, ny = safe_unit(x, y)
        nx = jnp.where(distance > 0, nx, 1.0)
        e = self._eccentricity(distance / c, self.roughness / c)
        # The film closes ahead of the pin: the angle is counted from there, so that h = c (1 - e cos t).
        closing, around = (u * nx + v * ny) / c, (v * nx - u * ny) / c - 0.5 * turning * e
        ahead, beside = _loads(e, closing, around)
        scale = self.viscosity * radius * length**3 / c**2
        fx, fy = -scale * (ahead * nx - beside * ny), -scale * (ahead * ny + beside * nx)
        # Friction of a full film, and the moment of the pressures on its slope.
        shear = -2 * np.pi * self.viscosity * radius**3 * length / (c * jnp.sqrt(1 - e * e)) * turning
        torque = shear + 0.5 * scale * beside * e * c
        return (fx, fy, 0.0), (0.0, 0.0, torque)

    def _worn(
        self, geometry: Geometry, place: tuple[Scalar, Scalar], velocity: tuple[Scalar, Scalar], turning: Scalar
    ) -> tuple[Scalar, Scalar, Scalar]:
        """Force and torque in a worn sleeve."""
        c, length, radius = geometry.radial_clearance, geometry.length, geometry.pin_radius
        assert length is not None  # a film's joint has one
        assert geometry.depth is not None
        if geometry.depth.ndim > 1:
            raise ClearanceError(
                "A film must be in a round sleeve, or in one that is worn alike all along it (a joint in the plane), "
                "but this one is worn by stations. Leave out its `depth` or its film."
            ).about("depth")
        # As in a round sleeve, a pin nearer than twice the roughness is held off.
        bore = Bore(c, finer(geometry.depth))
        wall = bore.depth_at(*place)
        closed = 1 + wall.value / c
        lift = (closed - self._eccentricity(closed, self.roughness / c)) * c
        x, y = place[0] - lift * wall.x, place[1] - lift * wall.y
        depth, wear_slope = _between(bore.depth)
        angles = 2 * np.pi * (np.arange(depth.shape[0]) + 0.5) / depth.shape[0]
        cosines, sines, width = jnp.asarray(np.cos(angles)), jnp.asarray(np.sin(angles)), 2 * np.pi / len(angles)
        # It may still be too near elsewhere, if it bears at two places.
        height = greater(c + depth - x * cosines - y * sines, self.roughness)
        slope = wear_slope + x * sines - y * cosines
        closing = velocity[0] * cosines + velocity[1] * sines - 0.5 * turning * slope
        # The pressure, summed over the width of the film.
        pressure = self.viscosity * length**3 * _mean_positive(closing) / height**3
        around = radius * width
        fx, fy = -around * jnp.sum(pressure * cosines), -around * jnp.sum(pressure * sines)
        shear = self.viscosity * radius**2 * length * turning * jnp.sum(1 / height)
        return fx, fy, around * (0.5 * jnp.sum(pressure * slope) - shear)

    def _eccentricity(self, ratio: Scalar, least: Scalar) -> Scalar:
        """The eccentricity over the clearance, held below 1 - least from 1 - 2 least on, three times differentiable."""
        begin = 1 - 2 * least
        s = within((ratio - begin) / (2 * least), 0.0, 1.0)
        # The integral of 1 - STEP5.
        rise = s - s**4 * (2.5 + s * (s - 3))
        return lesser(ratio, begin) + 2 * least * rise


def _between(depth: Array) -> tuple[Array, Array]:
    """Depths at places between the sectors, interpolated linearly, and their slopes over the angle [m/rad]."""
    parts, rise = -(-PLACES // depth.shape[0]), jnp.roll(depth, -1) - depth
    at = ((np.arange(parts) + 0.5) / parts)[None]
    slope = jnp.repeat(rise * (depth.shape[0] / (2 * np.pi)), parts)
    return (depth[:, None] + rise[:, None] * at).ravel(), slope


def _mean_positive(values: Array) -> Array:
    """Means over sectors of the positive part of a sector-wise linear function, from its values at the middles."""
    reach = 0.25 * jnp.abs(jnp.roll(values, -1) - jnp.roll(values, 1))
    cut = jnp.abs(values) < reach
    return jnp.where(cut, (values + reach) ** 2 / (4 * jnp.where(cut, reach, 1.0)), positive_part(values))


def _loads(e: Scalar, closing: Scalar, around: Scalar) -> tuple[Scalar, Scalar]:
    """Integrals of max(0, a cos t + b sin t) / (1 - e cos t)^3, times cos t and sin t; a = `closing`, b = `around`."""
    size, a, b = safe_unit(closing, around)
    a = jnp.where(size > 0, a, 1.0)
    root = jnp.sqrt(1 - e * e)

    def sommerfeld(cosine, sine):
        # cos g = (cos t - e)/(1 - e cos t), sin g = root sin t/(1 - e cos t).
        return jnp.arctan2(root * sine, cosine - e)

    # Positive within a quarter turn of the direction (a, b).
    low = sommerfeld(b, -a)
    high = sommerfeld(-b, a)
    high = jnp.where(high < low, high + 2 * np.pi, high)

    def integrals(g):
        s, k = jnp.sin(g), jnp.cos(g)
        squares = 0.5 * (g + s * k)  # of cos^2
        cc = squares + 2 * e * s + e * e * g
        sc = 0.5 * s * s - e * k
        ss = 0.5 * (g - s * k)
        return jnp.stack([cc / root**5, sc / root**4, ss / root**3])

    cc, sc, ss = integrals(high) - integrals(low)
    return closing * cc + around * sc, closing * sc + around * ss


# Damping of rolling bearings is reckoned as (0.25 to 2.5) 1e-5 s of their stiffness (Krämer, Dynamics of rotors and
# foundations, Springer 1993).
ROLLING_DAMPING = 1e-5


class PlayDamper(AbstractElement):
    """A linear damper that acts on the play: -b v on the pin's centre, -b w on its tilt. It exerts no force at rest.

    **Arguments:** `radial` [N s/m], across the axis; `axial` [N s/m], along it; `tilt` [N m s/rad]. Motions in which
    the joint has no play are not damped: a pin turns freely about its axis.
    """

    radial: Scalar = physical("N*s/m", "damping of the play across", '"2 kN*s/m"', least=0.0)
    axial: Scalar = physical("N*s/m", "damping of axial play", '"1 kN*s/m"', least=0.0, default=0.0)
    tilt: Scalar = physical("N*m*s/rad", "damping of tilt", '"0.5 N*m*s/rad"', least=0.0, default=0.0)

    @classmethod
    def film(cls, viscosity: Any, pin_radius: Any, length: Any, radial_clearance: Any) -> "PlayDamper":
        """The damping of a film that fills the play, about the middle position of the pin: pi m r L^3 / c^3 radially,
        and pi m r L^5 / (60 c^3) in tilt, with the viscosity m.

        It holds for small motions of a short pin (L below 2 r) whose film does not cavitate. Near the wall a film damps
        more. Warm base oils of greases have about 0.1 to 0.5 Pa s (ISO VG 100 to 460 at 40 degC).

        **Source:** Reynolds' equation of the short bearing (Ocvirk 1952), integrated for a rate of the film's height
        that is even along the pin, or grows from its middle.

        **Arguments:** `viscosity` [Pa s]; `pin_radius`, `length`, `radial_clearance` [m].
        """
        check_sizes("Pa*s", viscosity=viscosity)
        check_sizes(pin_radius=pin_radius, length=length, radial_clearance=radial_clearance)
        radial = np.pi * viscosity * pin_radius * length**3 / radial_clearance**3
        return cls(radial, 0.0, radial * length**2 / 60)

    def wrench(self, offset: Offset, geometry: Geometry) -> tuple[Vector, Vector]:
        """The damping force and torque."""
        return _damping_force(self.radial, self.axial, offset.velocity), scale(-self.tilt, offset.spin)


class PreloadedBearing(AbstractElement):
    """Rolling elements under a preload P, which remove the play up to a load: -k x / sqrt(1 + (k |x| / P)^2).

    Up to about half of P the bearing is a spring of the stiffness k. Beyond, rolling elements come loose. It never
    bears more than P: the walls of the joint's play bear the rest of the load. So the play comes back under a large
    load, and when wear takes the preload away. Its energy is P^2 / k (sqrt(1 + (k |x| / P)^2) - 1).

    **Arguments:**

    - `radial_stiffness` [N/m], > 0; `axial_stiffness` [N/m], of axial play; `tilt_stiffness` [N m/rad].
    - `radial_preload`, `axial_preload` [N], `tilt_preload` [N m]: the load at which the play opens; `None`: it never
      opens.
    - `damping_time` [s]: damping over stiffness; for rolling bearings 0.25e-5 to 2.5e-5 s (Krämer 1993).
    """

    radial_stiffness: Scalar = physical("N/m", "stiffness across", '"200 N/um"', above=0.0)
    axial_stiffness: Scalar = physical("N/m", "stiffness of axial play", '"300 N/um"', least=0.0, default=0.0)
    tilt_stiffness: Scalar = physical("N*m/rad", "stiffness against tilt", '"200 kN*m/rad"', least=0.0, default=0.0)
    radial_preload: Scalar | None = physical(
        "N", "force at which the play opens", '"800 N"', "it never opens", above=0.0, default=None
    )
    axial_preload: Scalar | None = physical(
        "N", "axial force at which it opens", '"1 kN"', "it never opens", above=0.0, default=None
    )
    tilt_preload: Scalar | None = physical(
        "N*m", "moment at which it opens", '"40 N*m"', "it never opens", above=0.0, default=None
    )
    damping_time: Scalar = physical("s", "damping over stiffness", '"10 us"', least=0.0, default=ROLLING_DAMPING)
    stiff: ClassVar[bool] = True

    def _springs(self, offset: Offset) -> tuple[tuple[Scalar, Scalar | None, Vector], ...]:
        """Stiffness, preload and deflection across and along the axis, and of the tilt (by the chord of its angle)."""
        x, y, z = offset.place
        chord = jnp.sqrt(2 / (1 + jnp.asarray(offset.cosine, float)))
        return (
            (self.radial_stiffness, self.radial_preload, (x, y, 0.0)),
            (self.axial_stiffness, self.axial_preload, (0.0, 0.0, z)),
            (self.tilt_stiffness, self.tilt_preload, scale(chord, offset.sine)),
        )

    def wrench(self, offset: Offset, geometry: Geometry) -> tuple[Vector, Vector]:
        """Force and torque of the springs and their damping."""
        radial, axial, tilt = (scale(-k / _opening(k, preload, at), at) for k, preload, at in self._springs(offset))
        # The energy of the tilt depends on the chord 2 sin(a / 2) of its angle a. Its derivative by a has a factor
        # cos(a / 2).
        lean = jnp.sqrt((1 + jnp.asarray(offset.cosine, float)) / 2)
        damping = _damping_force(self.radial_stiffness, self.axial_stiffness, offset.velocity)
        force = add(add(radial, axial), scale(self.damping_time, damping))
        spent = scale(-times(self.damping_time, self.tilt_stiffness), offset.spin)
        return force, add(scale(lean, tilt), spent)

    def energy(self, offset: Offset, geometry: Geometry) -> Scalar:
        """The energy of the springs [J]."""
        stored: Term = 0.0
        for k, preload, at in self._springs(offset):
            stored = plus(stored, times(k / (1 + _opening(k, preload, at)), dot(at, at)))
        return jnp.asarray(stored, float)


def _damping_force(across: Scalar, along: Scalar, rate: Vector) -> Vector:
    return times(-across, rate[0]), times(-across, rate[1]), times(-along, rate[2])


def _opening(stiffness: Scalar, preload: Scalar | None, at: Vector) -> Scalar | float:
    """sqrt(1 + (k |x| / P)^2): 1 where nothing is loose."""
    return 1.0 if preload is None else jnp.sqrt(1 + (stiffness / preload) ** 2 * jnp.asarray(dot(at, at), float))


ELEMENTS = {"damper": PlayDamper, "preloaded-bearing": PreloadedBearing, "short-bearing": ShortBearing}
"""Elements by their words in scene files."""
