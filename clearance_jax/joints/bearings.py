"""Rolling bearings as joints with play: their radial internal clearance, and the stiffness of their class.

    rolling_bearing(bore=0.025, group="C3", balls=9, ball_diameter=7.94e-3)

**Source:** the groups of radial internal clearance of deep-groove ball bearings and of cylindrical roller bearings,
with a cylindrical bore, are those of ISO 5753-1, as makers reprint them, for bores up to 100 mm.
"""

from typing import Any

from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.joints.checks import check_known, check_sizes
from clearance_jax.joints.fitting import Tolerance
from clearance_jax.joints.presets import DAMPING
from clearance_jax.joints.revolute import RevoluteClearance
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
        raise ClearanceError(f"`group` must be one of ISO 5753-1, but it is {group!r}. " + suggest(str(group), GROUPS))
    size = round(1e3 * float(bore), 6)
    if not SMALLEST <= size <= LARGEST:
        raise ClearanceError(
            f"`bore` must be from {SMALLEST} to {LARGEST} mm for a `group` of clearance, but it is {size:g} mm. Give "
            "the internal clearance instead."
        )
    known = OF_ROLLERS if rollers else OF_BALLS
    row = known[next(bound for bound in known if size <= bound)]
    if GROUPS.index(group) >= len(row):
        raise ClearanceError(
            f"There is no `group` {group} of a bore of {size:g} mm. Take {GROUPS[len(row) - 1]} at most."
        )
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
