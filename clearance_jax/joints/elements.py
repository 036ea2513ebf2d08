"""Elements that fill a joint's play without touch: grease and seals damp it, preloaded rolling elements close it.

Without them a sleeve rings: a pin's modes along its wall have hardly any damping of their own.
"""

from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from clearance_jax._basis.types import Scalar
from clearance_jax.joints._element import AbstractElement, Offset
from clearance_jax.joints.checks import check_sizes
from clearance_jax.joints.film import ShortBearing
from clearance_jax.laws import Geometry
from clearance_jax.parameters import physical
from clearance_jax.spatial import Term, Vector, add, dot, plus, scale, times

# Damping of rolling bearings is reckoned as (0.25 to 2.5) 1e-5 s of their stiffness (Krämer, Dynamics of rotors and
# foundations, Springer 1993).
ROLLING_DAMPING = 1e-5


class PlayDamper(AbstractElement):
    """A linear damper that acts on the play: -b v on the pin's centre, -b w on its tilt. It exerts no force at rest.

    **Arguments:** `radial` [N s/m], across the axis; `axial` [N s/m], along it; `tilt` [N m s/rad]. Motions in which
    the joint has no play are not damped: a pin turns freely about its axis.
    """

    radial: Scalar = physical("N*s/m", least=0.0, help="damping of the play across", example='"2 kN*s/m"')
    axial: Scalar = physical("N*s/m", least=0.0, default=0.0, help="damping of axial play", example='"1 kN*s/m"')
    tilt: Scalar = physical("N*m*s/rad", least=0.0, default=0.0, help="damping of tilt", example='"0.5 N*m*s/rad"')

    @classmethod
    def film(cls, viscosity: Any, pin_radius: Any, length: Any, radial_clearance: Any) -> "PlayDamper":
        """The damping of a film that fills the play, about the middle position of the pin: pi m r L^3 / c^3 radially,
        and pi m r L^5 / (60 c^3) in tilt, with the viscosity m.

        It holds for small motions of a short pin (L below 2 r) whose film does not cavitate. Near the wall a film damps
        more. Warm base oils of greases have about 0.1 to 0.5 Pa s (ISO VG 100 to 460 at 40 degC).

        **Source:** Reynolds' equation of the short bearing (Ocvirk 1952), integrated for a rate of the film's height
        that is even along the pin, or grows from its middle.

        **Arguments:** `viscosity` [Pa s]; `pin_radius`, `length`, `radial_clearance` [m].
        """
        check_sizes("Pa*s", viscosity=viscosity)
        check_sizes(pin_radius=pin_radius, length=length, radial_clearance=radial_clearance)
        radial = np.pi * viscosity * pin_radius * length**3 / radial_clearance**3
        return cls(radial, 0.0, radial * length**2 / 60)

    def wrench(self, offset: Offset, geometry: Geometry) -> tuple[Vector, Vector]:
        """The damping force and torque."""
        return _each(self.radial, self.axial, offset.velocity), scale(-self.tilt, offset.spin)


class PreloadedBearing(AbstractElement):
    """Rolling elements under a preload P, which remove the play up to a load: -k x / sqrt(1 + (k |x| / P)^2).

    Up to about half of P the bearing is a spring of the stiffness k. Beyond, rolling elements come loose. It never
    bears more than P: the walls of the joint's play bear the rest of the load. So the play comes back under a large
    load, and when wear takes the preload away. Its energy is P^2 / k (sqrt(1 + (k |x| / P)^2) - 1).

    **Arguments:**

    - `radial_stiffness` [N/m], > 0; `axial_stiffness` [N/m], of axial play; `tilt_stiffness` [N m/rad].
    - `radial_preload`, `axial_preload` [N], `tilt_preload` [N m]: the load at which the play opens; `None`: it never
      opens.
    - `damping_time` [s]: damping over stiffness; for rolling bearings 0.25e-5 to 2.5e-5 s (Krämer 1993).
    """

    radial_stiffness: Scalar = physical("N/m", above=0.0, help="stiffness across", example='"200 N/um"')
    axial_stiffness: Scalar = physical(
        "N/m", least=0.0, default=0.0, help="stiffness of axial play", example='"300 N/um"'
    )
    tilt_stiffness: Scalar = physical(
        "N*m/rad", least=0.0, default=0.0, help="stiffness against tilt", example='"200 kN*m/rad"'
    )
    radial_preload: Scalar | None = physical(
        "N", above=0.0, default=None, help="force at which the play opens", example='"800 N"', absent="it never opens"
    )
    axial_preload: Scalar | None = physical(
        "N", above=0.0, default=None, help="axial force at which it opens", example='"1 kN"', absent="it never opens"
    )
    tilt_preload: Scalar | None = physical(
        "N*m", above=0.0, default=None, help="moment at which it opens", example='"40 N*m"', absent="it never opens"
    )
    damping_time: Scalar = physical(
        "s", least=0.0, default=ROLLING_DAMPING, help="damping over stiffness", example='"10 us"'
    )
    stiff: ClassVar[bool] = True

    def _springs(self, offset: Offset) -> tuple[tuple[Scalar, Scalar | None, Vector], ...]:
        """Stiffness, preload and deflection across and along the axis, and of the tilt (by the chord of its angle)."""
        x, y, z = offset.place
        chord = jnp.sqrt(2 / (1 + jnp.asarray(offset.cosine, float)))
        return (
            (self.radial_stiffness, self.radial_preload, (x, y, 0.0)),
            (self.axial_stiffness, self.axial_preload, (0.0, 0.0, z)),
            (self.tilt_stiffness, self.tilt_preload, scale(chord, offset.sine)),
        )

    def wrench(self, offset: Offset, geometry: Geometry) -> tuple[Vector, Vector]:
        """Force and torque of the springs and their damping."""
        radial, axial, tilt = (scale(-k / _opening(k, preload, at), at) for k, preload, at in self._springs(offset))
        # The moment is the derivative of the tilt's energy by its angle, of which the chord is twice the half's sine.
        lean = jnp.sqrt((1 + jnp.asarray(offset.cosine, float)) / 2)
        damping = _each(self.radial_stiffness, self.axial_stiffness, offset.velocity)
        force = add(add(radial, axial), scale(self.damping_time, damping))
        spent = scale(-times(self.damping_time, self.tilt_stiffness), offset.spin)
        return force, add(scale(lean, tilt), spent)

    def energy(self, offset: Offset, geometry: Geometry) -> Scalar:
        """The energy of the springs [J]."""
        stored: Term = 0.0
        for k, preload, at in self._springs(offset):
            stored = plus(stored, times(k / (1 + _opening(k, preload, at)), dot(at, at)))
        return jnp.asarray(stored, float)


def _each(across: Scalar, along: Scalar, rate: Vector) -> Vector:
    """Force of the dampers."""
    return times(-across, rate[0]), times(-across, rate[1]), times(-along, rate[2])


def _opening(stiffness: Scalar, preload: Scalar | None, at: Vector) -> Scalar | float:
    """sqrt(1 + (k |x| / P)^2): 1 where nothing is loose."""
    return 1.0 if preload is None else jnp.sqrt(1 + (stiffness / preload) ** 2 * jnp.asarray(dot(at, at), float))


ELEMENTS = {"damper": PlayDamper, "preloaded-bearing": PreloadedBearing, "short-bearing": ShortBearing}
"""By their words in scene files."""
