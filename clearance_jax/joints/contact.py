"""Data of a contact: relative motion, play coordinates, contact points, actions, depth, and what pictures show."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import Memory, Slip
from clearance_jax.laws.geometry import Local
from clearance_jax.spatial import Matrix, Term, Vector, Z, add, cross, plus, times


class Relative(NamedTuple):
    """Pose and velocity of the pin relative to the sleeve, in the sleeve's axes, of which z is the joint's own.

    - `place` [m]: of the pin's centre from the sleeve's; `angle` [rad]: how the pin is turned about z, in the plane.
    - `rows`: in space the rows of the rotation matrix of the pin; `None` in the plane.
    - `velocity` [m/s] and `spin` [rad/s], as an observer on the sleeve sees them.
    """

    place: Vector
    angle: Term
    velocity: Vector
    spin: Vector
    rows: Matrix | None = None

    @property
    def axis(self) -> Vector:
        """The pin's own axis."""
        return Z if self.rows is None else (self.rows[0][2], self.rows[1][2], self.rows[2][2])

    def velocity_at(self, arm: Vector) -> Vector:
        """Velocity of the pin's point at an arm from its centre."""
        return add(self.velocity, cross(self.spin, arm))


class PlayCoordinate(NamedTuple):
    """One coordinate that play adds to a joint of the tree.

    - `suffix`: the end of its name; `scale`: its size for error control (a clearance [m], or an angle [rad]).
    - `slides`, `turns`: the axis of the sleeve along which it slides or about which it turns; the other is `None`.
    - `swings`: whether it is one of two tilts, about perpendicular axes, that make one rotation (`spatial.swing`).
    """

    suffix: str
    scale: Scalar
    slides: Vector | None = None
    turns: Vector | None = None
    swings: bool = False


class ContactPoint(NamedTuple):
    """Where two surfaces touch, or are nearest, in the sleeve's axes. If a joint has several points, each number is an
    array.

    - `penetration` [m] (negative: a gap) and `penetration_rate` [m/s].
    - `slip` [m/s]: velocity of the pin's surface on the sleeve's, along the `tangents`.
    - `normal`: from the pin's surface into the sleeve's: the gradient of the penetration by the place of the pin.
    - `arm` [m]: from the pin's centre to the point.
    - `turning` [rad/s]: the spin of the plane of contact, without a part about its normal. It is given where the slip
      has the components of all three axes. `None`: the slip is along the tangents, which turn with the plane.
    - `lever` [m]: how much further from the pin's axis than the point friction acts, and `sweep` [m/s]: what the
      pin's spin adds there to the slip; `None`: it acts at the point.
    - `local`: what is different at this point for the laws; `share`: its part of the joint's normal force, if there are
      several points.
    """

    penetration: Scalar
    penetration_rate: Scalar
    slip: Slip
    normal: Vector
    tangents: tuple[Vector, ...]
    arm: Vector
    local: Local = None
    share: Scalar | None = None
    turning: Vector | None = None
    lever: Scalar | None = None
    sweep: Scalar | None = None

    @property
    def part(self) -> Scalar | float:
        """Its part of the joint's normal force."""
        return 1.0 if self.share is None else self.share

    @property
    def rubbing(self) -> Slip:
        """The slip at which friction dissipates."""
        return self.slip if self.sweep is None else (self.slip[0] + self.sweep, *self.slip[1:])

    def rubbing_around(self, lever: Array, spin: Term) -> "ContactPoint":
        """The same with friction further from the axis by a `lever`, for a pin with the `spin` about it [rad/s]. Points
        of faces, whose normal is along the axis, have no lever.
        """
        x, y, _ = self.normal
        lever = jnp.where(plus(times(x, x), times(y, y)) > 0.5, lever, 0.0)
        return self._replace(lever=lever, sweep=lever * spin)

    def carry(self, rates: Memory, memory: Memory) -> Memory:
        """The rates of the friction's memory, flat. Vectors in all three axes also turn with the plane of contact."""
        if self.turning is None:
            return rates
        vectors = [(memory[i], memory[i + 1], memory[i + 2]) for i in range(0, len(memory), 3)]
        turned = [term for vector in vectors for term in cross(self.turning, vector)]
        return tuple(rate + term for rate, term in zip(rates, turned, strict=True))

    @property
    def law_view(self) -> "ContactPoint":
        """The contact point as laws see it."""
        return self._replace(normal=(), tangents=(), arm=())


class PointAction(NamedTuple):
    """The action of one contact point or of several: forces on the pin [N], rate of the memory, elastic energy [J]."""

    penetration: Scalar
    penetration_rate: Scalar
    slip: Slip
    normal_force: Scalar
    traction: Slip
    memory_rate: Memory
    elastic_energy: Scalar


class Action(NamedTuple):
    """What a joint does to the pin at one instant, in the sleeve's axes.

    - `force` [N] at the pin's centre, `torque` [N m] about it; `points`: what happens at each contact point.
    - `memory_rate`: the time derivative of the memory of its laws.
    - `elastic_energy` [J]; `friction_power` [W]: lost in friction; `absorbed_power` [W]: absorbed otherwise.
    """

    force: Vector
    torque: Vector
    points: PointAction
    memory_rate: Memory
    elastic_energy: Scalar
    absorbed_power: Scalar
    friction_power: Scalar

    @property
    def normal_force(self) -> Scalar:
        """The sum of its points' normal forces [N]."""
        return jnp.sum(self.points.normal_force)

    @property
    def deepest(self) -> PointAction:
        """The action of the point of largest penetration."""
        if not jnp.ndim(self.points.penetration):
            return self.points
        return jax.tree.map(lambda values: values[jnp.argmax(self.points.penetration)], self.points)


class JointOutline(NamedTuple):
    """The numbers of a joint that its pictures need, in the axes of its sleeve [m]. Datasets keep them.

    - `radius` of the pin or ball, and its `clearance`.
    - `depth`: how much farther away the wall is (by wear, for example), shape (sectors,) or (heights, sectors): the
      first sector in the direction of the sleeve's x, the others evenly around it. `None`: the wall is round.
    - `length` of a pin or a block that tilts, and `heights` along the sleeve at which it may touch; `edges`: whether
      the joint's `pattern` distinguishes edges, as that of a sleeve.
    - `through`: whether `length` is that of the sleeve, else of the pin.
    - `axial`: the play along the sleeve, with the radius `collar` at which faces bear, at `ring` points.
    - `height` and `width` of a block between flat walls (`width=None`: the walls hold it). Its `radius` is half the
      height. `height=None`: it is round.
    - `ball`: whether it is a ball in a socket.
    """

    radius: Any
    clearance: Any
    depth: Any = None
    length: Any = None
    heights: Any = (0.0,)
    edges: bool = False
    through: bool = True
    axial: Any = None
    collar: Any = 0.0
    ring: int = 0
    height: Any = None
    width: Any = None
    ball: bool = False
