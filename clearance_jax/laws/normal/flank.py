"""Flanks of gears, couplings and stops: a spring, straight or in pieces, with a damper that never pulls."""

import itertools
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._basis.numerics import positive_part
from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import AbstractNormalLaw, Smoothness
from clearance_jax.parameters import Demand, describe, physical
from clearance_jax.spatial import Term


class Pieces(NamedTuple):
    """A torque that rises in straight pieces: by piece the `slopes`, each up to a depth (`breaks`, one less)."""

    slopes: tuple[Term, ...]
    breaks: tuple[Term, ...]

    @classmethod
    def of(cls, stiffness: Array, efforts: Array | None) -> "Pieces":
        """The pieces of a stiffness, or of several that change at rising efforts."""
        if efforts is None:
            return cls((stiffness,), ())
        slopes = tuple(jnp.asarray(stiffness)[i] for i in range(jnp.shape(stiffness)[0]))
        ends = [jnp.asarray(efforts)[i] for i in range(jnp.shape(efforts)[0])]
        steps = [(end - start) / k for (start, end), k in zip(itertools.pairwise((0.0, *ends)), slopes, strict=False)]
        return cls(slopes, tuple(itertools.accumulate(steps)))

    @property
    def _bends(self) -> list[tuple[Term, Term]]:
        """By break its depth, and by how much the slope rises there."""
        changes = ((after - before) for before, after in itertools.pairwise(self.slopes))
        return list(zip(self.breaks, changes, strict=True))

    def effort(self, depth: Scalar) -> Scalar:
        """The effort at a depth; odd."""
        beyond = (change * (depth - jnp.clip(depth, -at, at)) for at, change in self._bends)
        return sum(beyond, self.slopes[0] * depth)

    def energy(self, depth: Scalar) -> Scalar:
        """The energy stored at a depth; even."""
        beyond = (0.5 * change * (depth - jnp.clip(depth, -at, at)) ** 2 for at, change in self._bends)
        return sum(beyond, 0.5 * self.slopes[0] * depth**2)


class Flank(AbstractNormalLaw):
    """The effort of a flank, of a tooth or a stop: T = T_e(d) + min(T_e(d), c d'), and never below 0.

    The damper is held within the spring's effort, so nothing jumps at touch (the law of Modelica's `ElastoBacklash`). With
    `limited` false it is T = max(0, T_e + c d') (that of `ElastoBacklash2`, whose effort jumps by c d' at touch), and
    with a `damping_factor` l it is T = max(0, T_e (1 + l d')), as of Hunt and Crossley. The effort T_e of the spring is
    k d; a stiffness in pieces rises by each one up to the next of the `efforts`.

    **Arguments:**

    - `stiffness` k [N m/rad], of a slide [N/m]; several in an array, one more than `efforts`.
    - `damping` c [N m s/rad], or [N s/m]; `damping_factor` l [s/rad], or [s/m]; give one of the two.
    - `efforts` [N m], or [N]: the rising efforts at which the stiffness changes.
    - `limited`: whether the damper is held within the spring's effort.
    """

    stiffness: Scalar = physical("effort/coordinate", "stiffness k of the flanks", '"50 kN*m/rad"', above=0.0)
    damping: Scalar = physical("effort*s/coordinate", "damping c", '"20 N*m*s/rad"', least=0.0, default=0.0)
    damping_factor: Scalar | None = physical(
        "s/coordinate", "damping factor l of Hunt and Crossley", '"10 s/rad"', "none", least=0.0, default=None
    )
    efforts: Float[Array, " pieces"] | None = physical(
        "effort", "rising efforts at which the stiffness changes", '["7 N*m", "25 N*m"]', "none", above=0.0, default=None
    )
    limited: bool = describe(
        "whether the damper is held within the spring's effort", "false", static=True, default=True
    )
    smooth_alternative: ClassVar[str] = "`limited` true"

    def demands(self):
        if self.efforts is not None:
            rising = jnp.all(jnp.diff(jnp.asarray(self.efforts)) > 0)
            fits = jnp.shape(self.stiffness) == (jnp.shape(self.efforts)[0] + 1,)
            yield Demand("efforts", rising, lambda: "must rise")
            yield Demand("stiffness", fits, lambda: "must be one number more than the `efforts` at which it changes")
        else:
            yield Demand("stiffness", jnp.ndim(self.stiffness) == 0, lambda: "must be one number without `efforts`")
        if self.damping_factor is not None:
            yield Demand("damping", self.damping == 0, lambda: "must be left out beside a `damping_factor`")

    @property
    def smoothness(self) -> Smoothness:  # type: ignore[override]
        try:
            jumps = not self.limited and self.damping_factor is None and float(self.damping) != 0
        except TypeError:  # traced, or one for each lane
            jumps = True
        return "C-1" if jumps else "C0"

    def constants(self, geometry) -> Pieces:
        return Pieces.of(self.stiffness, self.efforts)

    def formula(self, constants: Pieces, penetration, penetration_rate, memory):
        elastic = constants.effort(penetration)
        if self.damping_factor is not None:
            return elastic * (1 + self.damping_factor * penetration_rate)
        damper = self.damping * penetration_rate
        return elastic + (jnp.minimum(elastic, damper) if self.limited else damper)

    def event_functions(self, constants: Pieces, penetration, penetration_rate, memory):
        bends = tuple(penetration - at for at in constants.breaks)
        if not self.limited or self.damping_factor is not None:
            return bends
        return (constants.effort(penetration) - self.damping * penetration_rate, *bends)

    def energy(self, constants: Pieces, penetration):
        return constants.energy(positive_part(penetration))

    def validity(self, constants: Any):
        return None
