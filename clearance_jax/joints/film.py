"""A film of oil between pin and sleeve: the short journal bearing."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.numerics import safe_unit
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.joints._element import AbstractElement, Offset
from clearance_jax.joints.bore import Bore, finer
from clearance_jax.laws import Geometry
from clearance_jax.parameters import physical
from clearance_jax.spatial import Vector

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
    viscosity: Scalar = physical("Pa*s", above=0.0, help="viscosity of the oil", example='"0.1 Pa*s"')
    roughness: Scalar = physical("m", above=0.0, help="least height of the film", example='"0.5 um"')

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
            )
        # As in a round sleeve, a pin nearer than twice the roughness is held off.
        bore = Bore(c, finer(geometry.depth))
        wall = bore.depth_at(*place)
        closed = 1 + wall.value / c
        lift = (closed - self._eccentricity(closed, self.roughness / c)) * c
        x, y = place[0] - lift * wall.x, place[1] - lift * wall.y
        depth, rise = _between(bore.depth)
        angles = 2 * np.pi * (np.arange(depth.shape[0]) + 0.5) / depth.shape[0]
        cosines, sines, width = jnp.asarray(np.cos(angles)), jnp.asarray(np.sin(angles)), 2 * np.pi / len(angles)
        # It may still be too near elsewhere, if it bears at two places.
        height = jnp.maximum(c + depth - x * cosines - y * sines, self.roughness)
        slope = rise + x * sines - y * cosines
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
        s = jnp.clip((ratio - begin) / (2 * least), 0.0, 1.0)
        # The integral of 1 - STEP5.
        rise = s - s**4 * (2.5 + s * (s - 3))
        return jnp.minimum(ratio, begin) + 2 * least * rise


def _between(depth: Array) -> tuple[Array, Array]:
    """The depths at the middles of equal parts of the sectors, linear from a sector's middle to the next; and their
    slope over the angle.
    """
    parts, rise = -(-PLACES // depth.shape[0]), jnp.roll(depth, -1) - depth
    at = ((np.arange(parts) + 0.5) / parts)[None]
    slope = jnp.repeat(rise * (depth.shape[0] / (2 * np.pi)), parts)
    return (depth[:, None] + rise[:, None] * at).ravel(), slope


def _mean_positive(values: Array) -> Array:
    """Means over sectors of the positive part of a sector-wise linear function, from its values at the middles."""
    reach = 0.25 * jnp.abs(jnp.roll(values, -1) - jnp.roll(values, 1))
    cut = jnp.abs(values) < reach
    return jnp.where(cut, (values + reach) ** 2 / (4 * jnp.where(cut, reach, 1.0)), jnp.maximum(values, 0.0))


def _loads(e: Scalar, closing: Scalar, around: Scalar) -> tuple[Scalar, Scalar]:
    """Integrals of the positive half of (a cos t + b sin t) / (1 - e cos t)^3, times cos t and sin t, with a
    = `closing` and b = `around`.
    """
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
