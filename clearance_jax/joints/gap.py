"""The gap of a coordinate: backlash of a drive or a gear, and the stops of a joint; and friction on a coordinate.

It is a contact along one number, the place x in the gap: an angle [rad], or a length [m]. The laws act on it as on
walls: the penetration is |x| - b/2 between two flanks, and the "force" of a law is the effort on the coordinate.
"""

from typing import Any, ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from clearance_jax._basis.types import Scalar
from clearance_jax.joints._base import AbstractClearance
from clearance_jax.joints.contact import ContactPoint, PlayCoordinate
from clearance_jax.joints.elements import AbstractElement
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, Geometry
from clearance_jax.laws._base import Smoothness
from clearance_jax.parameters import physical
from clearance_jax.spatial import ZERO, X, Y

Sides = Literal["both", "upper", "lower", "spring"]


class Gap(AbstractClearance):
    """The gap of a coordinate between two flanks, or beside one of them.

    **Arguments:** `width` b [rad or m]: of the whole gap; `normal`: the law of a flank, in [N m] of [rad] for an angle;
    `sides`: where flanks are: one at either end, or only above (below) zero; or one that pushes and pulls (a spring).
    """

    width: Scalar = physical("coordinate", least=0.0)
    normal: AbstractNormalLaw  # pyright: ignore[reportGeneralTypeIssues]
    sides: Sides = eqx.field(static=True, default="both")
    friction: AbstractFrictionLaw | None = None
    element: AbstractElement | None = None
    tangents: ClassVar[int] = 0
    flat: ClassVar[bool] = True
    kind: ClassVar[str] = "gap"

    def play(self):
        return (PlayCoordinate("", self.half, slides=X),)

    @property
    def half(self) -> Scalar:
        """Half of the gap's width [rad or m]."""
        return 0.5 * self.width

    def geometry(self):
        size = self.half if self.sides == "both" else jnp.ones(())
        return Geometry(size, size, size, kind="flat")

    @property
    def count(self) -> int:
        return 2 if self.sides == "both" else 1

    def points(self, at):
        x, rate = (jnp.asarray(term, float) for term in (at.place[0], at.velocity[0]))
        # Two flanks are two points: alike gaps are then one program.
        sides = {"both": np.array([1.0, -1.0]), "upper": 1.0, "lower": -1.0, "spring": jnp.where(x >= 0, 1.0, -1.0)}
        side = jnp.asarray(sides[self.sides])
        half = self.half if self.sides == "both" else 0.0
        arm = ZERO if self.count == 1 else (jnp.zeros(2),) * 3
        normal = (side, *(jnp.zeros_like(side),) * 2) if self.count > 1 else (side, 0.0, 0.0)
        return ContactPoint(side * x - half, side * rate, (), normal, (), arm)

    def travel(self, along):
        return self.half

    def outline(self):
        return None


class ToothGap(Gap):
    """The gap of teeth that slide on each other: with the second component of the relative velocity."""

    tangents: ClassVar[int] = 1
    kind: ClassVar[str] = "teeth"

    def points(self, at):
        slip = jnp.asarray(at.velocity[1], float)
        return super().points(at)._replace(slip=(slip,), tangents=(Y,))


class Pressing(AbstractNormalLaw):
    """A constant `effort` that presses, whatever the place."""

    effort: Scalar = physical("effort", "friction f", least=0.0)
    smoothness: ClassVar[Smoothness] = "C2"
    acts_apart: ClassVar[bool] = True

    @property
    def clips(self):
        return False

    def formula(self, constants: Any, penetration, penetration_rate, memory):
        return self.effort + 0.0 * penetration

    def energy(self, constants: Any, penetration):
        return 0.0 * penetration


class Rub(AbstractClearance):
    """Friction along a coordinate that nothing but itself holds: by the law `friction`, for the `normal` effort."""

    normal: Pressing  # pyright: ignore[reportGeneralTypeIssues]
    friction: AbstractFrictionLaw  # pyright: ignore[reportGeneralTypeIssues]
    element: AbstractElement | None = None
    tangents: ClassVar[int] = 1
    flat: ClassVar[bool] = True
    kind: ClassVar[str] = "rub"

    def play(self):
        return ()

    @property
    def half(self) -> Scalar:
        """A size that no place is compared with [rad or m]."""
        return jnp.ones(())

    def geometry(self):
        return Geometry(self.half, self.half, self.half, kind="flat")

    def points(self, at):
        x, rate = (jnp.asarray(term, float) for term in (at.place[0], at.velocity[0]))
        return ContactPoint(jnp.ones_like(x), jnp.zeros_like(x), (rate,), (0.0, 0.0, 0.0), (X,), ZERO)

    def travel(self, along):
        return self.half

    def outline(self):
        return None
