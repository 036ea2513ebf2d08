"""Bearings of robot joints, under preload or worn: crossed rollers, pairs of ball bearings.

    crossed_roller(0.1, rollers=60, roller_length=6e-3, radial_clearance=5e-6, preload=500)  # as new
    crossed_roller(0.1, rollers=60, roller_length=6e-3, radial_clearance=20e-6)  # worn: the preload is gone

Elements bear along lines at the contact angle a to the plane of the rings. Rings are rigid. Each of two rows of N
elements that hold each other under the axial preload P presses its elements with Q = P / (N sin a), which give way by d
there (Palmgren), with the slope k = dQ/dd. For small motions all of them are springs k, of which a radial motion loads
half: N k cos^2 a radially, 2 N k sin^2 a axially, N k e^2 against tilt, with the lever e = b cos a + r sin a (b: half
the spread of the rows, whose lines meet outside of them; r: the pitch radius). An element comes loose where its ring
has moved by d: at the force (stiffness times d / cos a, d / sin a or d / e) that is the element's preload here.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from clearance_jax.errors import ClearanceError
from clearance_jax.joints.bearings import BALLS, MOST_LOADED, ROLLERS
from clearance_jax.joints.checks import check_sizes
from clearance_jax.joints.elements import ROLLING_DAMPING, PreloadedBearing
from clearance_jax.joints.presets import DAMPING
from clearance_jax.joints.sleeve import SleeveClearance
from clearance_jax.laws import AbstractFrictionLaw, HuntCrossley

CROSSED = np.pi / 4


class Rows(NamedTuple):
    """Two rows of elements: the number in each, the load Q [N] at which one gives way by d [m], Q = `factor` d^`power`,
    their contact angle [rad], pitch radius and half the rows' spread [m].
    """

    count: float
    factor: Any
    power: float
    angle: Any
    radius: Any
    half_spread: Any = 0.0

    @property
    def lever(self) -> Any:
        """The lever of an element's line about the middle of the bearing [m]."""
        return self.half_spread * jnp.cos(self.angle) + self.radius * jnp.sin(self.angle)

    def centring_element(self, preload: Any, damping_time: Any) -> PreloadedBearing:
        """The element that holds the rings in the middle of their play."""
        across, along = jnp.cos(self.angle), jnp.sin(self.angle)
        deep = (preload / (self.count * along * self.factor)) ** (1 / self.power)
        stiff = self.count * self.power * self.factor * deep ** (self.power - 1)
        radial, axial, tilt = stiff * across**2, 2 * stiff * along**2, stiff * self.lever**2
        loose = radial * deep / across, axial * deep / along, tilt * deep / self.lever
        return PreloadedBearing(radial, axial, tilt, *loose, damping_time)

    def with_play(self, radial_clearance: Any, preload: Any, friction: AbstractFrictionLaw | None) -> SleeveClearance:
        """The joint: a sleeve so long that its tilt ends where the elements' own play does."""
        across = jnp.cos(self.angle)
        # Both rows bear a radial load, each element along its line.
        law = HuntCrossley(2 * self.count / MOST_LOADED * self.factor * across ** (self.power + 1), DAMPING, self.power)
        length = 2 * self.lever / across
        element = None if preload is None else self.centring_element(preload, ROLLING_DAMPING)
        numbers: Any = {"pin_radius": self.radius, "length": length, "element": element}
        return SleeveClearance(radial_clearance=radial_clearance, normal=law, friction=friction, **numbers)


def crossed_roller(
    pitch_diameter: Any,
    *,
    rollers: int,
    roller_length: Any,
    radial_clearance: Any,
    preload: Any = None,
    friction: AbstractFrictionLaw | None = None,
) -> SleeveClearance:
    """A joint of an industrial arm on a crossed-roller bearing: each roller leans by 45 degrees, every other one to the
    other side.

    **Arguments:**

    - `pitch_diameter`, `roller_length` [m]; `rollers`: how many in all.
    - `radial_clearance`: the radial play [m] that appears when the load overcomes the preload; without preload the
      whole play.
    - `preload`: the axial force [N] with which one half of the rollers presses on the other in a new bearing; `None`:
      worn off.
    - `friction`: of the rollers where they touch; by default none.

    **Raises:** `ClearanceError` for numbers that make no bearing.

    **Source:** Palmgren's line contact.
    """
    count = _check_count("rollers", rollers, 6) / 2
    if rollers % 2:
        raise ClearanceError(f"`rollers` must be even, one half leaning each way, but there are {rollers}.")
    sizes = _check(
        preload, pitch_diameter=pitch_diameter, roller_length=roller_length, radial_clearance=radial_clearance
    )
    factor = (sizes["roller_length"] ** 0.8 / ROLLERS) ** (10 / 9)
    rows = Rows(count, factor, 10 / 9, CROSSED, sizes["pitch_diameter"] / 2)
    return rows.with_play(radial_clearance, preload, friction)


def angular_contact_pair(
    pitch_diameter: Any,
    *,
    balls: int,
    ball_diameter: Any,
    contact_angle: Any,
    spread: Any,
    radial_clearance: Any,
    preload: Any = None,
    friction: AbstractFrictionLaw | None = None,
) -> SleeveClearance:
    """A joint on two angular-contact ball bearings back to back, each with so many `balls`.

    **Arguments:** `pitch_diameter`, `radial_clearance` [m], `preload` [N] and `friction` as of `crossed_roller`;
    `ball_diameter` [m]; `contact_angle` [rad], above 0 and below pi / 2; `spread`: the distance between the two rows of
    balls [m].

    **Raises:** `ClearanceError` for numbers that make no bearing.

    **Source:** Palmgren's point contact.
    """
    count = _check_count("balls", balls, 3)
    given = {"pitch_diameter": pitch_diameter, "ball_diameter": ball_diameter, "spread": spread}
    sizes = _check(preload, **given, radial_clearance=radial_clearance)
    if not isinstance(contact_angle, Tracer) and not 0 < contact_angle < np.pi / 2:
        raise ClearanceError(f"`contact_angle` must be above 0 and below pi/2 rad, but it is {contact_angle!r}.")
    if not any(isinstance(x, Tracer) for x in sizes.values()) and not (
        count * sizes["ball_diameter"] < np.pi * sizes["pitch_diameter"]
    ):
        raise ClearanceError(
            f"{count} `balls` of {sizes['ball_diameter']:g} m do not fit on a circle of {sizes['pitch_diameter']:g} m."
        )
    factor = sizes["ball_diameter"] ** 0.5 / BALLS**1.5
    rows = Rows(count, factor, 1.5, contact_angle, sizes["pitch_diameter"] / 2, sizes["spread"] / 2)
    return rows.with_play(radial_clearance, preload, friction)


def _check_count(name: str, count: Any, least: int) -> int:
    if isinstance(count, bool) or not isinstance(count, int) or count < least:
        raise ClearanceError(f"A bearing has at least {least} `{name}`, but it is {count!r}.")
    return count


def _check(preload: Any, **sizes: Any) -> dict[str, Any]:
    check_sizes(**sizes)
    if preload is not None:
        check_sizes("N", preload=preload)
    return sizes
