"""Backlash and errors of spur gears from what a drawing says: module, teeth, DIN 3967 class, centre distance.

    backlash(1e-3, (20, 40), "cd25").wheel_angle  # (0.0054, 0.0084) rad: 18.6 to 28.9 arcmin

Lengths are in metres, angles in rad. A class such as "cd25" names the upper allowance of the tooth thickness, "cd", and
the series of its tolerance, 25; a drawing writes 25cd. Thinner teeth make a pair looser. So does a larger centre
distance, and in a ring a smaller one.

**Source:** DIN 3967:1978, tables 1 and 2; ISO/TR 10064-2 and ISO 1328-1:2013, their formulas; geometry of involutes.
"""

import bisect
import math
import re
from typing import Any, NamedTuple, SupportsFloat

from clearance_jax.errors import ClearanceError, quote, unknown_name, wrong_value
from clearance_jax.joints.checks import check_known, check_sizes

__all__ = [
    "COMMON", "GearBacklash", "assumed_transmission_error", "backlash", "flank_tolerances", "least_normal_backlash",
    "normal_backlash", "thickness_allowances",
]  # fmt: skip

PRESSURE_ANGLE = math.radians(20)
ARC_MINUTE = math.pi / 10800
# Upper bounds [mm] of the ranges of reference diameters, "over ... up to and including".
RANGES = (10, 50, 125, 280, 560, 1000, 1600, 2500, 4000, 6300, 10000)
# By how much [um] the thickest tooth is thinner than the nominal one (the upper allowance, without its sign).
# fmt: off
ALLOWANCES = {
    "a": (100, 135, 180, 250, 330, 450, 600, 820, 1100, 1500, 2000),
    "ab": (85, 110, 150, 200, 280, 370, 500, 680, 920, 1250, 1650),
    "b": (70, 95, 125, 170, 230, 310, 420, 560, 760, 1020, 1350),
    "bc": (58, 75, 105, 140, 190, 260, 340, 460, 620, 840, 1150),
    "c": (48, 65, 85, 115, 155, 210, 290, 390, 520, 700, 940),
    "cd": (40, 54, 70, 95, 130, 175, 240, 320, 430, 580, 780), "d": (33, 44, 60, 80, 110, 145, 200, 270, 360, 480, 640),
    "e": (22, 30, 40, 56, 75, 100, 135, 180, 250, 330, 450), "f": (10, 14, 19, 26, 35, 48, 64, 85, 115, 155, 210),
    "g": (5, 7, 9, 12, 17, 22, 30, 41, 56, 75, 100), "h": (0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
}
# Tolerance of the tooth thickness [um] of each series.
TOLERANCES = {
    21: (3, 5, 6, 8, 10, 12, 16, 20, 25, 30, 40), 22: (5, 8, 10, 12, 16, 20, 25, 30, 40, 50, 60),
    23: (8, 12, 16, 20, 25, 30, 40, 50, 60, 80, 100), 24: (12, 20, 25, 30, 40, 50, 60, 80, 100, 130, 160),
    25: (20, 30, 40, 50, 60, 80, 100, 130, 160, 200, 250), 26: (30, 50, 60, 80, 100, 130, 160, 200, 250, 300, 400),
    27: (50, 80, 100, 130, 160, 200, 250, 300, 400, 500, 600),
    28: (80, 130, 160, 200, 250, 300, 400, 500, 600, 800, 1000),
    29: (130, 200, 250, 300, 400, 500, 600, 800, 1000, 1300, 1600),
    30: (200, 300, 400, 500, 600, 800, 1000, 1300, 1600, 2000, 2400),
}
# fmt: on
COMMON = ("ab25", "c25", "c24", "cd25", "cd24", "d26", "d25", "d24", "e25", "e24", "f25", "f24", "g22")
"""The classes that Niemann gives for turbines (ab25), polymer gears (c25, cd25), machines in general that reverse (c25
to e24), cars (d26), machine tools (f25, f24) and gears of instruments (g22)."""


class GearBacklash(NamedTuple):
    """The backlash of a pair of gears of one drawing: each range is (least, greatest).

    - `name`: the class, "cd25", or those of both gears, "cd25/c24".
    - `normal` [m]: along the line of action; `circumferential` [m]: along the reference circles.
    - `pinion_angle`, `wheel_angle` [rad]: by how much one gear turns while the other one is held.
    """

    name: str
    normal: tuple[float, float]
    circumferential: tuple[float, float]
    pinion_angle: tuple[float, float]
    wheel_angle: tuple[float, float]

    def __str__(self) -> str:
        (least, most), (low, high) = self.circumferential, self.wheel_angle
        angles = f"{low / ARC_MINUTE:.4g} to {high / ARC_MINUTE:.4g} arcmin at the wheel"
        return f"{self.name}: backlash {1e6 * least:.4g} to {1e6 * most:.4g} um, {angles}"


def thickness_allowances(diameter: SupportsFloat, tolerance_class: str) -> tuple[float, float]:
    """Lower and upper allowance [m] of the thickness of teeth, both at most 0 (E_sni, E_sns of DIN 3967), for the
    `diameter` of the reference circle [m] and a `tolerance_class`, "cd25". **Raises:** `ClearanceError` as `backlash`.
    """
    size, (letters, series) = _above_zero("diameter", diameter), _class(tolerance_class)
    if size > 10:
        raise wrong_value("`diameter`", "at most 10 m, where the tables of DIN 3967 end", size)
    row = bisect.bisect_left(RANGES, round(1e3 * size, 6))
    upper = ALLOWANCES[letters][row]
    return -(upper + TOLERANCES[series][row]) / 1e6, (0.0 - upper) / 1e6  # not -upper: that of an h would be -0.0


def normal_backlash(
    module: SupportsFloat, teeth: tuple[int, int], centre_distance: SupportsFloat,
    pressure_angle: float = PRESSURE_ANGLE, profile_shift: float = 0.0,
) -> float:  # fmt: skip
    """The backlash along the line of action [m] of a pair without allowances; below 0: the teeth overlap. Exact:

        j = m (z1 + z2) cos(a) (inv(w) - inv(a)) - 2 m x sin(a),   cos(w) = m (z1 + z2) cos(a) / (2 A)

    with inv(a) = tan(a) - a: about 2 sin(a) times the change of A. **Arguments:** as of `backlash`: `module` m, `teeth`
    z1, z2, `centre_distance` A, `pressure_angle` a, `profile_shift` x. **Raises:** `ClearanceError` as `backlash`.
    """
    m, z = _gears(module, teeth, pressure_angle)
    nominal, distance = m * z / 2, _above_zero("centre_distance", centre_distance)
    cosine = abs(nominal) * math.cos(pressure_angle) / distance
    # The tips of unshifted gears reach one module beyond the reference circles.
    if not (cosine < 1 and abs(distance - abs(nominal)) <= (2 + abs(profile_shift)) * m):
        text = f"`centre_distance` must be such that the teeth mesh, near {abs(nominal):g} m, but it is {distance:g} m."
        raise ClearanceError(f"{text} Give it in metres.").about("centre_distance", distance, abs(nominal))
    a, w = pressure_angle, math.acos(cosine)
    gap = 2 * nominal * math.cos(a) * (math.tan(w) - w - math.tan(a) + a) - 2 * m * profile_shift * math.sin(a)
    return round(gap, 15)  # what is left at the nominal distance is noise of the functions


def backlash(
    module: SupportsFloat, teeth: tuple[int, int], tolerance_class: str | tuple[str, str], *,
    centre_distance: SupportsFloat | None = None, centre_tolerance: float | tuple[float, float] = 0.0,
    pressure_angle: float = PRESSURE_ANGLE, profile_shift: float = 0.0,
) -> GearBacklash:  # fmt: skip
    """The least and the greatest backlash of a pair of spur gears that are within their tolerances.

    **Arguments:**

    - `module` [m]; `teeth` of pinion and wheel, at least 5; those of a ring below zero: (20, -60).
    - `tolerance_class` of DIN 3967, "cd25", of both gears or of each.
    - `centre_distance` [m]; `None`: the sum of the reference radii (of a ring: their difference).
    - `centre_tolerance` [m]: its deviation to both sides, or (lower, upper). Add the radial play of both bearings.
    - `pressure_angle` [rad] of the reference profile.
    - `profile_shift`: the sum of the coefficients of both gears. Shifted gears need a `centre_distance`.

    **Raises:** `ClearanceError` for numbers out of range, an unknown class, and gears that do not mesh or may jam.
    """
    m, z = _gears(module, teeth, pressure_angle)
    apart = isinstance(tolerance_class, tuple) and len(tolerance_class) == 2
    names = ["{}{}".format(*_class(name)) for name in (tolerance_class if apart else [tolerance_class] * 2)]
    if profile_shift and centre_distance is None:
        raise ClearanceError("Shifted gears need their `centre_distance`: it is not the sum of their reference radii.")
    distance = m * abs(z) / 2 if centre_distance is None else _above_zero("centre_distance", centre_distance)
    lower, upper = centre_tolerance if isinstance(centre_tolerance, tuple) else (-centre_tolerance, centre_tolerance)
    if not (math.isfinite(upper - lower) and lower <= upper):
        allowed = "one deviation of at least 0 m, or a lower and an upper one"
        raise wrong_value("`centre_tolerance`", allowed, centre_tolerance)
    gaps = [normal_backlash(m, teeth, distance + x, pressure_angle, profile_shift) for x in (lower, upper)]
    parts = [thickness_allowances(m * abs(count), name) for count, name in zip(teeth, names, strict=True)]
    thinnest, thickest = (-sum(ends) * math.cos(pressure_angle) for ends in zip(*parts, strict=True))
    name, normal = "/".join(dict.fromkeys(names)), (min(gaps) + thickest, max(gaps) + thinnest)
    if normal[0] < 0:
        text = f"Teeth of `tolerance_class` {name} may jam: they overlap by {-1e6 * normal[0]:.3g} um at worst."
        raise ClearanceError(f"{text} Take a looser one, or another centre distance.").about("tolerance_class", name)
    sizes = (math.cos(pressure_angle) * size for size in (1.0, m * teeth[0] / 2, m * abs(teeth[1]) / 2))
    return GearBacklash(name, normal, *((normal[0] / size, normal[1] / size) for size in sizes))


def least_normal_backlash(module: SupportsFloat, centre_distance: SupportsFloat) -> float:
    """The least backlash along the line of action [m] that ISO/TR 10064-2 recommends for industrial gears: 2/3 (0.06 +
    0.0005 A + 0.03 m) mm, with the `module` m (its table begins with 1.5 mm) and the `centre_distance` A [m].
    """
    m, distance = _above_zero("module", module), _above_zero("centre_distance", centre_distance)
    return (0.06e-3 + 0.0005 * distance + 0.03 * m) * 2 / 3


def flank_tolerances(module: SupportsFloat, teeth: int, flank_class: int) -> dict[str, float]:
    """The tolerances of ISO 1328-1:2013 for the flanks of one gear [m], not rounded: `single_pitch` (f_pT),
    `cumulative_pitch` (F_pT), `profile_slope` (f_HaT), `profile_form` (f_faT) and the whole `profile` (F_aT).

    **Arguments:** `module` [m], from 0.5 to 70 mm; `teeth`: 5 to 1000; `flank_class`: 1 (the finest) to 11.

    **Raises:** `ClearanceError` for what the standard does not have, also a reference diameter below 5 mm.
    """
    m = round(1e3 * _above_zero("module", module), 9)
    if flank_class not in range(1, 12):
        raise wrong_value("`flank_class`", "a class of ISO 1328-1, 1 to 11", flank_class)
    if not (0.5 <= m <= 70 and type(teeth) is int and 5 <= teeth <= 1000 and 5 <= (d := m * teeth) <= 15000):
        allowed = f"of a gear of ISO 1328-1 (module {m:g} from 0.5 to 70 mm, 5 to 1000 teeth, 5 mm to 15 m across)"
        raise wrong_value("`teeth`", allowed, teeth)
    slope, form = 0.4 * m + 0.001 * d + 4, 0.55 * m + 5
    sizes = {"single_pitch": slope + 1, "cumulative_pitch": 0.002 * d + 0.55 * math.sqrt(d) + 0.7 * m + 12}
    sizes |= {"profile_slope": slope, "profile_form": form, "profile": math.hypot(slope, form)}
    return {name: size * math.sqrt(2) ** (flank_class - 5) / 1e6 for name, size in sizes.items()}


def assumed_transmission_error(
    module: SupportsFloat, teeth: int, flank_class: int, pressure_angle: float = PRESSURE_ANGLE
) -> tuple[float, float]:
    """An estimate of a gear's transmission error where none was measured, as amplitudes [rad]: once a turn F_pT / (2
    r_b), at each tooth f_pT / (2 r_b). No standard says so; loaded teeth differ. Add that of the mate.

    **Arguments:** `pressure_angle` [rad]; `module`, `teeth`, `flank_class` and **Raises:** as `flank_tolerances`.
    """
    tolerances, (m, _) = flank_tolerances(module, teeth, flank_class), _gears(module, (5, 5), pressure_angle)
    diameter = m * teeth * math.cos(pressure_angle)
    return tolerances["cumulative_pitch"] / diameter, tolerances["single_pitch"] / diameter


def _gears(module: Any, teeth: Any, pressure_angle: float) -> tuple[float, int]:
    """The module [m] and the sum of the teeth, that of a ring below zero, of gears that can be made."""
    m = _above_zero("module", module)
    whole = isinstance(teeth, tuple) and len(teeth) == 2 and all(type(count) is int for count in teeth)
    if not whole or teeth[0] < 5 or abs(teeth[1]) < 5 or teeth[1] < 0 <= sum(teeth) + 2:
        allowed = "a pair (z1, z2) of whole numbers from 5 on; z2 of a ring below zero, and larger than z1"
        raise wrong_value("`teeth`", allowed, teeth, quote(teeth))
    if not 0 < pressure_angle < math.pi / 4:
        allowed, fix = "above 0 and below pi/4 rad", "20 degrees are 0.349 rad."
        raise wrong_value("`pressure_angle`", allowed, pressure_angle, f"{pressure_angle:g}", fix)
    return m, sum(teeth)


def _class(tolerance_class: Any) -> tuple[str, int]:
    """The letters and the series of a class of DIN 3967."""
    match = re.fullmatch(r"([a-h]+)(\d+)|(\d+)([a-h]+)", str(tolerance_class).strip())
    letters, series = (match[1] or match[4], int(match[2] or match[3])) if match else ("", 0)
    if letters not in ALLOWANCES or series not in TOLERANCES:
        text = f"`tolerance_class` must be one of DIN 3967, letters and a series, but it is {quote(tolerance_class)}."
        classes = [f"{letters}{series}" for letters in ALLOWANCES for series in TOLERANCES]
        raise unknown_name(text, str(tolerance_class), classes, "tolerance_class")
    return letters, series


def _above_zero(name: str, size: Any) -> float:
    """A plain number above zero. **Raises:** `ClearanceError`, naming it."""
    check_known(name, size, "tables and classes go by steps")
    check_sizes(**{name: size})
    return float(size)
