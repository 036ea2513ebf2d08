"""The plane revolute clearance joint: a pin in a round or a worn sleeve.

The contact point lies on the sleeve's surface, P = R n with n = e/|e|; both wrenches act there, so momentum and power
balance exactly. (Formulas with the pin's own radius as arm differ from this by the penetration.) For the bore of a worn
sleeve see `joints.bore`.
"""

import dataclasses
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.numerics import safe_unit
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.joints._base import AbstractElement
from clearance_jax.joints.bore import FEWEST, Bore, Modes, finer
from clearance_jax.joints.checks import GRIPS, warn_of_pin
from clearance_jax.joints.contact import ContactPoint, JointOutline, PlayCoordinate
from clearance_jax.joints.fitting import Tolerance
from clearance_jax.joints.pin import AbstractPin, depth_demand
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, Geometry, Material
from clearance_jax.parameters import physical
from clearance_jax.spatial import Vector, X, Y, dot, plus, scale, times


class RevoluteClearance(AbstractPin):
    """The radial play of a pin in a sleeve.

    **Arguments:**

    - `radial_clearance`: sleeve radius minus pin radius [m], > 0.
    - `pin_radius` [m], > 0.
    - `normal`: the normal law.
    - `friction`: the friction law, or `None`: then no friction is compiled.
    - `element`: what acts without touch (a film), or `None`.
    - `length` [m] of the contact, over which wear and line contacts spread their force; `pin_material`,
      `sleeve_material`: for laws that need them.
    - `tolerance`: between which values the clearance lies as it is made, for information.
    - `depth` [m]: the wear of the sleeve, shape (sectors,), at least 16 of them: the first in the direction of the
      sleeve's x, the others evenly around it. `None`: the sleeve is round, and the program has nothing for wear.
    - `modes`: further wear, by few numbers.

    **Raises:** `ClearanceError` for depths or modes of other shapes.
    """

    radial_clearance: Scalar = physical(
        "m",
        above=0.0,
        help="sleeve radius minus pin radius; its presence makes the play",
        example='"0.1 mm"',
        instead=GRIPS,
    )
    pin_radius: Scalar = physical("m", above=0.0, help="radius of the pin", example='"10 mm"')
    normal: AbstractNormalLaw  # pyright: ignore[reportGeneralTypeIssues]
    friction: AbstractFrictionLaw | None = None
    element: AbstractElement | None = None
    length: Scalar | None = physical("m", above=0.0, default=None)
    pin_material: Material | None = None
    sleeve_material: Material | None = None
    tolerance: Tolerance | None = None
    depth: Float[Array, "*batch sectors"] | None = physical("m", least=0.0, default=None)
    modes: Modes | None = None
    kind: ClassVar[str] = "pin"
    tangents: ClassVar[int] = 1

    def __check_init__(self):
        if self.depth is None:
            warn_of_pin(self.radial_clearance, self.pin_radius)
        shape = () if self.depth is None else np.shape(self.depth)
        if self.depth is not None and (len(shape) != 1 or shape[-1] < FEWEST):
            raise ClearanceError(f"`depth` must be one number a sector, at least {FEWEST}, but it has shape {shape}.")
        if self.modes is not None and np.shape(self.modes.shapes) != (*np.shape(self.modes.amounts), *shape):
            raise ClearanceError("`modes` must have one number a sector of `depth` for each of their amounts.")

    def demands(self):
        return depth_demand(self)

    @property
    def profile(self):
        if self.depth is None or self.modes is None:
            return self.depth
        return self.depth + self.modes.amounts @ self.modes.shapes

    def play(self):
        """The eccentricity of the pin: two slides along the sleeve's axes."""
        radial = self.radial_clearance
        return PlayCoordinate(".play_x", radial, slides=X), PlayCoordinate(".play_y", radial, slides=Y)

    def geometry(self):
        return Geometry(
            self.pin_radius,
            self.sleeve_radius,
            self.radial_clearance,
            self.length,
            self.pin_material,
            self.sleeve_material,
            depth=self.profile,
        )

    def points(self, at):
        x, y = (jnp.asarray(c, float) for c in at.place[:2])
        if self.depth is None:
            distance, nx, ny = safe_unit(x, y)
            depth, normal = distance - self.radial_clearance, (nx, ny, 0.0)
            reach = self.sleeve_radius - distance
        else:
            depth, gx, gy = self._bore.depth_at(x, y)
            _, nx, ny = safe_unit(gx, gy)
            normal = (gx, gy, 0.0)
            # From the pin's centre along the force: it has no moment about a round pin.
            reach = self.pin_radius - depth
        tangent: Vector = (-ny, nx, 0.0)
        return ContactPoint(
            penetration=depth,
            penetration_rate=jnp.asarray(dot(normal, at.velocity)),
            slip=(jnp.asarray(plus(dot(tangent, at.velocity), times(reach, at.spin[2]))),),
            normal=normal,
            tangents=(tangent,),
            arm=scale(reach, (nx, ny, 0.0)),
        )

    def travel(self, along):
        if self.depth is None:
            return self.radial_clearance
        x, y = (jnp.asarray(c, float) for c in along[:2])
        return self._bore.distance(x, y, jnp.zeros(()))

    def press(self, along, depth):
        if self.depth is None:
            return scale(self.radial_clearance + depth, along)
        return (*self._bore.seat(along, depth), 0.0)

    def outline(self):
        return JointOutline(self.pin_radius, self.radial_clearance, self.profile)

    @property
    def _bore(self) -> Bore:
        return Bore(self.radial_clearance, finer(self.profile))

    def worn(self, depth: Any) -> "RevoluteClearance":
        return dataclasses.replace(self, depth=jnp.asarray(depth, float), modes=None)
