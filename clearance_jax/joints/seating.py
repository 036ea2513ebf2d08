"""The place of rest of a pin that may tilt: where the contact, without friction, bears a given force and moment.

The load that a contact without friction bears is the gradient of its elastic energy, which is convex for small plays.
So the place minimises elastic energy plus the load's potential, and Newton's method with a line search finds it from
anywhere. A direction along which nothing presses and nothing resists stays as it is.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.numerics import without_derivatives
from clearance_jax._basis.small_matrices import small_eigh, small_inverse
from clearance_jax._basis.types import Flag, Scalar
from clearance_jax.joints._base import TOUCHING, PreparedClearance
from clearance_jax.joints.contact import PlayCoordinate, Relative
from clearance_jax.spatial import IDENTITY, ZERO, Rotation, Term, Vector, add, as_array, dot, scale, subtract, swing

# Iterations at most (some twenty are usual).
MOST = 200
# PARTS: the fractions of a step that the line search tries. LAST: how many iterations follow the search, without
# springs. Fewer of both are enough if Newton steps of all joints together follow (see `Near`).
PARTS, LAST = 0.5 ** np.arange(12), 5
FEWER_PARTS, FEWER_LAST = 0.5 ** np.array([0, 1, 3, 6]), 1
# The search begins with a load that presses the pin to a depth of WIDE plays. When the residual is below the part NEAR
# of the load, the load is divided by LESS, until it is the real one.
WIDE, LESS, NEAR = 0.3, 8.0, 0.1
# Residuals in parts of the load. A search ends below ROUND_OFF, or below SOLVED if a step no longer helps. A search
# that begins near its end stops at ALMOST: the iterations without springs do the rest.
ROUND_OFF, SOLVED, ALMOST = 1e-14, 1e-9, 1e-6
# Springs that the search adds: stiffness as force over play. LOOSE, of the whole load: along coordinates without a
# load. PRESSED, of the load along the coordinate: along the others.
LOOSE, PRESSED = 1e-4, 1e-6
# `Turned` changes a load up to this distance only, in sizes of the play: from wall to wall. Otherwise a pin in a sleeve
# far too soft could turn over and rest upside down.
ACROSS = 2.0

Values = Float[Array, " play"]


def size_of(play: Sequence[PlayCoordinate]) -> Values:
    """The magnitudes of play coordinates [m or rad]."""
    return as_array([c.scale for c in play])


class PinPose(NamedTuple):
    """A pin's pose in its sleeve's axes: place [m], rotation, and the pin's velocity or spin by each rate of play."""

    place: Vector
    rotation: Rotation
    axes: tuple[Vector, ...]


def pose_at(play: Sequence[PlayCoordinate], values: Sequence[Term] | Values) -> PinPose:
    """The pose at given `values` (play,) of the coordinates of the `play` [m or rad]."""
    place, rotation, axes = ZERO, IDENTITY, []
    tilts = [k for k, coordinate in enumerate(play) if coordinate.swings]
    for k, coordinate in enumerate(play):
        if coordinate.swings:
            if k == tilts[0]:
                swung = swing(*(play[i].turns or ZERO for i in tilts), *(values[i] for i in tilts))
                axes += [rotation.apply(axis) for axis in swung.outside]
                rotation = rotation.compose(swung.rows)
        elif coordinate.turns is None:
            assert coordinate.slides is not None
            axes.append(rotation.apply(coordinate.slides))
            place = add(place, scale(values[k], axes[-1]))
        else:
            axes.append(rotation.apply(coordinate.turns))
            rotation = rotation.turn(coordinate.turns, values[k])
    return PinPose(place, rotation, tuple(axes))


class SeatLoad(NamedTuple):
    """Force [N] and moment about the pin's centre [N m] that the sleeve must exert, in its axes."""

    force: Vector
    moment: Vector

    def along(self, play: Sequence[PlayCoordinate], axes: tuple[Vector, ...]) -> Values:
        """Its part along each play coordinate [N or N m]."""
        kinds = (self.force if c.turns is None else self.moment for c in play)
        return as_array([dot(kind, axis) for kind, axis in zip(kinds, axes, strict=True)])

    def plus(self, other: "SeatLoad") -> "SeatLoad":
        """The sum of both."""
        return SeatLoad(add(self.force, other.force), add(self.moment, other.moment))

    def less(self, other: "SeatLoad") -> "SeatLoad":
        """The difference of both."""
        return SeatLoad(subtract(self.force, other.force), subtract(self.moment, other.moment))


class Turned(NamedTuple):
    """First-order change of a load as its own pin moves: `force` (3, play) and `moment` (3, play) per unit of a play
    coordinate, from the place `at` (play,) [m or rad] for which the load was computed.

    A weight that hangs straight below its sleeve bears no moment: its moment passes through zero inside the play, and a
    search with a constant moment would leap from wall to wall.
    """

    force: Float[Array, "3 play"]
    moment: Float[Array, "3 play"]
    at: Values

    def load(self, values: Values, size: Values) -> SeatLoad:
        """The change of the load at `values` (play,) of the play coordinates, whose `size` is their play (play,)."""
        moved = size * jnp.clip((values - self.at) / size, -ACROSS, ACROSS)
        return SeatLoad(tuple(self.force @ moved), tuple(self.moment @ moved))


class FreeMotion(NamedTuple):
    """The motion of a pin in its free directions, in the sleeve's axes: sliding [m/s], and `spin` [rad/s]."""

    velocity: Vector
    spin: Vector


def relative_at(play: Sequence[PlayCoordinate], values: Values, free: FreeMotion | None = None) -> Relative:
    """The relative motion of a pin at `values` (play,) of its `play` [m or rad]; `free`: its other motion."""
    at, zero = pose_at(play, values), jnp.zeros(())
    rows = None if all(c.turns is None for c in play) else at.rotation.rows
    free = FreeMotion((zero, zero, zero), (zero, zero, zero)) if free is None else free
    return Relative(at.place, 0.0, free.velocity, free.spin, rows)


class Seat(NamedTuple):
    """The place of rest of a pin.

    - `play` (play,): values of the play coordinates [m or rad]; `presses`: whether the load presses the pin to a wall
      at all.
    - `left`: the part of the load that the joint does not bear there. If it is not nearly zero, the search found no
      rest.
    - `stiffness` [J]: of the joint there, for play in units of its size (without derivatives).
    """

    play: Values
    presses: Flag
    left: Scalar
    stiffness: Array


class Near(NamedTuple):
    """A guess of the `place` of rest [m or rad], used if `known`. Newton steps of all joints follow a search."""

    place: Values
    known: Flag


def seat(
    clearance: PreparedClearance, load: SeatLoad, start: Values, near: Near | None = None, turned: Turned | None = None
) -> Seat:
    """The play at which the joint, without friction, exerts a given load on its pin; twice differentiable by the
    numbers of the joint and the load, by the last two Newton steps.

    **Arguments:** `clearance`: the joint; `load`; `start` (play,): where the search begins [m or rad]. A coordinate
    that nothing resists stays there. `turned`: how the load changes as the pin moves (`None`: it does not).
    """
    smooth = clearance.without_friction()
    still, begun, slope = without_derivatives(((smooth, load), start, turned))
    size = size_of(still[0].joint.play())
    whole = Seating(*still, size, jnp.ones(len(size), bool), begun / size, turned=slope)
    search = whole._replace(counts=whole.more_than_round_off())
    near = None if near is None else near._replace(place=jax.lax.stop_gradient(near.place) / size)
    x, inverse, loose, stiffness = search.rest(search.find(near), LAST if near is None else FEWER_LAST)
    # Zero, but with a derivative: along coordinates that nothing resists the pin stays at the start.
    x = x + loose @ ((start - begun) / size)
    differentiated = search._replace(clearance=smooth, load=load, turned=turned)

    def once(_, carry):
        left = differentiated.residual(carry[0])
        return carry[0] - inverse @ left, jax.lax.stop_gradient(left)

    x, left = jax.lax.fori_loop(0, 2, once, (x, jnp.zeros_like(x)))
    # A tilted pin's edge may press along a coordinate without a load: this does not count as an error.
    asked, left = (jnp.linalg.norm(jnp.where(search.counts, part, 0.0)) for part in (search.asked, left))
    left = jnp.where(asked > 0, left / jnp.where(asked > 0, asked, 1.0), 0.0)
    return Seat(size * x, jnp.any(search.counts), left, 0.5 * (stiffness + stiffness.T))


class Seating(NamedTuple):
    """The problem: a pin, the load that it must bear, the `size` of its play, which parts of the load `counts`, the
    `start`, its motion in `free` directions (`None`: none), and how the load is `turned` as the pin moves (`None`:
    not). The unknowns x are the play in units of its size; forces and moments have the same units [J].
    """

    clearance: PreparedClearance
    load: SeatLoad
    size: Values
    counts: Array
    start: Values
    free: FreeMotion | None = None
    turned: Turned | None = None

    def residual(self, x: Values, factor: Scalar | float = 1.0) -> Values:
        """The residual of equilibrium: `factor` times the load, less what the joint bears."""
        play, values = self.clearance.joint.play(), self.size * x
        axes = pose_at(play, values).axes
        action = self.clearance.act(relative_at(play, values, self.free), self.clearance.blank)
        borne = SeatLoad(action.force, action.torque).along(play, axes)
        load = self.load if self.turned is None else self.load.plus(self.turned.load(values, self.size))
        return self.size * (jnp.where(self.counts, factor * load.along(play, axes), 0.0) - borne)

    @property
    def asked(self) -> Values:
        """The size of the load along each coordinate, at the middle."""
        return jnp.where(self.counts, self._along(self.load, 0 * self.size), 0.0)

    @property
    def most(self) -> Values:
        """Size of the load by coordinate, in the middle (a tilted pin's may be 0) or at `turned.at`: the larger."""
        if self.turned is None:
            return self.asked
        return jnp.maximum(self.asked, jnp.where(self.counts, self._along(self.load, self.turned.at), 0.0))

    def _along(self, load: SeatLoad, values: Values) -> Values:
        """The sizes of a load's parts along each coordinate, at values of these."""
        play = self.clearance.joint.play()
        return jnp.abs(self.size * load.along(play, pose_at(play, values).axes))

    @property
    def springs(self) -> Values:
        """Stiffnesses of the added springs: softer than contacts, they hold at the start what nothing else holds."""
        return jnp.where(self.counts, PRESSED * self.most, LOOSE * jnp.linalg.norm(self.asked))

    def wall(self, depth: float) -> Array:
        """What the joint bears along its first slide at a `depth` beyond its wall, in plays. With a stiff element,
        which bears before the wall does, the depth is from the middle.
        """
        element = self.clearance.joint.element
        free = 0 if element is not None and element.stiff else 1
        return jnp.abs(self.residual((free + depth) * jnp.eye(len(self.size))[0], 0.0)[0])

    def more_than_round_off(self) -> Array:
        """Which components of the load exceed round-off, that of the largest one and that of a wall's force."""
        most = self.most
        return (most > TOUCHING * jnp.max(most)) & (most > self.wall(TOUCHING))

    def find(self, near: Near | None = None) -> Values:
        """The minimum of energy and springs. With stiff walls it lies in a narrow, curved valley, which a larger load
        widens: the search begins with such a load and reduces it. A search from `near` begins with the real load.
        """
        springs, whole = self.springs, jnp.linalg.norm(self.asked)
        parts = jnp.asarray(PARTS if near is None else FEWER_PARTS)

        def residual(x, factor):
            return self.residual(x, factor) + factor * springs * (x - self.start)

        def once(carry):
            x, factor, count, _ = carry
            (g, slope), asked = value_and_jacobian(lambda x: residual(x, factor), x), factor * whole
            stiff, ways = small_eigh(0.5 * (slope + slope.T))
            step = -ways @ jnp.clip((ways.T @ g) / jnp.maximum(stiff, PRESSED * TOUCHING * asked), -1.0, 1.0)
            further = jax.vmap(lambda part: residual(x + part * step, factor))(parts)
            # The largest part of the step after which the energy rises at most half as steeply as it fell at first.
            good = (further @ step) <= 0.5 * jnp.abs(g @ step)
            part = jnp.where(jnp.any(good), jnp.argmax(good), len(parts) - 1)
            before, after = jnp.linalg.norm(g), jnp.linalg.norm(further[part])
            stuck = (after > 0.5 * before) & (before < SOLVED * asked)
            x = jnp.where(stuck, x, x + parts[part] * step)
            done = (factor <= 1) & (stuck | (after <= enough * asked))
            return x, jnp.where(after < NEAR * asked, jnp.maximum(1.0, factor / LESS), factor), count + 1, done

        widest = self.wall(WIDE) / jnp.where(whole > 0, whole, 1.0)
        x, factor, enough = self.start, jnp.maximum(1.0, widest), ROUND_OFF
        if near is not None:
            enough = jnp.where(near.known, ALMOST, ROUND_OFF)
            x, factor = jnp.where(near.known, near.place, x), jnp.where(near.known, 1.0, factor)
        begin = x, factor, jnp.asarray(0), whole <= 0
        return jax.lax.while_loop(lambda carry: ~carry[3] & (carry[2] < MOST), once, begin)[0]

    def rest(self, x: Values, iterations: int) -> tuple[Values, Array, Array, Array]:
        """The equilibrium without springs: solved along directions that contacts hold more firmly than springs, at the
        start along the others. Also the inverse of the slope, the projection on the others, and the slope.
        """

        def once(_, carry):
            x, g, slope = carry[0], *value_and_jacobian(self.residual, carry[0])
            inverse, loose = self._held(slope, slope)
            return x - inverse @ g - loose @ (x - self.start), inverse, loose, slope

        nothing = jnp.zeros((len(x), len(x)))
        return jax.lax.fori_loop(0, iterations, once, (x, nothing, nothing, nothing))

    def inverse(self, x: Values) -> Array:
        """The inverse of the slope of the residual, friction included; zero along what contacts do not hold."""
        slope = value_and_jacobian(self.residual, x)[1]
        smooth = self._replace(clearance=self.clearance.without_friction())
        stiff = slope if self.clearance.friction is None else value_and_jacobian(smooth.residual, x)[1]
        return self._held(slope, stiff)[0]

    def _held(self, slope: Array, stiffness: Array) -> tuple[Array, Array]:
        """The inverse of a slope along what contacts hold more firmly than springs; the projection on the others."""
        stiff, ways = small_eigh(0.5 * (stiffness + stiffness.T))
        holds = stiff > (ways**2).T @ self.springs
        both = holds[:, None] & holds[None, :]
        inverse = small_inverse(jnp.where(both, ways.T @ slope @ ways, jnp.eye(len(stiff))))
        return ways @ jnp.where(both, inverse, 0.0) @ ways.T, ways @ jnp.where(holds[:, None], 0.0, ways.T)


def stiffness_at(clearance: PreparedClearance, place: Values) -> Array:
    """The stiffness of a joint without friction and load at a place (play,), for play in units of its size [J];
    constant.
    """
    smooth, size = clearance.without_friction(), size_of(clearance.joint.play())
    joint, at, size = without_derivatives((smooth, place, size))
    free = Seating(joint, SeatLoad(ZERO, ZERO), size, jnp.zeros(len(size), bool), at)
    return value_and_jacobian(free.residual, at / size)[1]


def held_stiffness(clearance: PreparedClearance, place: Values, load: SeatLoad) -> Array:
    """`stiffness_at` where the pin bears a `load`; zero along what contacts hold less firmly than springs."""
    smooth, size = clearance.without_friction(), size_of(clearance.joint.play())
    still = without_derivatives((smooth, load, size))
    pin = Seating(*still, jnp.ones(len(size), bool), jax.lax.stop_gradient(place) / still[2])
    pin = pin._replace(counts=pin.more_than_round_off())
    slope = value_and_jacobian(pin.residual, pin.start)[1]
    stiff, ways = small_eigh(0.5 * (slope + slope.T))
    firm = jnp.where(jnp.abs(stiff) > (ways**2).T @ pin.springs, stiff, 0.0)
    return (ways * firm[None, :]) @ ways.T


def value_and_jacobian(function: Callable[[Values], Values], x: Values) -> tuple[Values, Array]:
    """A function's value and Jacobian."""
    slope, value = jax.jacfwd(lambda x: (function(x),) * 2, has_aux=True)(x)
    return value, slope
