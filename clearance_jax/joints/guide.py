"""The translational clearance joint: a block in a guide, whose corners touch the guide's walls.

If a straight side of the block touches a wall, so do its two corners, so corners are enough (Flores et al. 2008).
"""

import itertools
from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from clearance_jax._basis.numerics import greater
from clearance_jax._basis.types import Scalar
from clearance_jax.joints._base import AbstractClearance, AbstractElement
from clearance_jax.joints.checks import GRIPS
from clearance_jax.joints.contact import ContactPoint, JointOutline, PlayCoordinate
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, Geometry, Material
from clearance_jax.parameters import Demand, physical
from clearance_jax.spatial import Vector, X, Y, Z, dot


class GuideClearance(AbstractClearance):
    """The play of a block in its guide.

    The guide has a frame of its own, of which z is the direction in which the joint slides. If the joint slides along
    the x axis of its frame, the guide's x axis is the joint's y axis (across the guide in the plane), and the guide's y
    axis is the joint's z axis.

    **Arguments:**

    - `side_clearance`: how far the block may move to either side [m], > 0.
    - `length` of the block along the guide, and `height` across it along x [m], > 0.
    - `width` [m]: across it along y; `None`: the guide holds the block in this direction, as in the plane.
    - `normal`: the normal law of one corner; `friction`: the friction law, or `None`; `element`: what acts without
      touch.
    - `guide_length` [m]: the guide extends by half of it to either side of the joint's place on the parent. The model
      has no contact of the guide's edges with the block: so the block must not be longer, and a solve ends with an
      error where the block slides out. `None`: the guide is long.
    - `block_material`, `guide_material`: for laws that need them.
    """

    side_clearance: Scalar = physical("m", "play of the block to either side", '"0.1 mm"', above=0.0, instead=GRIPS)
    length: Scalar = physical("m", "length of the block", '"60 mm"', above=0.0)
    height: Scalar = physical("m", "height of the block", '"30 mm"', above=0.0)
    normal: AbstractNormalLaw  # pyright: ignore[reportGeneralTypeIssues]
    friction: AbstractFrictionLaw | None = None
    width: Scalar | None = physical(
        "m", "width of the block", '"30 mm"', "held, as in the plane", above=0.0, default=None
    )
    element: AbstractElement | None = None
    block_material: Material | None = None
    guide_material: Material | None = None
    guide_length: Scalar | None = physical(
        "m", "length of the guide, which holds the whole block", '"200 mm"', "long", above=0.0, default=None
    )
    kind: ClassVar[str] = "guide"
    tangents: ClassVar[int] = 2
    flat: ClassVar[bool] = True

    def demands(self):
        side, length = self.side_clearance, self.length
        for name, across in (("height", self.height), ("width", self.width)):
            if across is None:
                continue
            yield Demand(name, across > 2 * side, lambda: f"must be greater than twice the play {side:g} m")
            # A tilting block reaches half its diagonal across.
            square = 4 * side * (across + side)
            yield Demand(
                "length",
                length**2 > square,
                lambda n=square: f"must be greater than {np.sqrt(n):.3g} m, or the block turns over",
            )
        if self.guide_length is not None:
            guide = self.guide_length
            yield Demand("length", length <= guide, lambda: f"must be no greater than the guide's {guide:g} m")

    @property
    def count(self) -> int:
        return 4 if self.width is None else 16

    def play(self):
        """Slides across the guide, and the remaining turns."""
        tilt = 2 * self.side_clearance / self.length
        if self.width is None:
            slide = PlayCoordinate(".play_x", self.side_clearance, slides=X)
            return slide, PlayCoordinate(".tilt_y", tilt, turns=Y)
        roll = 2 * self.side_clearance / greater(self.width, self.height)
        return (
            PlayCoordinate(".play_x", self.side_clearance, slides=X),
            PlayCoordinate(".play_y", self.side_clearance, slides=Y),
            PlayCoordinate(".tilt_x", tilt, turns=X),
            PlayCoordinate(".tilt_y", tilt, turns=Y),
            PlayCoordinate(".tilt_z", roll, turns=Z),
        )

    def geometry(self):
        # Flat walls have no radii: a law that computes its stiffness from them refuses.
        size = self.height / 2
        materials = self.block_material, self.guide_material
        return Geometry(size, size + self.side_clearance, self.side_clearance, self.length, *materials, kind="flat")

    def points(self, at):
        width = 0.0 if self.width is None else self.width
        half = [jnp.asarray(size, float) / 2 for size in (self.height, width, self.length)]
        # Row: a corner's signs in x, y, z (0: in the middle); then 1, 0 (wall across x) or 0, 1 (wall across y).
        sides = np.array([(*corner, 1, 0) for corner in itertools.product((1, -1), (0,), (1, -1))], float)
        if self.width is not None:
            corners = list(itertools.product((1, -1), repeat=3))
            sides = np.array([(*corner, *wall) for wall in ((1, 0), (0, 1)) for corner in corners], float)
        x, y, z, first, second = (jnp.asarray(column) for column in sides.T)
        corner: Vector = (x * half[0], y * half[1], z * half[2])
        rows = (X, Y, Z) if at.rows is None else at.rows
        turned = [jnp.broadcast_to(jnp.asarray(dot(row, corner), float), x.shape) for row in rows]
        arm: Vector = (turned[0], turned[1], turned[2])
        normal: Vector = (first * x, second * y, jnp.zeros_like(x))
        other: Vector = (-second * y, first * x, jnp.zeros_like(x))
        along: Vector = (jnp.zeros_like(x), jnp.zeros_like(x), jnp.ones_like(x))
        velocity = at.velocity_at(arm)
        place = [jnp.asarray(term, float) + a for term, a in zip(at.place, arm, strict=True)]
        reach = first * half[0] + second * half[1] + self.side_clearance
        return ContactPoint(
            penetration=normal[0] * place[0] + normal[1] * place[1] - reach,
            penetration_rate=jnp.asarray(dot(normal, velocity)),
            slip=(jnp.asarray(dot(along, velocity)), jnp.asarray(dot(other, velocity))),
            normal=normal,
            tangents=(along, other),
            arm=arm,
        )

    @property
    def has_ends(self):
        return self.guide_length is not None

    def overhang(self, at):
        assert self.guide_length is not None
        return jnp.abs(jnp.asarray(at.place[2], float)) - (self.guide_length - self.length) / 2

    def outline(self):
        size = {"length": self.length, "height": self.height, "width": self.width}
        ends = 0.5 * self.length * np.array([-1.0, 1.0])
        return JointOutline(self.height / 2, self.side_clearance, **size, heights=ends, through=False)

    def travel(self, along):
        return self.side_clearance
