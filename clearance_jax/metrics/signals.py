"""Signals: scalar functions of time along a motion."""

import abc
import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax._compile.solo import solo_jit
from clearance_jax.dynamics.equations import balance
from clearance_jax.dynamics.field import slope
from clearance_jax.dynamics.kinematics import frames, relative_motions
from clearance_jax.dynamics.quantities import evaluate, quantities
from clearance_jax.dynamics.reactions import reactions
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.mechanism.tree.frame import Frame
from clearance_jax.metrics.functions import contact_index, in_words, index_of, named_point, numbers_of, refuse_gap
from clearance_jax.metrics.ideal import freedom, ideal_state
from clearance_jax.solve.settings import DYNAMICS, Settings, evenly
from clearance_jax.solve.simulate import run
from clearance_jax.solve.steps.interpolate import hermite
from clearance_jax.solve.steps.tolerances import largest_length
from clearance_jax.spatial import Vector, add, as_array, length_of, minus, rotation_between, subtract

# Samples of an ideal mechanism's free motion, to find peaks of an error with; their values are solved for exactly.
TABLE = 1001


class AbstractSignal(Module):
    """A signal: a scalar function of time, state and mechanism, in the unit `unit`."""

    word: ClassVar[str] = ""
    """What study files call it; empty: they do not know it."""
    unit: ClassVar[str] = ""
    needs_ideal: ClassVar[bool] = False

    @property
    def label(self) -> str:
        """What it is, in words: "position error"; by default after its class."""
        return in_words(type(self).__name__)

    def known(self, mechanism: AbstractMechanism) -> "AbstractSignal":
        """The signal with the unit that it has in a mechanism, for files and reports; by default it has one unit."""
        del mechanism
        return self

    @abc.abstractmethod
    def value(self, time: Scalar, y: Array, mechanism: PreparedMechanism, reference: Array | None) -> Scalar:
        """The signal of one state; `reference` is the ideal mechanism's state."""

    def scale(self, mechanism: PreparedMechanism) -> Scalar:
        """Magnitude by which its integral is controlled; infinite (default): its kinks are events, which end steps."""
        return jnp.asarray(jnp.inf)

    def of(self, times: Array, y: Array, mechanism: Mechanism, t1: Any, options: Settings) -> Array:
        """The signal of a motion's states at increasing times, shape (times,)."""
        ready = self.prepare(mechanism, t1, options)
        reference = self._freely(mechanism, t1, times, options) if ready.against_free(mechanism) else None
        return _along(ready, times, y, mechanism, reference)

    def bind(self, mechanism: Mechanism, t1: Any, options: Settings) -> Callable:
        """The signal as a function of (time, state, mechanism) alone, for an observer."""
        signal = self.prepare(mechanism, t1, options)
        if not signal.against_free(mechanism):
            return Instant(signal)
        times = evenly(options.t0, t1, TABLE)
        y = self._freely(mechanism, t1, times, options)
        ready = mechanism.intended().prepare()
        return Tabulated(signal, times, y, jax.vmap(lambda t, y: slope(t, y, ready))(times, y))

    def integrand(self, mechanism: Mechanism, t1: Any, options: Settings, power: int) -> "Integrand":
        """The signal to a power, to be integrated along with the motion."""
        signal = self.prepare(mechanism, t1, options)
        if signal.against_free(mechanism):
            raise ClearanceError(
                "An average of an error against an ideal mechanism that moves freely is not integrated along. Drive "
                "its joints, or average samples: `At(signal, times)`."
            )
        return Integrand(signal, power)

    def prepare(self, mechanism: Mechanism, t1: Any, options: Settings) -> "AbstractSignal":
        """The signal with what it needs of the whole ideal motion, by default nothing; not computed at every step."""
        del mechanism, t1, options
        return self

    def against_free(self, mechanism: Mechanism) -> bool:
        """Whether it refers to an ideal mechanism that moves freely."""
        return self.needs_ideal and freedom(mechanism.intended()) > 0

    def _reference(self, time, y, mechanism):
        return ideal_state(time, y, mechanism) if self.needs_ideal else None

    def _freely(self, mechanism, t1, times, options):
        """States at `times` of an ideal mechanism that moves freely, by its dynamics, from its own initial state."""
        if options.y0 is not None:
            raise ClearanceError(
                "An error against an ideal mechanism that moves freely cannot start from `y0`: where the ideal one "
                "starts is not known. Set the initial values of the mechanism's coordinates instead."
            ).about("y0")
        settings = options._replace(save_at=times, atol=None, energy_balance=False, fidelity=DYNAMICS)
        return run(mechanism.intended(), t1, settings).y


@solo_jit
def _along(signal: AbstractSignal, times: Array, y: Array, mechanism: Mechanism, reference: Array | None) -> Array:
    """A signal of states, shape (times,), in one program: else every operation would be compiled by itself."""
    ready = mechanism.prepare()
    if reference is not None:
        return jax.vmap(lambda t, y, r: signal.value(t, y, ready, r))(times, y, reference)
    return jax.vmap(lambda t, y: signal.value(t, y, ready, signal._reference(t, y, ready)))(times, y)


class Instant(Module):
    """A signal whose ideal reference, if any, follows from the state itself, as a function."""

    signal: AbstractSignal

    def __call__(self, time, y, mechanism):
        return self.signal.value(time, y, mechanism, self.signal._reference(time, y, mechanism))


class Tabulated(Module):
    """A signal whose ideal reference is interpolated (cubic Hermite), as a function."""

    signal: AbstractSignal
    times: Array
    y: Array
    slope: Array

    def __call__(self, time, y, mechanism):
        i = jnp.clip(jnp.searchsorted(self.times, time) - 1, 0, self.times.shape[0] - 2)
        h, ideal, slope = self.times[i + 1] - self.times[i], self.y, self.slope
        reference = hermite(ideal[i], h * slope[i], ideal[i + 1], h * slope[i + 1], (time - self.times[i]) / h)
        return self.signal.value(time, y, mechanism, reference)


class Integrand(Module):
    """A signal to a power, as a function."""

    signal: AbstractSignal
    power: int = eqx.field(static=True)

    def __call__(self, time, y, mechanism):
        return Instant(self.signal)(time, y, mechanism) ** self.power

    def scale(self, mechanism):
        """Magnitude of the integrand."""
        return self.signal.scale(mechanism) ** self.power


# Signals -------------------------------------------------------------------------------------------------------------


def play_size(mechanism: AbstractMechanism) -> Scalar:
    """The largest clearance [m]."""
    sizes = [joint.size for joint in mechanism.clearance_joints()]
    gaps = [gap for gap in mechanism.gaps if gap.what in ("backlash", "teeth")]
    sizes += [gap.size * (largest_length(mechanism) if gap.turns else 1.0) for gap in gaps]
    return jnp.max(jnp.stack(sizes)) if sizes else jnp.asarray(jnp.inf)


def frame_of(body: str, mechanism: PreparedMechanism, time, y) -> Frame:
    """The frame of a body in a state."""
    return frames(mechanism, time, layout(mechanism).split(y))[body]


def point_at(name: str, mechanism: PreparedMechanism, time, y) -> Vector:
    """The place of a named point in a state [m]."""
    point = named_point(mechanism, name)
    return frame_of(point.body, mechanism, time, y).point(point.at.vector)


def motion_of(name: str, mechanism: PreparedMechanism, time, y) -> tuple[Array, Array]:
    """Place [m] and velocity [m/s] of a named point in a state, shape (3,)."""
    point = named_point(mechanism, name)
    frame = frame_of(point.body, mechanism, time, y)
    place = frame.point(point.at.vector)
    return as_array(place), as_array(frame.velocity_at(place))


class PositionError(AbstractSignal):
    """The distance of a named `point` from where the ideal mechanism has it at the same time [m]."""

    word: ClassVar[str] = "position-error"
    unit: ClassVar[str] = "m"
    point: str = eqx.field(static=True)
    needs_ideal: ClassVar[bool] = True

    def scale(self, mechanism):
        return play_size(mechanism)  # a distance has a kink at zero

    def value(self, time, y, mechanism, reference):
        ideal = point_at(self.point, mechanism.intended(), time, reference)
        return length_of(subtract(point_at(self.point, mechanism, time, y), ideal))


class OrientationError(AbstractSignal):
    """The angle between a `body` and the same body of the ideal mechanism [rad], not negative. In space it is the angle
    of the rotation from the one to the other (at most half a turn). With an `axis` of the world ("x", "y" or "z") it is
    that component of the rotation vector.
    """

    word: ClassVar[str] = "orientation-error"
    unit: ClassVar[str] = "rad"
    body: str = eqx.field(static=True)
    axis: str | None = eqx.field(static=True, default=None)
    needs_ideal: ClassVar[bool] = True

    def scale(self, mechanism):
        return play_size(mechanism) / largest_length(mechanism)

    def value(self, time, y, mechanism, reference):
        index_of("body", self.body, [body.name for body in mechanism.bodies])
        here = frame_of(self.body, mechanism, time, y).rotation
        ideal = frame_of(self.body, mechanism.intended(), time, reference).rotation
        if here.is_plane and ideal.is_plane and self.axis is None:
            return jnp.abs(jnp.asarray(minus(here.angle, ideal.angle), float))
        off = rotation_between(ideal, here)
        if self.axis is None:
            return length_of(off)
        return jnp.asarray(off[index_of("axis", self.axis, ["x", "y", "z"])], float)


class ContactForce(AbstractSignal):
    """The normal contact force in a clearance `joint` [N]: the sum over all its contact points. Of the gap of a
    coordinate (`axis_drive`, `axis_stop`, the name of a coupling) it is the size of the effort of its flanks [N m], of
    a slide or of teeth [N].

    **Arguments:** `joint`: its name; `called`: the unit of the effort, which files and reports find out.
    """

    word: ClassVar[str] = "contact-force"
    joint: str = eqx.field(static=True)
    called: str = eqx.field(static=True, default="")

    @property
    def unit(self):  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.called or "N"

    @property
    def label(self):
        return "effort of the flanks" if self.called else "contact force"

    def known(self, mechanism):
        turns = next((gap.turns for gap in mechanism.gaps if gap.name == self.joint), None)
        return self if turns is None else dataclasses.replace(self, called="N m" if turns else "N")

    def value(self, time, y, mechanism, reference):
        index = contact_index(mechanism, self.joint)
        joint, at = mechanism.contacts()[index], relative_motions(time, y, mechanism)[index]
        return joint.clearance.act(at, layout(mechanism).split(y).memory.get(joint.name, ())).normal_force


class Acceleration(AbstractSignal):
    """The size of the acceleration of a named `point` [m/s^2]."""

    word: ClassVar[str] = "acceleration"
    unit: ClassVar[str] = "m/s^2"
    point: str = eqx.field(static=True)

    def value(self, time, y, mechanism, reference):
        point = named_point(mechanism, self.point)
        now = balance(mechanism, time, layout(mechanism).split(y))
        frame = now.motion[point.body]
        at = frame.point(point.at.vector)
        return length_of(add(frame.acceleration_at(at), now.motion.extra(now.acceleration).at(point.body, at)))


def _reaction(mechanism: PreparedMechanism, name: str, time, y):
    """Force and moment on the child in a joint of any kind."""
    refuse_gap(mechanism, name)
    index_of("joint", name, [joint.name for joint in mechanism.all_joints()])  # raises for another name
    mechanism = mechanism.at(time)
    return reactions(mechanism, balance(mechanism, time, layout(mechanism).split(y)), [name])[name]


class JointReaction(AbstractSignal):
    """The size of the force that a `joint` of any kind exerts on its child [N]. If a slide of the joint is driven or
    actuated, its effort is included.

    In an over-constrained loop this force is not determined: a condition that repeats others bears nothing here.
    """

    word: ClassVar[str] = "joint-reaction"
    unit: ClassVar[str] = "N"
    joint: str = eqx.field(static=True)

    def value(self, time, y, mechanism, reference):
        return length_of(_reaction(mechanism, self.joint, time, y).force)


class JointMoment(AbstractSignal):
    """The size of the moment that a `joint` of any kind exerts on its child, about the place of the joint on the child
    [N m]. If a turn of the joint is driven or actuated, its effort is included (in the plane this is the whole moment).
    For over-constrained loops see `JointReaction`.
    """

    word: ClassVar[str] = "joint-moment"
    unit: ClassVar[str] = "N m"
    joint: str = eqx.field(static=True)

    def value(self, time, y, mechanism, reference):
        return length_of(_reaction(mechanism, self.joint, time, y).moment)


class Quantity(AbstractSignal):
    """A number of the motion by its name, such as "crank.position" or "wrist.penetration": see `Solution.names`. It is
    in its SI unit. Work and losses since the start are none: ask for `EnergyLost`.

    **Arguments:** `quantity`: the name; `called`: the name of its unit, for files and datasets. **Raises:**
    `ClearanceError` for an unknown name, and for a quantity that is not a number.
    """

    word: ClassVar[str] = "quantity"
    quantity: str = eqx.field(static=True)
    called: str = eqx.field(static=True, default="")

    @property
    def unit(self):  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.called

    def known(self, mechanism):
        names = quantities(mechanism, energy_balance=False)
        return (
            self
            if self.called or self.quantity not in names
            else dataclasses.replace(self, called=names[self.quantity].unit)
        )

    def prepare(self, mechanism, t1, options):
        index_of("quantity", self.quantity, numbers_of(mechanism))
        return self

    def value(self, time, y, mechanism, reference):
        quantity = quantities(mechanism, energy_balance=False)[self.quantity]
        if quantity.place is not None:
            return jnp.asarray(y[quantity.place], float)
        # Without what is integrated along, which would be read as work and losses.
        return evaluate(quantity.variable, time, y[: layout(mechanism).size], mechanism)[quantity.index]
