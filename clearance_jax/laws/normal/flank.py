"""Flanks of gears, couplings and stops: a spring, straight or in pieces, with a damper that never pulls."""

import itertools
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._basis.numerics import greater, lesser, positive_part, within
from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import AbstractNormalLaw, Smoothness
from clearance_jax.parameters import Demand, describe, physical
from clearance_jax.spatial import Term


class FlankCurve(NamedTuple):
    """An effort that rises in straight pieces, by piece the `slopes`, each up to a depth (`breaks`, one less); and with
    the third power of the depth by the factor `cubic`.
    """

    slopes: tuple[Term, ...]
    breaks: tuple[Term, ...]
    cubic: Array | None = None

    @classmethod
    def of(cls, stiffness: Array, efforts: Array | None, cubic: Array | None = None) -> "FlankCurve":
        """The pieces of a stiffness, or of several that change at rising efforts."""
        if efforts is None:
            return cls((stiffness,), (), cubic)
        slopes = tuple(jnp.asarray(stiffness)[i] for i in range(jnp.shape(stiffness)[0]))
        ends = [jnp.asarray(efforts)[i] for i in range(jnp.shape(efforts)[0])]
        steps = [(end - start) / k for (start, end), k in zip(itertools.pairwise((0.0, *ends)), slopes, strict=False)]
        return cls(slopes, tuple(itertools.accumulate(steps)))

    @property
    def _bends(self) -> list[tuple[Term, Term]]:
        """By break its depth, and by how much the slope rises there."""
        changes = ((after - before) for before, after in itertools.pairwise(self.slopes))
        return list(zip(self.breaks, changes, strict=True))

    def effort(self, depth: Any) -> Any:
        """The effort at a depth; odd."""
        beyond = (change * (depth - within(depth, -at, at)) for at, change in self._bends)
        linear = sum(beyond, self.slopes[0] * depth)
        return linear if self.cubic is None else linear + self.cubic * depth**3

    def energy(self, depth: Any) -> Any:
        """The energy stored at a depth; even."""
        beyond = (0.5 * change * (depth - within(depth, -at, at)) ** 2 for at, change in self._bends)
        linear = sum(beyond, 0.5 * self.slopes[0] * depth**2)
        return linear if self.cubic is None else linear + 0.25 * self.cubic * depth**4


class Flank(AbstractNormalLaw):
    """The effort of a flank, of a tooth or a stop: T = T_e(d) + min(T_e(d), c d'), and never below 0.

    The damper is held within the spring's effort, so nothing jumps at touch (the law of Modelica's `ElastoBacklash`).
    With `limited` false it is T = max(0, T_e + c d') (that of `ElastoBacklash2`, whose effort jumps by c d' at touch),
    and with a `damping_factor` l it is T = max(0, T_e (1 + l d')), as of Hunt and Crossley. The effort T_e of the
    spring is k d; a stiffness in pieces rises by each one up to the next of the `efforts`.

    **Arguments:**

    - `stiffness` k [N m/rad], of a slide [N/m]; several in an array, one more than `efforts`.
    - `damping` c [N m s/rad], or [N s/m]; `damping_factor` l [s/rad], or [s/m]; give one of the two.
    - `efforts` [N m], or [N]: the rising efforts at which the stiffness changes.
    - `limited`: whether the damper is held within the spring's effort.
    - `cubic` k3 [N m/rad^3], or [N/m^3]: T_e = k d + k3 d^3; beside one stiffness only.
    """

    stiffness: Scalar = physical("effort/coordinate", "stiffness k of the flanks", '"50 kN*m/rad"', above=0.0)
    damping: Scalar = physical("effort*s/coordinate", "damping c", '"20 N*m*s/rad"', least=0.0, default=0.0)
    damping_factor: Scalar | None = physical(
        "s/coordinate", "damping factor l of Hunt and Crossley", '"10 s/rad"', "none", least=0.0, default=None
    )
    efforts: Float[Array, " pieces"] | None = physical(
        "effort",
        "rising efforts at which the stiffness changes",
        '["7 N*m", "25 N*m"]',
        "none",
        above=0.0,
        default=None,
    )
    limited: bool = describe(
        "whether the damper is held within the spring's effort", "false", static=True, default=True
    )
    cubic: Scalar | None = physical(
        "effort/coordinate^3", "factor k3 of the third power of the depth", '"500 MN*m/rad^3"', "none", least=0.0,
        default=None,
    )  # fmt: skip
    smooth_alternative: ClassVar[str] = "`limited` true"

    def demands(self):
        if self.efforts is not None:
            rising = jnp.all(jnp.diff(jnp.asarray(self.efforts)) > 0)
            fits = jnp.shape(self.stiffness) == (jnp.shape(self.efforts)[0] + 1,)
            yield Demand("efforts", rising, lambda: "must rise")
            yield Demand("stiffness", fits, lambda: "must be one number more than the `efforts` at which it changes")
        else:
            yield Demand("stiffness", jnp.ndim(self.stiffness) == 0, lambda: "must be one number without `efforts`")
        if self.cubic is not None:
            yield Demand("cubic", self.efforts is None, lambda: "must be left out beside `efforts`")
        if self.damping_factor is not None:
            yield Demand("damping", self.damping == 0, lambda: "must be left out beside a `damping_factor`")

    def depth(self, effort: Scalar) -> Scalar:
        """The depth at which the spring exerts an effort, not below 0 [rad or m]."""
        if self.cubic is not None:
            # Cardano: k d + k3 d^3 = T has one root. In the limit of small k3 it is T / k.
            k, k3 = self.stiffness, greater(self.cubic, 1e-12 * self.stiffness)
            unit = jnp.sqrt(3 * k3 / k)
            return 2 / unit * jnp.sinh(jnp.arcsinh(1.5 * effort * unit / k) / 3)
        if self.efforts is None:
            return effort / self.stiffness
        slopes = tuple(1 / slope for slope in self.curve.slopes)
        return FlankCurve(slopes, tuple(jnp.asarray(self.efforts)[i] for i in range(len(slopes) - 1))).effort(effort)

    @property
    def smoothness(self) -> Smoothness:  # type: ignore[override]
        try:
            jumps = not self.limited and self.damping_factor is None and float(self.damping) != 0
        except TypeError:  # traced, or one for each lane
            jumps = True
        return "C-1" if jumps else "C0"

    def constants(self, geometry) -> FlankCurve:
        return self.curve

    @property
    def curve(self) -> FlankCurve:
        """The effort of its spring."""
        return FlankCurve.of(self.stiffness, self.efforts, self.cubic)

    def formula(self, constants: FlankCurve, penetration, penetration_rate, memory):
        elastic = constants.effort(penetration)
        if self.damping_factor is not None:
            return elastic * (1 + self.damping_factor * penetration_rate)
        damper = self.damping * penetration_rate
        return elastic + (lesser(elastic, damper) if self.limited else damper)

    def event_functions(self, constants: FlankCurve, penetration, penetration_rate, memory):
        bends = tuple(penetration - at for at in constants.breaks)
        if not self.limited or self.damping_factor is not None:
            return bends
        return (constants.effort(penetration) - self.damping * penetration_rate, *bends)

    def energy(self, constants: FlankCurve, penetration):
        return constants.energy(positive_part(penetration))


class FlankSpring(Flank):
    """A flank on both sides without a gap: the spring and damper of a drive, which also pull."""

    acts_apart: ClassVar[bool] = True
    smoothness: ClassVar[Smoothness] = "C0"  # pyright: ignore[reportIncompatibleMethodOverride]

    @property
    def clips(self):
        return False

    def formula(self, constants: FlankCurve, penetration, penetration_rate, memory):
        return constants.effort(penetration) + self.damping * penetration_rate

    def event_functions(self, constants: FlankCurve, penetration, penetration_rate, memory):
        return tuple(penetration - at for at in constants.breaks)

    def energy(self, constants: FlankCurve, penetration):
        return constants.energy(penetration)
