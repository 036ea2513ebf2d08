"""The distance of a point from its ideal path, at whatever time the ideal point passes there."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from clearance_jax._basis.module import Module
from clearance_jax._basis.roots import bisect
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError, wrong_value
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.metrics.functions import named_point
from clearance_jax.metrics.signals import TABLE, AbstractSignal, motion_of, play_size, point_at
from clearance_jax.solve.settings import DYNAMICS, Settings, evenly
from clearance_jax.solve.simulate import run
from clearance_jax.solve.steps.interpolate import hermite
from clearance_jax.solve.steps.tolerances import largest_length
from clearance_jax.spatial import as_array, length_of, three

# Bisections of an interval: of 1 mm they leave less than 1e-12 m.
HALVINGS = 30
# Largest error of the path, relative to the largest play and to the mechanism's length.
OF_PLAY, OF_LENGTH = 1e-3, 1e-8


class SampledPath(Module):
    """A path by samples at equal intervals of time: `places` [m] and `moves`, velocity times interval [m]; `known`:
    whether the samples are dense enough.
    """

    places: Float[Array, "samples 3"]
    moves: Float[Array, "samples 3"]
    known: Bool[Array, ""]

    def at(self, x: Scalar) -> Float[Array, " 3"]:
        """The place [m] after x of the intervals, by the cubic between two samples."""
        k = jnp.clip(jnp.floor(jax.lax.stop_gradient(x)).astype(int), 0, len(self.places) - 2)
        return hermite(self.places[k], self.moves[k], self.places[k + 1], self.moves[k + 1], x - k)

    def nearest(self, point: Float[Array, " 3"]) -> Scalar:
        """The parameter (in intervals) of the place nearest to a point, on the curve's part at the nearest chord."""
        ways, off = jnp.diff(self.places, axis=0), point[None] - self.places[:-1]
        squares = jnp.sum(ways * ways, axis=1)
        along = jnp.clip(jnp.sum(off * ways, axis=1) / jnp.where(squares > 0, squares, 1.0), 0.0, 1.0)
        k = jnp.argmin(jnp.sum((off - along[:, None] * ways) ** 2, axis=1))

        def is_before(x):
            place, rate = jax.jvp(self.at, (x,), (jnp.ones_like(x),))
            return rate @ (point - place) > 0

        return bisect(is_before, 1.0 * k, k + 1.0, HALVINGS)[0]

    def distance(self, point: Float[Array, " 3"]) -> Scalar:
        """The distance of a point from the path [m]; NaN if the path is not `known`. At the foot of the perpendicular,
        or at an end of the path, the distance is stationary along the path: its derivative is that at a fixed place.
        """
        here, curve = jax.lax.stop_gradient((point, self))
        off = length_of(three(point - self.at(curve.nearest(here))))
        return jnp.where(self.known, 1.0, jnp.nan) * off


class OnPath(AbstractSignal):
    """The distance of a named `point` from a `curve` [m]."""

    word: ClassVar[str] = "path-deviation"
    unit: ClassVar[str] = "m"
    point: str = eqx.field(static=True)
    curve: SampledPath

    def scale(self, mechanism):
        return play_size(mechanism)  # a distance has a kink at zero

    def value(self, time, y, mechanism, reference):
        return self.curve.distance(as_array(point_at(self.point, mechanism, time, y)))


class PathDeviation(AbstractSignal):
    """The distance of a named `point` from its ideal path [m]: from the nearest place of the whole curve that the ideal
    point follows from the start to the end of the motion, whenever it is there. A delay along the path does not count.

    The path is a cubic between `samples` places of the ideal point, at equal distances in time. The
    nearest chord between them says on which part of the curve to look, and halvings find the foot of the perpendicular
    on it. Where the ideal point rests throughout, it is the distance from this point.

    It is smooth but in three cases: where it is zero, where two parts of the path are equally near (a path that crosses
    itself), and where the path has a corner.

    **Raises:** `ClearanceError` where the samples are too few for this path (their cubic is off by more than a
    thousandth of the play); under a transformation, as in sweeps and designs, it is then not a number.
    """

    word: ClassVar[str] = "path-deviation"
    unit: ClassVar[str] = "m"
    point: str = eqx.field(static=True)
    samples: int = eqx.field(static=True, default=TABLE)
    needs_ideal: ClassVar[bool] = True

    def __check_init__(self):
        if self.samples < 3 or self.samples % 2 == 0:
            raise wrong_value("`samples` of a path", "an odd number, at least 3", self.samples, str(self.samples))

    def prepare(self, mechanism, t1, options):
        named_point(mechanism, self.point)  # an unknown name raises here
        curve = self._curve(mechanism, t1, options)
        if not isinstance(curve.known, Tracer) and not bool(curve.known):
            raise ClearanceError(
                f"The ideal path of `{self.point}` turns too often for {self.samples} samples: give `PathDeviation` "
                f"more `samples`, such as {10 * self.samples - 9}, or look at a shorter motion."
            ).about("samples", self.samples)
        return OnPath(self.point, curve)

    def value(self, time, y, mechanism, reference):
        raise ClearanceError("A path deviation is of a whole motion: `prepare` it by the mechanism and its span.")

    def _curve(self, mechanism: Mechanism, t1: Any, options: Settings) -> SampledPath:
        times, ideal = evenly(options.t0, t1, self.samples), mechanism.intended()
        if self.against_free(mechanism):
            y = self._freely(mechanism, t1, times, options)
        elif layout(ideal).free:
            settings = options._replace(save_at=times, y0=None, atol=None, energy_balance=False, fidelity=DYNAMICS)
            y = run(ideal, t1, settings).y
        else:
            y = jnp.zeros((self.samples, layout(ideal).size))
        ready, apart = ideal.prepare(), (t1 - options.t0) / (self.samples - 1)
        places, velocities = jax.vmap(lambda t, y: motion_of(self.point, ready, t, y))(times, y)
        moves = apart * velocities
        tolerance = OF_PLAY * play_size(mechanism) + OF_LENGTH * largest_length(mechanism)
        return SampledPath(places, moves, jax.lax.stop_gradient(_error(places, moves) <= tolerance))


def _error(places: Array, moves: Array) -> Scalar:
    """The largest error across the path of the cubics between samples [m]. Cubics over two intervals are compared with
    the samples in their middle; those over one interval have a 16th of that error, as it is of the fourth order.
    """
    middles = hermite(places[:-2:2], 2 * moves[:-2:2], places[2::2], 2 * moves[2::2], 0.5)
    off, way = places[1::2] - middles, moves[1::2]
    squares = jnp.sum(way * way, axis=1)
    along = jnp.sum(off * way, axis=1) / jnp.where(squares > 0, squares, 1.0)
    return jnp.max(jnp.sqrt(jnp.sum((off - along[:, None] * way) ** 2, axis=1))) / 16
