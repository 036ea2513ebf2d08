"""Signals: what of a motion is looked at as a function of time."""

import abc
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._numerics import safe_norm
from clearance_jax._types import Scalar
from clearance_jax.dynamics.equations import projected
from clearance_jax.dynamics.field import observe, rate
from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.mechanism.mechanism import Mechanism, frames, layout
from clearance_jax.solve.flow import Solution
from clearance_jax.solve.interpolate import hermite
from clearance_jax.solve.simulate import solve
from clearance_jax.solve.tolerances import largest_length
from clearance_jax.spatial import minus

# Newton steps from a pin's place in its sleeve to the ideal mechanism: each squares the error, some 1e-3 at first.
ASSEMBLE = 4


class AbstractSignal(eqx.Module):
    """A scalar function of time, state and mechanism, in `unit`; names are static."""

    unit: ClassVar[str] = ""
    needs_ideal: ClassVar[bool] = False

    @abc.abstractmethod
    def value(self, time: Scalar, y: Array, mechanism: Mechanism, reference: Array | None) -> Scalar:
        """The signal of one state; `reference` is the ideal mechanism's state."""

    def along(self, mechanism: Mechanism, t1: Any, times: Float[Array, " times"], **options: Any) -> Array:
        """The signal at the given times [s], shape (times,)."""
        solution = solve(mechanism, t1, save_at=times, **options)
        return self.of(solution, times, solution.y, mechanism, t1, **options)

    def of(self, solution: Solution, times: Array, y: Array, mechanism: Mechanism, t1: Any, **options: Any) -> Array:
        """The signal of a solution's states at increasing times, shape (times,)."""
        # Signals forgive a NaN (a norm of NaN is 0): a failed lane is marked once more, on the signal itself.
        factor = jnp.where(solution.succeeded, 1.0, jnp.nan)
        ready = mechanism.prepared()
        if self.needs_ideal and freedom(mechanism.ideal()) > 0:
            reference = self._freely(mechanism, t1, times, options)
            return factor * jax.vmap(lambda t, y, r: self.value(t, y, ready, r))(times, y, reference)
        return factor * jax.vmap(lambda t, y: self.value(t, y, ready, self._reference(t, y, ready)))(times, y)

    def scale(self, mechanism: Mechanism) -> Scalar:
        """Magnitude of the signal, where an integral of it must itself be watched; infinite (the default): its kinks,
        if any, are the laws' switches, at which steps end anyway.
        """
        return jnp.asarray(jnp.inf)

    def _reference(self, time, y, mechanism):
        return ideal_state(time, y, mechanism) if self.needs_ideal else None

    def _freely(self, mechanism, t1, times, options):
        """States of an ideal mechanism that moves freely; from its own initial state, for it has no other."""
        if options.get("y0") is not None:
            raise ClearanceError(
                "An error against an ideal mechanism that moves freely cannot start from `y0`: where the ideal one "
                "starts is not known. Set the initial values of the mechanism's coordinates instead."
            )
        return solve(mechanism.ideal(), t1, save_at=times, **options).y

    def bound(self, mechanism: Mechanism, t1: Any, **options: Any) -> Callable:
        """The signal as a function of (time, state, mechanism) alone, for an observer."""
        if not self.needs_ideal or freedom(mechanism.ideal()) == 0:
            return Instant(self)
        t0 = options.get("t0", 0.0)
        times = t0 + (t1 - t0) * jnp.linspace(0.0, 1.0, TABLE)
        y = self._freely(mechanism, t1, times, options)
        ready = mechanism.ideal().prepared()
        return Tabulated(self, times, y, jax.vmap(lambda t, y: rate(t, y, ready))(times, y))

    def integral(self, mechanism: Mechanism, t1: Any, power: int, **options: Any) -> Scalar:
        """The time integral of a power of the signal."""
        if self.needs_ideal and freedom(mechanism.ideal()) > 0:
            raise ClearanceError(
                "An average of an error against an ideal mechanism that moves freely is not integrated along. Drive "
                "its joints, or average samples: `At(signal, times)`."
            )
        return solve(mechanism, t1, integrands=(Integrand(self, power),), **options).final[-1]


# Samples of an ideal mechanism's free motion, to find peaks of an error with; their values are solved for exactly.
TABLE = 1001


class Instant(eqx.Module):
    """A signal whose ideal reference, if any, follows from the state itself."""

    signal: AbstractSignal

    def __call__(self, time, y, mechanism):
        return self.signal.value(time, y, mechanism, self.signal._reference(time, y, mechanism))


class Tabulated(eqx.Module):
    """A signal whose ideal reference is interpolated (cubic Hermite)."""

    signal: AbstractSignal
    times: Array
    y: Array
    slope: Array

    def __call__(self, time, y, mechanism):
        i = jnp.clip(jnp.searchsorted(self.times, time) - 1, 0, self.times.shape[0] - 2)
        h = self.times[i + 1] - self.times[i]
        reference = hermite(
            self.y[i], h * self.slope[i], self.y[i + 1], h * self.slope[i + 1], (time - self.times[i]) / h
        )
        return self.signal.value(time, y, mechanism, reference)


class Integrand(eqx.Module):
    """A power of a signal."""

    signal: AbstractSignal
    power: int = eqx.field(static=True)

    def __call__(self, time, y, mechanism):
        return Instant(self.signal)(time, y, mechanism) ** self.power

    def scale(self, mechanism):
        return self.signal.scale(mechanism) ** self.power


def freedom(mechanism: Mechanism) -> int:
    """How many coordinates drives and closures leave free."""
    left = layout(mechanism).free - 2 * len(mechanism.closures())
    if left < 0:
        raise ClearanceError(
            "Without its clearances this mechanism is over-constrained: its loops demand more than its joints can "
            "give. For an error against the ideal mechanism free more coordinates."
        )
    return left


def ideal_state(time: Scalar, y: Array, mechanism: Mechanism) -> Array:
    """The state of the ideal mechanism, where drives and closures determine it: the actual one's, loops closed."""
    ideal = mechanism.ideal()
    plan, own = layout(mechanism), layout(ideal)
    if own.free == 0:
        return jnp.zeros(0)
    where = [plan.names.index(name) for name in own.names]
    guess = jnp.stack([*(y[i] for i in where), *(y[plan.free + i] for i in where)])
    return projected(time, guess, ideal, ideal.closures(), ASSEMBLE)


# Signals -------------------------------------------------------------------------------------------------------------


def play_size(mechanism: Mechanism) -> Scalar:
    """The largest clearance [m]."""
    sizes = [joint.clearance.radial_clearance for joint in mechanism.clearance_joints() if joint.clearance]
    return jnp.max(jnp.stack(sizes)) if sizes else jnp.asarray(jnp.inf)


def _point(mechanism: Mechanism, name: str) -> int:
    names = [point.name for point in mechanism.points]
    if name not in names:
        raise ClearanceError(f"There is no point `{name}`. " + suggest(name, names))
    return names.index(name)


def _deviation(signal, time, y, mechanism, reference):
    """Actual minus ideal place of a point, and the ideal velocity."""
    i = _point(mechanism, signal.point)
    here = observe(time, y, mechanism)["position"][i]
    ideal = observe(time, reference, mechanism.ideal())
    return here - ideal["position"][i], ideal["velocity"][i]


class PositionError(AbstractSignal):
    """Distance of a named point from where the ideal mechanism has it at the same time [m]."""

    unit: ClassVar[str] = "m"
    point: str = eqx.field(static=True)
    needs_ideal: ClassVar[bool] = True

    def scale(self, mechanism):
        return play_size(mechanism)  # a distance has a kink at zero

    def value(self, time, y, mechanism, reference):
        off, _ = _deviation(self, time, y, mechanism, reference)
        return safe_norm(off[0], off[1])


class PathDeviation(AbstractSignal):
    """Distance of a named point from its ideal path, measured normal to it at the ideal place [m]; the distance itself
    where the ideal point stands still.
    """

    unit: ClassVar[str] = "m"
    point: str = eqx.field(static=True)
    needs_ideal: ClassVar[bool] = True

    def scale(self, mechanism):
        return play_size(mechanism)

    def value(self, time, y, mechanism, reference):
        off, velocity = _deviation(self, time, y, mechanism, reference)
        speed = safe_norm(velocity[0], velocity[1])
        normal = (off[1] * velocity[0] - off[0] * velocity[1]) / jnp.where(speed > 0, speed, 1.0)
        return jnp.where(speed > 0, jnp.abs(normal), safe_norm(off[0], off[1]))


class OrientationError(AbstractSignal):
    """Angle between a body and the ideal mechanism's [rad], not negative."""

    unit: ClassVar[str] = "rad"
    body: str = eqx.field(static=True)
    needs_ideal: ClassVar[bool] = True

    def scale(self, mechanism):
        return play_size(mechanism) / largest_length(mechanism)

    def value(self, time, y, mechanism, reference):
        names = [body.name for body in mechanism.bodies]
        if self.body not in names:
            raise ClearanceError(f"There is no body `{self.body}`. " + suggest(self.body, names))
        here = frames(mechanism, time, y)[self.body].angle
        return jnp.abs(jnp.asarray(minus(here, frames(mechanism.ideal(), time, reference)[self.body].angle), float))


class ContactForce(AbstractSignal):
    """Normal contact force in a clearance joint [N]."""

    unit: ClassVar[str] = "N"
    joint: str = eqx.field(static=True)

    def value(self, time, y, mechanism, reference):
        names = [joint.name for joint in mechanism.clearance_joints()]
        if self.joint not in names:
            raise ClearanceError(f"There is no clearance joint `{self.joint}`. " + suggest(self.joint, names))
        return observe(time, y, mechanism)["contact_force"][names.index(self.joint)]


class Acceleration(AbstractSignal):
    """Magnitude of a named point's acceleration [m/s^2]."""

    unit: ClassVar[str] = "m/s^2"
    point: str = eqx.field(static=True)

    def value(self, time, y, mechanism, reference):
        a = observe(time, y, mechanism)["acceleration"][_point(mechanism, self.point)]
        return safe_norm(a[0], a[1])
