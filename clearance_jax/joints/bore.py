"""The shape of a worn bore, and the contact of a round pin in it.

The pin is round, so at the angle t of the sleeve it penetrates the wall by d(t) = e . n(t) - c - h(t), for small plays
and depths h. It touches where that is largest. The largest value over the sectors is smoothed,

    d = T log(sum_j exp(d_j / T) / m),    T = w^2 max(|e|, c / 2),    w: the width of a sector,

with T some 1e-4 of the clearance. In a round wall exp(d_j / T) is a bell over the angle, and this T makes it one sector
w wide. Then the sum over sectors equals the integral, to 1e-8 of T, and the pin does not feel the sectors. T grows with
the eccentricity, and m is that sum for a round wall. So if h is the same everywhere, d and its gradient, a unit vector,
are those of a round sleeve, however wide the sectors are. (Nearer to the middle than c / 2 nothing touches, and T is
constant.)

If a profile bears at two places at once, both are in the sum, and the gradient is shorter than one. d is convex, unless
the wall has edges as narrow as a sector, and has all derivatives in e and h where a pin can touch. The force is along
its gradient, so power balances and seats are unique.

A spline refines a profile of few sectors, as in `wear.Foundation`; with `FINE` sectors the gradient's length is within
1e-3 of one.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.numerics import safe_unit
from clearance_jax._basis.roots import bisect, newton
from clearance_jax._basis.types import Scalar
from clearance_jax._compile.barriers import with_barriers
from clearance_jax.parameters import Parametrised, physical
from clearance_jax.spatial import Vector

# Fewest sectors of a profile; with fewer the sleeve is a polygon.
FEWEST = 16
# Fewest sectors of a profile in contact.
FINE = 180
# Newton iterations for a distance to the wall, which start near it; bisections for the place at which a force holds the
# pin.
ITERATIONS, HALVINGS = 6, 44


class Modes(Parametrised):
    """Further wear of a sleeve as shapes, each multiplied by an amount. A derivative by a profile is then one by a few
    amounts, and not one by each sector.

    **Arguments:** `shapes` [m], of shape (count, sectors); `amounts`, of shape (count,).
    """

    shapes: Float[Array, "*batch count sectors"] = physical("m")
    amounts: Float[Array, "*batch count"] = physical("")


class Depth(NamedTuple):
    """Penetration of a pin in the wall [m], and its gradient by the place of the pin's centre."""

    value: Scalar
    x: Scalar
    y: Scalar


class Bore(NamedTuple):
    """A bore: radial clearance without wear, and worn depths by sector [m] (few sectors: see `finer`)."""

    clearance: Scalar
    depth: Float[Array, " sectors"]

    @property
    def _angles(self) -> np.ndarray:
        return 2 * np.pi * np.arange(self.depth.shape[0]) / self.depth.shape[0]

    @property
    def _directions(self) -> tuple[Array, Array]:
        """Cosines and sines of the sectors' angles."""
        return jnp.asarray(np.cos(self._angles)), jnp.asarray(np.sin(self._angles))

    def depth_at(self, x: Scalar, y: Scalar) -> Depth:
        """Penetration of a pin in the wall, with its gradient."""
        cosines, sines = self._directions
        square = (2 * np.pi / self.depth.shape[0]) ** 2
        far, nx, ny = safe_unit(x, y)
        grows = far > 0.5 * self.clearance
        blend = square * jnp.where(grows, far, 0.5 * self.clearance)
        each = with_barriers(x * cosines + y * sines - self.depth)
        top = jnp.max(jax.lax.stop_gradient(each))
        below = (each - top) / blend
        weight = with_barriers(jnp.exp(below))
        whole = jnp.sum(weight)
        # Relative to a round wall's sum, whose largest term is one.
        more = jnp.log(whole) - np.log(np.sum(np.exp((np.cos(self._angles) - 1) / square)))
        # The change of d because T changes with the pin's place.
        wider = jnp.where(grows, square * (more - jnp.sum(weight * below) / whole), 0.0)
        gx, gy = jnp.sum(weight * cosines) / whole + wider * nx, jnp.sum(weight * sines) / whole + wider * ny
        return Depth(top + blend * more - self.clearance, gx, gy)

    def distance(self, x: Scalar, y: Scalar, depth: Scalar, derivatives: int = 2) -> Scalar:
        """The distance from the middle, along a direction, at which a pin has a penetration, with so many
        `derivatives`. Newton's method begins at the place that the deepest sector alone would give.
        """

        def step(far, bore, x, y, depth):
            now = bore.depth_at(far * x, far * y)
            return far - (now.value - depth) / jax.lax.stop_gradient(now.x * x + now.y * y)

        cosines, sines = self._directions
        ahead = x * cosines + y * sines
        start = jnp.min(jnp.where(ahead > 0, (self.clearance + self.depth + depth) / ahead, jnp.inf))
        return newton(step, start, ITERATIONS, self, x, y, depth, last=derivatives)

    def seat(self, along: Vector, depth: Scalar) -> tuple[Scalar, Scalar]:
        """The place at which the pin is `depth` [m] deep in the wall, and the gradient of its depth points `along`."""
        ahead = tuple(jnp.asarray(c, float) for c in along[:2])
        still, wall, deep = jax.tree.map(jax.lax.stop_gradient, (self, ahead, depth))
        middle = jnp.arctan2(wall[1], wall[0])

        def miss(bore: Bore, ahead, depth, x, y):
            now = bore.depth_at(x, y)
            return jnp.stack([now.value - depth, ahead[0] * now.y - ahead[1] * now.x])

        def at(angle):
            x, y = jnp.cos(angle), jnp.sin(angle)
            far = still.distance(x, y, deep, 0)
            return far * x, far * y

        ends = middle - 0.5 * np.pi, middle + 0.5 * np.pi
        low, high = bisect(lambda angle: miss(still, wall, deep, *at(angle))[1] < 0, *ends, HALVINGS)
        x, y = at(0.5 * (low + high))
        (a, b), (c, d) = jax.jacfwd(lambda p: miss(still, wall, deep, p[0], p[1]))(jnp.stack([x, y]))
        inverse = 1 / (a * d - b * c)
        # Two more Newton steps, with the slope at the place, give the first and the second derivative.
        for _ in range(2):
            lack, turned = miss(self, ahead, depth, x, y)
            x, y = x - inverse * (d * lack - b * turned), y - inverse * (a * turned - c * lack)
        return x, y


def finer(depth: Float[Array, "*sections sectors"]) -> Float[Array, "*sections fine"]:
    """The profile with `FINE` sectors or more, the first one in the same place; one that has as many stays as it is."""
    parts = -(-FINE // depth.shape[-1])
    if parts == 1:
        return depth
    return spline(depth, np.arange(parts) / parts).reshape(*depth.shape[:-1], -1)


def spline(values: Float[Array, "*sections sectors"], places: np.ndarray) -> Float[Array, "*sections sectors places"]:
    """The periodic cubic spline through values of sectors, at places from 0 to 1 between their middles."""
    count = values.shape[-1]
    waves = jnp.asarray(2 * np.pi * np.arange(count // 2 + 1) / count)[(None,) * (values.ndim - 1)]
    bent = jnp.fft.irfft(jnp.fft.rfft(values) * (2 * jnp.cos(waves) - 2) * 6 / (4 + 2 * jnp.cos(waves)), count)
    x = places[(None,) * values.ndim]
    (a, b), (p, q) = ((v[..., None], jnp.roll(v, -1, axis=-1)[..., None]) for v in (values, bent))
    return a * (1 - x) + b * x + ((1 - x) ** 3 - (1 - x)) * p / 6 + (x**3 - x) * q / 6
