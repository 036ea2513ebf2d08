"""Actuators: forces along free coordinates, all the time or sampled at whole multiples of a period."""

import abc
import dataclasses
import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Flag, Scalar
from clearance_jax.errors import ClearanceError, quote
from clearance_jax.joints.gap import Pressing, Rub
from clearance_jax.laws import AbstractFrictionLaw, TanhCoulomb
from clearance_jax.laws.normal.flank import Flank
from clearance_jax.mechanism.motion.motion_laws import AbstractMotionLaw, Values
from clearance_jax.parameters import Demand, Parametrised, describe, flatten, physical
from clearance_jax.spatial import Term

__all__ = ["AbstractActuator", "ConstantEffort", "JointFriction", "JointSpring", "Servo"]


# A step that begins at an instant starts 4 eps past it (`solve.steps.control.past_break`): 16 eps include that.
_HAIR = 16 * float(np.finfo(np.float64).eps)


def period_key():
    """The field of a sampling period [s]."""
    about = {"help": "period at which it measures anew; it holds its force in between", "example": '"1 ms"'}
    about |= {"absent": "it acts all the time", "unit": "s", "above": 0.0}
    return eqx.field(static=True, default=None, metadata=about)


def names_key(help: str, absent: str):
    """A field that names coordinates; one name stands for a tuple of one."""

    def names(given: Any) -> tuple[str, ...]:
        return (given,) if isinstance(given, str) else tuple(given)

    return describe(help, '["motor", "link"]', absent, static=True, default=(), converter=names)


def check_period(period: Any, what: str) -> None:
    """Raise unless a period [s] is a plain number greater than zero."""
    if period is not None and not (isinstance(period, (int, float)) and 0 < period < math.inf):
        raise ClearanceError(
            f"{what} must have a `period` greater than zero, a number in s that nothing is differentiated by, but it "
            f"is {quote(period)}."
        )


def instants(period: float, time: Scalar) -> Array:
    """The sampling times around a time: the last one and the next two."""
    return (jnp.floor(time / period) + np.arange(3.0)) * period


def is_instant(period: float, time: Scalar) -> Flag:
    """Whether a step that starts at a time starts at a sampling instant."""
    return jnp.abs(time - period * jnp.round(time / period)) <= _HAIR * jnp.abs(time)


# The speed [rad/s or m/s] at which friction turns round by default: slow against that of most joints.
SLOW = 0.01


class AbstractActuator(Module):
    """A force along one free coordinate: a torque [N m] along an angle, a force [N] along a slide."""

    name: str | None = eqx.field(static=True, default=None, kw_only=True)
    """By keyword. Its numbers are then called `hip.actuator.NAME.stiffness`, say, else by its place among the actuators
    of the coordinate, `hip.0.stiffness`.
    """

    @abc.abstractmethod
    def __call__(self, time: Scalar, position: Scalar, velocity: Scalar) -> Scalar:
        """The force [N] or torque [N m], by the position and velocity that it measures."""

    def losses(self, velocity: Scalar) -> tuple[Term, Term]:
        """The power lost in damping and in friction [W], for the coordinate's velocity. The energy balance counts the
        rest of the actuator's power as work; by default all of it.
        """
        del velocity
        return 0.0, 0.0

    def prepare(self) -> "AbstractActuator":
        """The actuator with what depends only on its numbers computed (once a solve)."""
        return self

    def breaks(self) -> Values:
        """Times at which the force or a derivative of it jumps: integration steps end there. None by default."""
        return jnp.zeros(0)

    def measures(self) -> tuple[str, ...]:
        """The coordinates whose sum it measures; none: the one that it acts on."""
        return ()

    def measures_rate(self) -> tuple[str, ...]:
        """The coordinates the sum of whose rates it measures; by default those of `measures`."""
        return self.measures()

    @property
    def integrates(self) -> bool:
        """Whether the integral of its `error` over time, since the solve started, adds to its force."""
        return False

    def error(self, time: Scalar, position: Scalar) -> Scalar:
        """What it integrates, by the position that it measures."""
        raise NotImplementedError(f"{type(self).__name__} integrates nothing.")

    def from_integral(self, integral: Scalar) -> Scalar:
        """The part of its force [N] or torque [N m] that comes from the integral."""
        raise NotImplementedError(f"{type(self).__name__} integrates nothing.")

    def sampling_period(self) -> float | None:
        """The period [s] at whose multiples it measures, holding its force in between; `None`: it acts continuously."""
        return None

    def without_sampling(self) -> "AbstractActuator":
        """The same without sampling, and without its integral: as it acts where a solve starts."""
        return self


class ConstantEffort(AbstractActuator):
    """A constant torque [N m] (or force [N] on a sliding joint)."""

    effort: Scalar = physical("effort", "torque (force on a sliding joint)", '"-12 N*m"')

    def __call__(self, time, position, velocity):
        return self.effort + 0 * position


class Servo(AbstractActuator):
    """A linear position servo (PD control): k (target - q) + b (target' - q'), with `integral` (PID control) also Ki
    times the integral of (target - q) over time.

    **Arguments:**

    - `target`: a drive.
    - `stiffness` k [N m/rad] and `damping` b [N m s/rad], at least 0; of a slide [N/m] and [N s/m].
    - `encoder`: names of the coordinates whose sum is q. By default q is the coordinate that the servo moves. If a
      motor turns its link through a gear with play or a spring, the encoder may be on the link: `("motor", "link")`.
    - `rate_encoder`: names of the coordinates the sum of whose rates is q'; by default those of `encoder`. A servo that
      sees the link's place and the motor's speed is stable behind a spring or a gap where one that sees the link alone
      is not.
    - `integral` Ki [N m/(rad s)], of a slide [N/(m s)]. The integral is a state of the motion. It is 0 where a solve
      starts, also in a settled start; it goes on where a solve goes on from the state of another one (`y0`).
    - `period` [s]: of a digital servo. It measures at whole multiples of the period, and holds its force between them
      (zero-order hold). The period is a fixed number of the program: you cannot differentiate by it.
    """

    target: AbstractMotionLaw
    stiffness: Scalar = physical("effort/coordinate", "gain k of the position error", '"50 N*m/rad"', least=0.0)
    damping: Scalar = physical("effort*s/coordinate", "gain b of the speed error", '"5 N*m*s/rad"', least=0.0)
    encoder: tuple[str, ...] = names_key("coordinates whose sum it measures", "its own")
    period: float | None = period_key()
    rate_encoder: tuple[str, ...] = names_key("coordinates the sum of whose rates it measures", "those of `encoder`")
    integral: Scalar | None = physical(
        "effort/(coordinate*s)", "gain Ki of the position error's integral", '"500 N*m/(rad*s)"', "no integral action",
        least=0.0, default=None,
    )  # fmt: skip

    def __check_init__(self):
        check_period(self.period, "A servo")
        if self.period is not None and self.integral is not None:
            text = "A digital servo (`period`) has no `integral`: it would be a sum over its samples. Leave one out."
            raise ClearanceError(text).about("integral")

    def __call__(self, time, position, velocity):
        goal, goal_rate, _ = self.target(time)
        return self.stiffness * (goal - position) + self.damping * (goal_rate - velocity)

    @property
    def integrates(self):
        return self.integral is not None

    def error(self, time, position):
        return self.target(time)[0] - position

    def from_integral(self, integral):
        assert self.integral is not None
        return self.integral * integral

    def prepare(self):
        return dataclasses.replace(self, target=self.target.prepare())

    def breaks(self):
        return self.target.breaks()

    def measures(self):
        return self.encoder

    def measures_rate(self):
        return self.rate_encoder or self.encoder

    def sampling_period(self):
        return self.period

    def without_sampling(self):
        return dataclasses.replace(self, period=None, integral=None)


class JointSpring(AbstractActuator):
    """A spring and a damper in a joint: -k (q - q0) - b q'. The energy balance counts the work of the spring as that of
    actuators, and what the damper takes as a damping loss.
    """

    stiffness: Scalar = physical("effort/coordinate", "stiffness k", '"50 N*m/rad"', least=0.0)
    damping: Scalar = physical("effort*s/coordinate", "damping b", '"0.1 N*m*s/rad"', least=0.0, default=0.0)
    rest: Scalar = physical("coordinate", "coordinate q0 at which the spring is relaxed", '"10 deg"', default=0.0)

    def __call__(self, time, position, velocity):
        return -self.stiffness * (position - self.rest) - self.damping * velocity

    def losses(self, velocity):
        return self.damping * velocity**2, 0.0


class Wave(Module):
    """A transmission error: the motor turns its link by A sin(n q_motor + p) too far.

    **Arguments:** `error` A [rad], of a slide [m]; `error_order` n [1/rad], or [1/m]: of one error in a turn of the
    motor the ratio of the gear, as q_motor is seen from the link; `error_phase` p [rad].
    """

    error: Scalar = physical("coordinate", "amplitude A of the transmission error", '"0.5 arcmin"', "none")
    error_order: Scalar = physical("1/coordinate", "its waves in a radian of the motor", '"100 1/rad"')
    error_phase: Scalar = physical("rad", "its phase where the motor is at 0", '"90 deg"', default=0.0)


class DriveLoss(Parametrised):
    """Friction of a drive's gear under its load: (1 - eta) |T| tanh(w / w_t) against the motor, of the effort T that it
    passes on and the motor's speed w.

    **Arguments:** `efficiency` eta; `efficiency_speed` w_t [rad/s], of a slide [m/s]; all as seen from the link.
    """

    efficiency: Scalar = physical("", "efficiency eta of its gear, at most 1", "0.85", "no loss", above=0.0)
    efficiency_speed: Scalar = physical(
        "coordinate/s", "speed of the motor at which the loss turns round", '"0.01 rad/s"', above=0.0, default=SLOW
    )

    def demands(self):
        yield Demand("efficiency", self.efficiency <= 1, lambda: "must be at most 1")

    def effort(self, passed: Scalar, speed: Scalar) -> Scalar:
        """The friction on the motor, against its `speed`, for an effort that is `passed` on."""
        return (1.0 - self.efficiency) * jnp.abs(passed) * jnp.tanh(speed / self.efficiency_speed)


class DriveSpring(AbstractActuator):
    """The spring and damper of a drive: -T_e(q - q0) - c q', with the effort and the damping of its `flank`. A settled
    start is deflected by the load that it bears.

    With `backlash`, the width of the whole gap [rad], of a slide [m], it does not act as an actuator: its flanks are a
    contact (`mechanism.gaps`); so is a spring with a `wave` or a `loss`. Energy balances count that as a contact's, and
    not as an actuator's work.
    """

    flank: Flank = flatten()
    backlash: Scalar | None = physical(
        "coordinate", "the whole gap between its flanks", '"3 arcmin"', "none", above=0.0, lifted=True, default=None
    )
    rest: Scalar = physical("coordinate", "coordinate q0 at which the spring is relaxed", '"10 deg"', default=0.0)
    wave: "Wave | None" = flatten(default=None)
    loss: DriveLoss | None = flatten(default=None)

    def __call__(self, time, position, velocity):
        return -self.flank.curve.effort(position - self.rest) - self.flank.damping * velocity

    def losses(self, velocity):
        return self.flank.damping * velocity**2, 0.0


class JointFriction(AbstractActuator):
    """Coulomb friction in the gears, seals and bearings of a joint: -f tanh(q' / v). It is smooth where the motion
    reverses.

    The energy balance counts what it takes as a friction loss. The friction does not depend on the load of the joint.
    For friction that does, give the joint a clearance with a friction law.

    A joint creeps under a load smaller than f, as tanh has a slope at rest. A `law` with bristles (`laws.LuGre`,
    `laws.Dahl`, `laws.ElastoPlastic`) holds it.

    **Arguments:**

    - `effort` f [N m], or [N] of a slide.
    - `transition_speed` v [rad/s], or [m/s]: at this speed the friction is 76 % of f. Far above it the friction is that
      of Coulomb's law. A smaller value needs shorter steps.
    - `law`: a friction law in the place of tanh. The friction is f times its coefficient; its slips are rates of the
      coordinate [rad/s], or [m/s].
    """

    effort: Scalar = physical("effort", "friction f", '"2 N*m"', least=0.0)
    transition_speed: Scalar = physical(
        "coordinate/s", "speed v at which it turns round", '"0.01 rad/s"', above=0.0, default=SLOW
    )
    law: AbstractFrictionLaw | None = None

    def rub(self) -> Rub:
        """The friction as a contact with memory."""
        law = TanhCoulomb(1.0, self.transition_speed) if self.law is None else self.law
        return Rub(Pressing(self.effort), law)

    def __call__(self, time, position, velocity):
        return -self.effort * jnp.tanh(velocity / self.transition_speed)

    def losses(self, velocity):
        return 0.0, self.effort * jnp.tanh(velocity / self.transition_speed) * velocity
