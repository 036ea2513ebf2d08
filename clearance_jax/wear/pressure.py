"""Pressure models: how a normal force spreads over the sectors of a sleeve, as mean pressures that bear the force.

A sleeve is cut into equal sectors, sector j centred at the angle 2 pi j / N of the sleeve's axes. A pressure is that of
one section of the joint, where the force is one per length.
"""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.numerics import safe_sqrt
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.joints.bore import spline
from clearance_jax.laws import Geometry, Material
from clearance_jax.parameters import Parametrised, physical

# Newton's method for how deep a foundation is pressed: it makes at most so many iterations, and ends after a step below
# NEAR times the clearance, as two more iterations then leave round-off. At worst the error falls by a third each time.
ITERATIONS, NEAR = 20, 1e-6
# Parts of a sector on which a foundation is summed.
PARTS = 8


class Section(NamedTuple):
    """A section of a sleeve with its pin: the `geometry` that laws know, and the `depth` that is worn off [m], shape
    (sectors,).
    """

    geometry: Geometry
    depth: Float[Array, " sectors"]

    @property
    def sectors(self) -> int:
        """The number of sectors."""
        return self.depth.shape[0]

    @property
    def angles(self) -> np.ndarray:
        """Middle angles of the sectors [rad], shape (sectors,)."""
        return 2 * np.pi * np.arange(self.sectors) / self.sectors

    @property
    def arc(self) -> Scalar:
        """The length of a sector around the sleeve [m]."""
        return self.geometry.sleeve_radius * (2 * np.pi / self.sectors)


class SectionLoad(NamedTuple):
    """The load of a section: normal `force` per length [N/m] on the sleeve, its direction `angle` [rad], and the
    `place` of the pin's centre [m], two numbers.
    """

    force: Scalar
    angle: Scalar
    place: tuple[Scalar, Scalar]


class PressureField(NamedTuple):
    """Mean pressures of the sectors [Pa], and the force per length that they bear [N/m]."""

    means: Float[Array, " sectors"]
    borne: Scalar


class AbstractPressure(Parametrised):
    """A pressure model: how a normal force spreads over the sleeve."""

    @abc.abstractmethod
    def prepare(self, section: Section) -> Callable[[SectionLoad], PressureField]:
        """The pressures on a section, as a function of its load."""

    @abc.abstractmethod
    def half_angle(self, geometry: Geometry, force: Scalar) -> Scalar:
        """The half angle of the patch of a force per length [N/m] on the round sleeve [rad]."""

    def shape(self, place: Any) -> Any:
        """The pressure at a place from -1 to 1 of the patch on a round sleeve, over the largest: by default a
        foundation's parabola. How many sectors a sleeve needs follows from it (`sectors`).
        """
        return 1 - place * place

    rises: ClassVar[Any] = 0.0
    """By how much a pressure rises where the sleeve stands higher [Pa/m], with a fixed pin; 0 if it does not depend
    on the worn profile.
    """
    is_narrow: ClassVar[bool] = True
    """Whether a patch is taken as flat: then the sum of the pressures is the force. Otherwise the sum of their
    components along the force is.
    """


def hertz_half_angle(geometry: Geometry, force: Scalar) -> Scalar:
    """The angle b / R of Hertz's line contact of a pin in its sleeve: b = 2 sqrt(F' R_eff / (pi E*)), R_eff = R1 R2 /
    (R1 - R2).

    (Qian et al. 2022, Eqs. 15 and 16, with the signs and the root that are missing there.)

    **Raises:** `ClearanceError` where the materials are not known.
    """
    pin, sleeve = geometry.pin_material, geometry.sleeve_material
    if pin is None or sleeve is None:
        message = "Hertz's line contact needs `pin_material` and `sleeve_material` of the joint (`laws.Material`)."
        raise ClearanceError(message).about("pin_material")
    radius = geometry.sleeve_radius * geometry.pin_radius / geometry.radial_clearance
    return 2 * safe_sqrt(force * radius * (pin.compliance + sleeve.compliance) / np.pi) / geometry.sleeve_radius


def _spread(section: Section, at: SectionLoad, half: Scalar, part: Callable[[Array], Array]) -> PressureField:
    """Spread a force over a patch, exactly for every sector, however narrow the patch. `part`: the fraction of the
    force below a place of the patch from -1 to 1.
    """
    beside = jnp.asarray(section.angles) - at.angle
    beside = beside - 2 * np.pi * jnp.round(beside / (2 * np.pi))
    wide, edge = jnp.where(half > 0, half, 1.0), np.pi / section.sectors
    above, below = (part(jnp.clip((beside + side * edge) / wide, -1.0, 1.0)) for side in (1, -1))
    means = jnp.where(half > 0, at.force / section.arc * (above - below), 0.0)
    return PressureField(means, jnp.sum(means) * section.arc)


class HertzLine(AbstractPressure):
    """Hertz's line contact on the round sleeve: half an ellipse over its width, p = p0 sqrt(1 - (x/b)^2). This is the
    model of Qian et al. 2022. Wear does not change it, so it overestimates pressures once the worn sleeve fits the pin
    better.
    """

    def prepare(self, section):
        def part(x):
            return 0.5 + (x * safe_sqrt(1 - x * x) + jnp.arcsin(x)) / np.pi

        return lambda at: _spread(section, at, self.half_angle(section.geometry, at.force), part)

    def half_angle(self, geometry, force):
        return hertz_half_angle(geometry, force)

    def shape(self, place):
        return (1 - place * place) ** 0.5


class Uniform(AbstractPressure):
    """The same pressure all over a patch.

    **Arguments:** `spread`: how far the patch reaches to either side [rad]; `None`: the width of Hertz's line contact,
    p = F / (2 b B).
    """

    spread: Scalar | None = physical(
        "rad",
        above=0.0,
        default=None,
        help="how far the patch reaches to either side",
        example='"20 deg"',
        absent="Hertz's width",
    )

    def prepare(self, section):
        return lambda at: _spread(section, at, self.half_angle(section.geometry, at.force), lambda x: 0.5 * (1 + x))

    def half_angle(self, geometry, force):
        return hertz_half_angle(geometry, force) if self.spread is None else jnp.asarray(self.spread)

    def shape(self, place):
        return 1 + 0 * place


class Foundation(AbstractPressure):
    """An elastic layer on the worn sleeve: p = k u, with the depth u to which the pin stands in the layer. The pin is
    pressed on along the force until the components of the pressures along the force add up to it.

    On a round sleeve with the clearance c, and the pin's centre at the distance e from its own, u = e cos t - c at the
    angle t from the force, where this is positive. So the patch reaches to cos a = c / e. On a worn sleeve the wear is
    subtracted from u.

    **Arguments:** `stiffness` k [Pa/m]; the function `foundation` computes it from a material and a thickness.
    """

    stiffness: Scalar = physical("Pa/m", above=0.0, help="pressure by depth", example='"2e13 Pa/m"')

    @property
    def rises(self):
        return self.stiffness

    is_narrow: ClassVar[bool] = False

    def prepare(self, section):
        geometry, worn = section.geometry, refine(section.depth, PARTS)
        count = worn.shape[0]
        fine = 2 * np.pi * ((np.arange(count) + 0.5) / count - 0.5 / section.sectors)
        cosines, sines, width = jnp.asarray(np.cos(fine)), jnp.asarray(np.sin(fine)), section.arc / PARTS

        def means(at: SectionLoad):
            along = cosines * jnp.cos(at.angle) + sines * jnp.sin(at.angle)
            ahead = along > 0
            along = jnp.where(ahead, along, 1.0)
            gap = geometry.radial_clearance + worn - at.place[0] * cosines - at.place[1] * sines

            def depth(shift, gap):
                return jnp.where(ahead, jnp.maximum(shift * along - gap, 0.0), 0.0)

            def newton(shift, stiffness, force, gap):
                now = depth(shift, gap)
                borne = stiffness * width * jnp.sum(now * along)
                rises = stiffness * width * jnp.sum(jnp.where(now > 0, along * along, 0.0))
                return shift - (borne - force) / jax.lax.stop_gradient(jnp.where(rises > 0, rises, 1.0))

            # The force is a convex, rising function of the depth. So from below one step goes beyond the solution, and
            # all further ones come down to it. Begin where a narrow patch on a round sleeve would be.
            asked = self.stiffness, at.force, gap
            stiffness, force, still = jax.tree.map(jax.lax.stop_gradient, asked)
            first = jnp.min(jnp.where(ahead, still / along, jnp.inf))
            clearance = jax.lax.stop_gradient(geometry.radial_clearance)
            load = 1.5 * force / (stiffness * jax.lax.stop_gradient(geometry.sleeve_radius) * clearance)

            def closer(carry):
                count, shift, _ = carry
                further = newton(shift, stiffness, force, still)
                return count + 1, further, jnp.abs(further - shift) > NEAR * clearance

            begin = first + 0.5 * clearance * jnp.cbrt(load * load)
            begin = jnp.asarray(0), begin, jnp.asarray(True)
            shift = jax.lax.while_loop(lambda carry: carry[2] & (carry[0] < ITERATIONS), closer, begin)[1]
            # Each further iteration adds an order of derivatives: two give the first and the second.
            shift = jax.lax.stop_gradient(shift)
            for _ in range(2):
                shift = newton(shift, *asked)
            pressure = jnp.where(at.force > 0, self.stiffness * depth(shift, gap), 0.0)
            return PressureField(jnp.mean(pressure.reshape(-1, PARTS), axis=1), width * jnp.sum(pressure * along))

        return means

    def half_angle(self, geometry, force):
        # Solve F' = k R e (a - sin a cos a), cos a = c / e, by Newton's method from the narrow patch.
        scale = force / (self.stiffness * geometry.sleeve_radius * geometry.radial_clearance)

        def newton(_, a):
            value = (a - jnp.sin(a) * jnp.cos(a)) / jnp.cos(a)
            rises = 2 * jnp.sin(a) ** 2 / jnp.cos(a) + value * jnp.tan(a)
            return jnp.clip(a - (value - scale) / jnp.where(rises > 0, rises, 1.0), 1e-9, 0.5 * np.pi - 1e-9)

        narrow = jnp.minimum(jnp.cbrt(1.5 * scale), 1.5)
        return jnp.where(force > 0, jax.lax.fori_loop(0, ITERATIONS, newton, jnp.maximum(narrow, 1e-9)), 0.0)


def foundation(material: Material, thickness: float) -> Foundation:
    """The foundation that an elastic layer on a rigid base makes: k = (1 - nu) E / ((1 + nu)(1 - 2 nu) h).

    **Arguments:** `material` of the layer (E, nu); `thickness` h [m].
    """
    nu = material.poisson_ratio
    return Foundation((1 - nu) * material.modulus / ((1 + nu) * (1 - 2 * nu) * thickness))


def refine(values: Float[Array, " sectors"], parts: int) -> Float[Array, " fine"]:
    """Values of the sectors' spline at the middles of `parts` parts of each sector; `parts` is even."""
    return jnp.roll(spline(values, (np.arange(parts) + 0.5) / parts).ravel(), parts // 2)
