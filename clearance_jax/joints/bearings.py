"""Rolling bearings as joints with play, and those of robot joints under preload, which wear takes away.

    rolling_bearing(bore=0.025, group="C3", balls=9, ball_diameter=7.94e-3)
    crossed_roller(0.1, rollers=60, roller_length=6e-3, radial_clearance=5e-6, preload=500)  # as new
    crossed_roller(0.1, rollers=60, roller_length=6e-3, radial_clearance=20e-6)  # worn: the preload is gone

**Source:** the groups of radial internal clearance of deep-groove ball bearings and of cylindrical roller bearings,
with a cylindrical bore, are those of ISO 5753-1, as makers reprint them, for bores up to 100 mm.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from clearance_jax.errors import ClearanceError, unknown_name, wrong_value
from clearance_jax.joints.checks import check_known, check_sizes
from clearance_jax.joints.elements import PreloadedBearing
from clearance_jax.joints.fitting import Tolerance
from clearance_jax.joints.pin import RevoluteClearance
from clearance_jax.joints.presets import DAMPING
from clearance_jax.joints.sleeve import SleeveClearance
from clearance_jax.laws import AbstractFrictionLaw, HuntCrossley

GROUPS = ("C2", "CN", "C3", "C4", "C5")
# Least and greatest radial internal clearance [um], at the diameter, of these groups, by the upper bound of the range
# of the bore [mm] ("over ... up to and including").
# fmt: off
OF_BALLS = {
    6: ((0, 7), (2, 13), (8, 23)),
    10: ((0, 7), (2, 13), (8, 23), (14, 29), (20, 37)),
    18: ((0, 9), (3, 18), (11, 25), (18, 33), (25, 45)),
    24: ((0, 10), (5, 20), (13, 28), (20, 36), (28, 48)),
    30: ((1, 11), (5, 20), (13, 28), (23, 41), (30, 53)),
    40: ((1, 11), (6, 20), (15, 33), (28, 46), (40, 64)),
    50: ((1, 11), (6, 23), (18, 36), (30, 51), (45, 73)),
    65: ((1, 15), (8, 28), (23, 43), (38, 61), (55, 90)),
    80: ((1, 15), (10, 30), (25, 51), (46, 71), (65, 105)),
    100: ((1, 18), (12, 36), (30, 58), (53, 84), (75, 120)),
}
OF_ROLLERS = {
    24: ((0, 25), (20, 45), (35, 60), (50, 75), (65, 90)),
    30: ((0, 25), (20, 45), (35, 60), (50, 75), (70, 95)),
    40: ((5, 30), (25, 50), (45, 70), (60, 85), (80, 105)),
    50: ((5, 35), (30, 60), (50, 80), (70, 100), (95, 125)),
    65: ((10, 40), (40, 70), (60, 90), (80, 110), (110, 140)),
    80: ((10, 45), (40, 75), (65, 100), (90, 125), (130, 165)),
    100: ((15, 50), (50, 85), (75, 110), (105, 140), (155, 190)),
}
# fmt: on
SMALLEST, LARGEST = 2.5, 100

# Palmgren's approach of the rings at the most loaded element under the load Q: of balls of the diameter D in deep
# grooves 4.36e-4 mm Q^(2/3) / D^(1/3), of rollers of the length l 7.68e-5 mm Q^0.9 / l^0.8 (N, mm); here in SI.
BALLS = 4.36e-4 * 1e-3 / (1e3 ** (1 / 3))
ROLLERS = 7.68e-5 * 1e-3 / 1e3**0.8
# Stribeck: of a bearing with play the most loaded element carries so many times the radial load over their number.
MOST_LOADED = 5.0


def tabulated_clearance(bore: Any, group: str = "CN", rollers: bool = False) -> tuple[float, float]:
    """Least and greatest radial internal clearance [m], at the diameter, of a deep-groove ball bearing, or of a
    cylindrical roller bearing (`rollers`).

    **Arguments:** `bore` [m], from 2.5 to 100 mm; `group` C2, CN (normal), C3, C4 or C5.

    **Raises:** `ClearanceError` for what the tables do not have.
    """
    check_known("bore", bore, "the tables of ISO 5753-1 go by steps")
    if group not in GROUPS:
        raise unknown_name(f"`group` must be one of ISO 5753-1, but it is {group!r}.", str(group), GROUPS, "group")
    size = round(1e3 * float(bore), 6)
    if not SMALLEST <= size <= LARGEST:
        raise ClearanceError(
            f"`bore` must be from {SMALLEST} to {LARGEST} mm for a `group` of clearance, but it is {size:g} mm. Give "
            "the internal clearance instead."
        ).about("bore", bore)
    known = OF_ROLLERS if rollers else OF_BALLS
    row = known[next(bound for bound in known if size <= bound)]
    if GROUPS.index(group) >= len(row):
        message = f"There is no `group` {group} of a bore of {size:g} mm. Take {GROUPS[len(row) - 1]} at most."
        raise ClearanceError(message).about("group", group)
    least, greatest = row[GROUPS.index(group)]
    return least * 1e-6, greatest * 1e-6


def rolling_bearing(
    bore: Any,
    group: str | None = None,
    *,
    internal_clearance: Any = None,
    balls: int | None = None,
    ball_diameter: Any = None,
    rollers: int | None = None,
    roller_length: Any = None,
    friction: AbstractFrictionLaw | None = None,
) -> RevoluteClearance:
    r"""The radial play of a deep-groove ball bearing, or of a cylindrical roller bearing, with its stiffness.

    F = (Z / 5) Q(d). Q is Palmgren's load at which one of the Z elements gives way by d: (d / 4.36e-4)^(3/2) D^(1/2)
    for a ball, (d l^0.8 / 7.68e-5)^(10/9) for a roller (N, mm). The 5 is Stribeck's, for the most loaded element in a
    bearing with play (Palmgren, Grundlagen der Wälzlagertechnik, 1964; Harris, Rolling bearing analysis; for balls the
    estimate of Gargiulo, Machine Design 52, 1980). The rings stay round, and the film of oil gives no stiffness.

    **Arguments:**

    - `bore` [m]; `group` of ISO 5753-1, by default CN, whose mean clearance is taken; or `internal_clearance` [m]: the
      radial one, measured at the diameter, of the mounted and warm bearing (it is less than that of a new one). It is
      used as it is.
    - `balls` and `ball_diameter` [m]; or `rollers` and `roller_length` [m].
    - `friction`: by default none.

    **Raises:** `ClearanceError` for what is missing, given twice, or not in the table.
    """
    if group is not None and internal_clearance is not None:
        raise ClearanceError("`group` has no effect beside the internal clearance itself. Give one of them.")
    of_balls, of_rollers = (balls, ball_diameter), (rollers, roller_length)
    if [None in of_balls, None in of_rollers].count(False) != 1 or (*of_balls, *of_rollers).count(None) != 2:
        raise ClearanceError(
            "A rolling bearing needs either `balls` (how many) and `ball_diameter`, or `rollers` and `roller_length`."
        )
    check_sizes(
        bore=bore, internal_clearance=internal_clearance, ball_diameter=ball_diameter, roller_length=roller_length
    )
    count = balls if balls is not None else rollers
    if isinstance(count, bool) or not isinstance(count, int) or count < 3:
        raise ClearanceError(f"A rolling bearing has at least 3 `balls` or `rollers`, but it is {count!r}.")
    if balls is not None:
        stiffness, exponent = ball_diameter**0.5 / BALLS**1.5, None
    else:
        stiffness, exponent = (roller_length**0.8 / ROLLERS) ** (10 / 9), 10 / 9
    tolerance = None
    if internal_clearance is None:
        least, greatest = tabulated_clearance(bore, group or "CN", rollers is not None)
        internal_clearance, tolerance = (least + greatest) / 2, Tolerance(least / 2, greatest / 2)
    law = HuntCrossley(count / MOST_LOADED * stiffness, DAMPING, exponent)
    return RevoluteClearance(internal_clearance / 2, bore / 2, law, friction, tolerance=tolerance)


# Under preload: elements bear along lines at the contact angle a to the plane of the rings, which are rigid. Each of
# two rows of N elements that hold each other under the axial preload P presses its elements with Q = P / (N sin a),
# which give way by d there (Palmgren), with the slope k = dQ/dd. For small motions all of them are springs k, of which
# a radial motion loads half: N k cos^2 a radially, 2 N k sin^2 a axially, N k e^2 against tilt, with the lever e = b
# cos a + r sin a (b: half the spread of the rows, whose lines meet outside of them; r: the pitch radius). An element
# comes loose where its ring has moved by d: at the force (stiffness times d / cos a, d / sin a or d / e) that is the
# element's preload here.

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

    def centring_element(self, preload: Any) -> PreloadedBearing:
        """The element that holds the rings in the middle of their play."""
        across, along = jnp.cos(self.angle), jnp.sin(self.angle)
        deep = (preload / (self.count * along * self.factor)) ** (1 / self.power)
        stiff = self.count * self.power * self.factor * deep ** (self.power - 1)
        radial, axial, tilt = stiff * across**2, 2 * stiff * along**2, stiff * self.lever**2
        loose = radial * deep / across, axial * deep / along, tilt * deep / self.lever
        return PreloadedBearing(radial, axial, tilt, *loose)

    def with_play(self, radial_clearance: Any, preload: Any, friction: AbstractFrictionLaw | None) -> SleeveClearance:
        """The joint: a sleeve so long that its tilt ends where the elements' own play does."""
        across = jnp.cos(self.angle)
        # Both rows bear a radial load, each element along its line.
        law = HuntCrossley(2 * self.count / MOST_LOADED * self.factor * across ** (self.power + 1), DAMPING, self.power)
        length = 2 * self.lever / across
        element = None if preload is None else self.centring_element(preload)
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
    check_sizes(pitch_diameter=pitch_diameter, roller_length=roller_length, radial_clearance=radial_clearance)
    check_sizes("N", preload=preload)
    factor = (roller_length**0.8 / ROLLERS) ** (10 / 9)
    rows = Rows(count, factor, 10 / 9, CROSSED, pitch_diameter / 2)
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
    sizes = {"pitch_diameter": pitch_diameter, "ball_diameter": ball_diameter, "spread": spread}
    check_sizes(**sizes, radial_clearance=radial_clearance)
    check_sizes("N", preload=preload)
    if not isinstance(contact_angle, Tracer) and not 0 < contact_angle < np.pi / 2:
        raise wrong_value("`contact_angle`", "above 0 and below pi/2 rad", contact_angle, shown=repr(contact_angle))
    known = not any(isinstance(size, Tracer) for size in (*sizes.values(), radial_clearance))
    if known and not count * ball_diameter < np.pi * pitch_diameter:
        text = f"{count} `balls` of {ball_diameter:g} m do not fit on a circle of {pitch_diameter:g} m."
        raise ClearanceError(text).about("balls", count)
    factor = ball_diameter**0.5 / BALLS**1.5
    rows = Rows(count, factor, 1.5, contact_angle, pitch_diameter / 2, spread / 2)
    return rows.with_play(radial_clearance, preload, friction)


def _check_count(name: str, count: Any, least: int) -> int:
    if isinstance(count, bool) or not isinstance(count, int) or count < least:
        raise ClearanceError(f"A bearing has at least {least} `{name}`, but it is {count!r}.").about(name, count, least)
    return count
