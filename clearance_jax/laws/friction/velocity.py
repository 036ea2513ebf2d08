"""Friction laws of the slip alone: T = -mu(|v|) N v/|v|, steep at zero or with a peak. They creep under load.

Their formulas are those of the size v of the slip.
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from clearance_jax._basis.numerics import greater, lesser, step3, within
from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import Smoothness
from clearance_jax.laws._friction import AbstractFrictionLaw, Kink, along_slip, outside
from clearance_jax.parameters import Demand, physical

COEFFICIENT = {"help": "coefficient of friction mu", "example": "0.1"}
COMPLETE = "slip at which the friction is all but complete"
STATIC = {"help": "coefficient mu_s at the peak", "example": "0.2"}
DYNAMIC = {"help": "coefficient mu_d at high slip", "example": "0.1"}


def _magnitude(v: Scalar) -> tuple[Scalar, Scalar]:
    """|v| and the sign of v. At v = 0 the sign is 1, and so is the derivative of |v|."""
    sign = jnp.where(v < 0, -1.0, 1.0)
    return sign * v, sign


class AbstractSlipLaw(AbstractFrictionLaw):
    """A law of the slip alone."""

    transition_speed: eqx.AbstractVar[Scalar]

    @property
    def edges(self) -> tuple[Scalar, ...]:
        """Where pieces of the law and steep layers end [m/s]."""
        return (self.transition_speed,)

    @abc.abstractmethod
    def profile(self, v: Scalar, normal_force: Scalar) -> Scalar:
        """The traction [N] along a slip v [m/s], of any sign."""

    def traction(self, constants, slip, normal_force, memory):
        return along_slip(lambda v: self.profile(v, normal_force), slip)

    def event_functions(self, constants, slip, normal_force, memory):
        return tuple(outside(slip, speed) for speed in self.edges)


class CubicCoulomb(AbstractSlipLaw):
    """T = -mu N (3 x - x^3)/2 with x = min(1, v/v_c): Coulomb friction from v_c on. A pin creeps under load.

    Source: Qian et al. 2022, Eq. 8 (doi 10.3390/app122111041), whose first branch must read -mu.

    **Arguments:** `coefficient` mu; `transition_speed` v_c [m/s] (the paper does not give it).
    """

    coefficient: Scalar = physical("", least=0.0, **COEFFICIENT)
    transition_speed: Scalar = physical("m/s", COMPLETE, '"10 mm/s"', above=0.0)
    smoothness: ClassVar[Smoothness] = "C1"

    def profile(self, v, normal_force):
        x = within(v * (1.0 / self.transition_speed), -1.0, 1.0)
        return -0.5 * self.coefficient * normal_force * x * (3 - x * x)

    def kinks(self):
        mu, fast = self.coefficient, self.transition_speed
        return (Kink(fast, mu, 0.0, 3 * mu / fast**2),)


class TanhCoulomb(AbstractSlipLaw):
    """T = -mu N tanh(v/v_t). **Arguments:** `coefficient` mu, `transition_speed` v_t [m/s]."""

    coefficient: Scalar = physical("", least=0.0, **COEFFICIENT)
    transition_speed: Scalar = physical("m/s", COMPLETE, '"10 mm/s"', above=0.0)
    smoothness: ClassVar[Smoothness] = "C2"

    def profile(self, v, normal_force):
        return -self.coefficient * normal_force * jnp.tanh(v * (1.0 / self.transition_speed))

    @property
    def edges(self):
        # A step across the whole layer may sample it so that its error estimate cancels by accident: an edge cuts it.
        return (2 * self.transition_speed,)


class AdamsFriction(AbstractSlipLaw):
    """T = -N (mu_s STEP(v, -v_s, -1, v_s, 1) + (mu_d - mu_s) STEP(v, v_s, 0, v_d, 1)), the contact friction of MSC
    ADAMS: from -mu_s to mu_s for |v| < v_s, from mu_s to mu_d for |v| up to v_d, and mu_d beyond.

    **Arguments:** `static_coefficient` mu_s, `dynamic_coefficient` mu_d; `stiction_speed` v_s (stiction transition
    velocity) and `transition_speed` v_d > v_s (friction transition velocity) [m/s].
    """

    static_coefficient: Scalar = physical("", least=0.0, **STATIC)
    dynamic_coefficient: Scalar = physical("", least=0.0, **DYNAMIC)
    stiction_speed: Scalar = physical("m/s", "slip v_s of the peak", '"1 mm/s"', above=0.0)
    transition_speed: Scalar = physical("m/s", COMPLETE, '"10 mm/s"', above=0.0)
    smoothness: ClassVar[Smoothness] = "C1"

    def demands(self):
        least = self.stiction_speed
        yield Demand("transition_speed", self.transition_speed > least, lambda: f"must be above {least:g} m/s")

    def profile(self, v, normal_force):
        speed, sign = _magnitude(v)
        rise = self.static_coefficient * (2 * step3(0.5 + 0.5 * speed / self.stiction_speed) - 1)
        fall = step3((speed - self.stiction_speed) / (self.transition_speed - self.stiction_speed))
        return -normal_force * sign * (rise + (self.dynamic_coefficient - self.static_coefficient) * fall)

    def kinks(self):
        static, slow, fast = self.static_coefficient, self.stiction_speed, self.transition_speed
        fall = 6 * (self.dynamic_coefficient - static) / (fast - slow) ** 2
        most = greater(static, self.dynamic_coefficient)
        return Kink(slow, most, 0.0, fall + 3 * static / slow**2), Kink(fast, most, 0.0, fall)

    @property
    def edges(self):
        return self.stiction_speed, self.transition_speed


class Threlfall(AbstractSlipLaw):
    """T = -mu N (1 - exp(-3 min(1, v/v_r))): 0.95 mu N from v_r on (Threlfall 1978).

    **Arguments:** `coefficient` mu, `transition_speed` v_r [m/s].
    """

    coefficient: Scalar = physical("", least=0.0, **COEFFICIENT)
    transition_speed: Scalar = physical("m/s", COMPLETE, '"10 mm/s"', above=0.0)
    smoothness: ClassVar[Smoothness] = "C0"

    def profile(self, v, normal_force):
        speed, sign = _magnitude(v)
        ratio = lesser(speed / self.transition_speed, 1.0)
        return self.coefficient * normal_force * sign * jnp.expm1(-3 * ratio)

    def kinks(self):
        mu, fast = self.coefficient, self.transition_speed
        end = 3 * jnp.exp(-3.0) * mu
        return Kink(0.0, mu, 0.0, -9 * mu / fast**2), Kink(fast, mu, -end / fast, 3 * end / fast**2)


class Ambrosio(AbstractSlipLaw):
    """T = -mu c_d N with c_d = min(1, max(0, (v - v_0)/(v_1 - v_0))) (Ambrosio 2003). Below v_0 nothing holds a pin.

    **Arguments:** `coefficient` mu; `free_speed` v_0, `transition_speed` v_1 > v_0 [m/s].
    """

    coefficient: Scalar = physical("", least=0.0, **COEFFICIENT)
    free_speed: Scalar = physical("m/s", "slip v_0 below which there is no friction", '"1 mm/s"', above=0.0)
    transition_speed: Scalar = physical("m/s", COMPLETE, '"10 mm/s"', above=0.0)
    smoothness: ClassVar[Smoothness] = "C0"

    def demands(self):
        least = self.free_speed
        yield Demand("transition_speed", self.transition_speed > least, lambda: f"must be above {least:g} m/s")

    def profile(self, v, normal_force):
        speed, sign = _magnitude(v)
        ramp = within((speed - self.free_speed) / (self.transition_speed - self.free_speed), 0.0, 1.0)
        return -self.coefficient * normal_force * sign * ramp

    def kinks(self):
        mu, slow, fast = self.coefficient, self.free_speed, self.transition_speed
        slope, none = mu / (fast - slow), jnp.zeros_like(mu)
        return Kink(slow, mu, slope, none), Kink(fast, mu, -slope, none)

    @property
    def edges(self):
        return self.free_speed, self.transition_speed


class BengisuAkay(AbstractSlipLaw):
    """T = -N (mu_s x (2 - x) + (mu_s - mu_d) (exp(-y/v_1) - 1)) with x = min(1, v/v_0), y = max(0, v - v_0): a parabola
    up to v_0, and a fall to mu_d beyond (Bengisu and Akay 1994).

    **Arguments:** `static_coefficient` mu_s, `dynamic_coefficient` mu_d; `transition_speed` v_0 and `decay_speed` v_1
    [m/s].
    """

    static_coefficient: Scalar = physical("", least=0.0, **STATIC)
    dynamic_coefficient: Scalar = physical("", least=0.0, **DYNAMIC)
    transition_speed: Scalar = physical("m/s", "slip v_t of the peak", '"10 mm/s"', above=0.0)
    decay_speed: Scalar = physical("m/s", "slip over which friction falls from its peak", '"5 mm/s"', above=0.0)
    smoothness: ClassVar[Smoothness] = "C0"

    def profile(self, v, normal_force):
        speed, sign = _magnitude(v)
        ratio = lesser(speed / self.transition_speed, 1.0)
        beyond = greater(speed - self.transition_speed, 0.0)
        fall = (self.static_coefficient - self.dynamic_coefficient) * jnp.expm1(-beyond / self.decay_speed)
        return -normal_force * sign * (self.static_coefficient * ratio * (2 - ratio) + fall)

    def kinks(self):
        static, fast, decay = self.static_coefficient, self.transition_speed, self.decay_speed
        fall, bend = static - self.dynamic_coefficient, 2 * static / fast**2
        most = greater(static, self.dynamic_coefficient)
        return Kink(0.0, most, 0.0, -bend), Kink(fast, most, -fall / decay, fall / decay**2 + bend)


class Stribeck(AbstractSlipLaw):
    """T = -N ((mu_d + (mu_s - mu_d) exp(-(v/v_s)^p)) tanh(v/v_t) + k v): the curve of Tustin, and of Bo and
    Pavelescu, whose jump at zero slip is made steep (Andersson et al. 2007, without k).

    **Arguments:** `static_coefficient` mu_s, `dynamic_coefficient` mu_d; `stribeck_speed` v_s, `transition_speed` v_t
    [m/s]; `shape` p >= 1 (Tustin: 1; Bo and Pavelescu: 2); `viscous` k [s/m].
    """

    static_coefficient: Scalar = physical("", least=0.0, **STATIC)
    dynamic_coefficient: Scalar = physical("", least=0.0, **DYNAMIC)
    stribeck_speed: Scalar = physical("m/s", "slip v_s between the two", '"1 mm/s"', above=0.0)
    transition_speed: Scalar = physical("m/s", COMPLETE, '"10 mm/s"', above=0.0)
    shape: Scalar = physical("", "exponent p of the fall from the peak", "1", least=1.0, default=2.0)
    viscous: Scalar = physical("s/m", "viscous friction s2", '"0.1 s/m"', least=0.0, default=0.0)

    @property
    def smoothness(self) -> Smoothness:  # type: ignore[override]
        try:
            return "C2" if float(self.shape) > 1 else "C1"
        except TypeError:  # traced
            return "C1"

    def profile(self, v, normal_force):
        speed, _ = _magnitude(v)
        moving = speed > 0
        power = jnp.where(moving, (jnp.where(moving, speed, 1.0) / self.stribeck_speed) ** self.shape, 0.0)
        fall = (self.static_coefficient - self.dynamic_coefficient) * jnp.exp(-power)
        rise = jnp.tanh(v / self.transition_speed)
        return -normal_force * ((self.dynamic_coefficient + fall) * rise + self.viscous * v)

    def kinks(self):
        # |v|^p has a corner in its second derivative for p = 1 alone.
        bend = 2 * (self.dynamic_coefficient - self.static_coefficient) / (self.stribeck_speed * self.transition_speed)
        return (Kink(0.0, self.static_coefficient, 0.0, jnp.where(self.shape == 1, bend, 0.0)),)

    @property
    def edges(self):
        # For the reason given in `TanhCoulomb`.
        return (2 * self.transition_speed,)


class BrownMcPhee(AbstractSlipLaw):
    """T = -N (mu_d tanh(4 x) + (mu_s - mu_d) x / (x^2/4 + 3/4)^2), x = v/v_t (Brown and McPhee 2016,
    doi 10.1007/s11044-015-9471-9). Smooth, with a peak near mu_s at v_t.

    **Arguments:** `static_coefficient` mu_s, `dynamic_coefficient` mu_d, `transition_speed` v_t [m/s].
    """

    static_coefficient: Scalar = physical("", least=0.0, **STATIC)
    dynamic_coefficient: Scalar = physical("", least=0.0, **DYNAMIC)
    transition_speed: Scalar = physical("m/s", "slip v_t of the peak", '"10 mm/s"', above=0.0)
    smoothness: ClassVar[Smoothness] = "C2"

    def profile(self, v, normal_force):
        x = v * (1.0 / self.transition_speed)
        bump = x / (0.25 * x * x + 0.75) ** 2
        stribeck = (self.static_coefficient - self.dynamic_coefficient) * bump
        return -normal_force * (self.dynamic_coefficient * jnp.tanh(4 * x) + stribeck)
