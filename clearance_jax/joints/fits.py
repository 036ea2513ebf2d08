"""ISO 286 limits and fits: from a nominal diameter and a name such as "H7/g6" to clearances, and back.

    fit(0.025, "H7/g6").radial_clearance    # (3.5e-06, 2.05e-05) m
    fits_within(0.025, 25e-6)               # the common clearance fits no looser than 25 um, the loosest first

All lengths at the interface are in metres; the tables are the standard's, in mm and um.

**Source:** ISO 286-1:2010, tables 1 (standard tolerances), 4 and 5 (fundamental deviations of shafts), and the general
rule EI = -es for holes A to H; values as reprinted in Narayana, Kannaiah, Reddy, Machine Drawing (New Age), tables 15.1
to 15.3. Holes K to S follow from the shafts by the rule of the standard, ES = -ei, to which the fine grades above 3 mm
add IT_n - IT_(n-1) (`_hole`). Left out are the letters cd, ef, fg, j, t to zc. js is as defined, +-IT/2; some tables
round it down to whole um in grades 7 to 11.
"""

import bisect
import dataclasses
import re
from typing import SupportsFloat

from clearance_jax.errors import ClearanceError, wrong_value

LARGEST = 0.5  # [m]; above it the standard has other tables
# Upper bounds [mm] of the ranges of nominal diameter, "over ... up to and including"; the finer ones for a, b, c, r, s.
RANGES = (3, 6, 10, 18, 30, 50, 80, 120, 180, 250, 315, 400, 500)
FINE_RANGES = (3, 6, 10, 18, 30, 40, 50, 65, 80, 100, 120, 140, 160, 180, 200, 225, 250, 280, 315, 355, 400, 450, 500)

# Standard tolerance [um] of each grade.
TOLERANCES = {
    3: (2, 2.5, 2.5, 3, 4, 4, 5, 6, 8, 10, 12, 13, 15),
    4: (3, 4, 4, 5, 6, 7, 8, 10, 12, 14, 16, 18, 20),
    5: (4, 5, 6, 8, 9, 11, 13, 15, 18, 20, 23, 25, 27),
    6: (6, 8, 9, 11, 13, 16, 19, 22, 25, 29, 32, 36, 40),
    7: (10, 12, 15, 18, 21, 25, 30, 35, 40, 46, 52, 57, 63),
    8: (14, 18, 22, 27, 33, 39, 46, 54, 63, 72, 81, 89, 97),
    9: (25, 30, 36, 43, 52, 62, 74, 87, 100, 115, 130, 140, 155),
    10: (40, 48, 58, 70, 84, 100, 120, 140, 160, 185, 210, 230, 250),
    11: (60, 75, 90, 110, 130, 160, 190, 220, 250, 290, 320, 360, 400),
    12: (100, 120, 150, 180, 210, 250, 300, 350, 400, 460, 520, 570, 630),
    13: (140, 180, 220, 270, 330, 390, 460, 540, 630, 720, 810, 890, 970),
    14: (250, 300, 360, 430, 520, 620, 740, 870, 1000, 1150, 1300, 1400, 1550),
    15: (400, 480, 580, 700, 840, 1000, 1200, 1400, 1600, 1850, 2100, 2300, 2500),
    16: (600, 750, 900, 1100, 1300, 1600, 1900, 2200, 2500, 2900, 3200, 3600, 4000),
}

# Fundamental deviation [um] of a shaft: its upper one (es) up to h, its lower one (ei) from k on.
# fmt: off
DEVIATIONS = {
    "a": (-270, -270, -280, -290, -300, -310, -320, -340, -360, -380, -410, -460,
          -520, -580, -660, -740, -820, -920, -1050, -1200, -1350, -1500, -1650),
    "b": (-140, -140, -150, -150, -160, -170, -180, -190, -200, -220, -240, -260,
          -280, -310, -340, -380, -420, -480, -540, -600, -680, -760, -840),
    "c": (-60, -70, -80, -95, -110, -120, -130, -140, -150, -170, -180, -200,
          -210, -230, -240, -260, -280, -300, -330, -360, -400, -440, -480),
    "d": (-20, -30, -40, -50, -65, -80, -100, -120, -145, -170, -190, -210, -230),
    "e": (-14, -20, -25, -32, -40, -50, -60, -72, -85, -100, -110, -125, -135),
    "f": (-6, -10, -13, -16, -20, -25, -30, -36, -43, -50, -56, -62, -68),
    "g": (-2, -4, -5, -6, -7, -9, -10, -12, -14, -15, -17, -18, -20),
    "h": (0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
    "k": (0, 1, 1, 1, 2, 2, 2, 3, 3, 4, 4, 4, 5),
    "m": (2, 4, 6, 7, 8, 9, 11, 13, 15, 17, 20, 21, 23),
    "n": (4, 8, 10, 12, 15, 17, 20, 23, 27, 31, 34, 37, 40),
    "p": (6, 12, 15, 18, 22, 26, 32, 37, 43, 50, 56, 62, 68),
    "r": (10, 15, 19, 23, 28, 34, 34, 41, 43, 51, 54, 63,
          65, 68, 77, 80, 84, 94, 98, 108, 114, 126, 132),
    "s": (14, 19, 23, 28, 35, 43, 43, 53, 59, 71, 79, 92,
          100, 108, 122, 130, 140, 158, 170, 190, 208, 232, 252),
}
# fmt: on
SHAFTS = (*DEVIATIONS, "js")
HOLES = tuple(letter.upper() for letter in SHAFTS)
# The grades of holes up to which the standard adds a difference of tolerances to their deviation.
ADDED = {"K": 8, "M": 8, "N": 8, "P": 7, "R": 7, "S": 7}

# The clearance fits that ISO 286-1:2010 recommends on the hole basis (b aside: it does not exist up to 1 mm), those
# that ANSI B4.2 prefers, and the running fits H7/f7 and F8/h6.
# fmt: off
COMMON = (
    "H6/g5", "H6/h5", "H7/f6", "H7/f7", "H7/g6", "H7/h6", "H8/d8", "H8/e7", "H8/e8", "H8/f7", "H8/f8", "H8/h7", "H8/h8",
    "H9/d8", "H9/d9", "H9/e8", "H9/f8", "H9/h8", "H10/c9", "H10/d9", "H10/e9", "H10/h9", "H11/c11", "H11/d10",
    "H11/h10", "G7/h6", "F8/h6", "F8/h7", "D9/h9", "C11/h11",
)
# fmt: on


@dataclasses.dataclass(frozen=True)
class Fit:
    """A hole and a shaft of one nominal diameter [m]; `hole` and `shaft` are (lower, upper) deviations from it [m]."""

    name: str
    diameter: float
    hole: tuple[float, float]
    shaft: tuple[float, float]

    @property
    def diametral_clearance(self) -> tuple[float, float]:
        """Least and greatest difference of the diameters of hole and shaft [m]; negative: interference."""
        # The tables have steps of half a um: rounding to the nm only removes the noise of binary fractions.
        return round(self.hole[0] - self.shaft[1], 9), round(self.hole[1] - self.shaft[0], 9)

    @property
    def radial_clearance(self) -> tuple[float, float]:
        """Least and greatest difference of the radii of hole and shaft [m]; negative: interference."""
        return self.diametral_clearance[0] / 2, self.diametral_clearance[1] / 2

    @property
    def is_clearance(self) -> bool:
        """Whether no hole within the limits is smaller than a shaft within the limits."""
        return self.diametral_clearance[0] >= 0

    def __str__(self) -> str:
        least, greatest = (f"{1e6 * clearance:g}" for clearance in self.radial_clearance)
        return f"{self.name} at {1e3 * self.diameter:g} mm: radial clearance {least} to {greatest} um"


def limit_deviations(diameter: SupportsFloat, tolerance_class: str) -> tuple[float, float]:
    """Lower and upper deviation [m] of a hole ("H7") or a shaft ("g6").

    **Arguments:**

    - `diameter`: nominal diameter [m], above 0 and up to 0.5.
    - `tolerance_class`: a letter (upper case: hole, one of `HOLES`; lower case: shaft, one of `SHAFTS`) and the grade
      of the standard tolerance, 3 to 16.

    **Raises:** `ClearanceError` for a diameter out of range, an unknown letter or grade, a malformed name, and for what
    the standard does not have: up to 1 mm a, b, A, B, N from grade 9 on, and the grades from 14 on; above 3 mm K from
    grade 9 on. Above 3 mm, holes K to S of grade 3 are not known here.
    """
    size = _millimetres(diameter)
    letter, grade = _letter_and_grade(tolerance_class)
    allowed, shown = "", f"{tolerance_class!r} at {size:g} mm"
    if size <= 1 and (letter in ("a", "b", "A", "B") or grade >= 14 or (letter == "N" and grade > 8)):
        allowed = "another than a, b, A, B, N from grade 9 on, or grades from 14 on up to 1 mm (ISO 286-1)"
    elif size > 3 and ((letter == "K" and grade > 8) or (letter in ADDED and grade == 3)):
        allowed = "of a grade from 4 on (K: 4 to 8) for holes K to S above 3 mm"
    if allowed:
        raise wrong_value("Argument `tolerance_class`", allowed, tolerance_class, shown)
    lower, upper = (_hole if letter in HOLES else _shaft)(size, letter.lower(), grade)
    return lower / 1e6, upper / 1e6


def fit(diameter: SupportsFloat, name: str) -> Fit:
    """The fit of that name, hole first ("H7/g6"), at a nominal diameter [m].

    **Raises:** `ClearanceError` for a name that is not a hole's and a shaft's, and as `limit_deviations`.
    """
    hole, slash, shaft = (part.strip() for part in name.partition("/"))
    if not slash or not hole[:1].isupper() or not shaft[:1].islower():
        allowed = "a hole and a shaft (upper case / lower case)"
        raise wrong_value("Argument `name`", allowed, name, repr(name), 'Write it as "H7/g6".')
    return Fit(f"{hole}/{shaft}", float(diameter), limit_deviations(diameter, hole), limit_deviations(diameter, shaft))


def fits_within(
    diameter: SupportsFloat, greatest_radial_clearance: SupportsFloat, least: SupportsFloat = 0.0
) -> tuple[Fit, ...]:
    """The `COMMON` fits whose radial clearances all lie in `[least, greatest_radial_clearance]` [m].

    The one with the largest greatest clearance comes first (of equals: as in `COMMON`); empty where none is so tight.

    **Raises:** `ClearanceError` for a diameter [m] out of range, and unless 0 <= least <= greatest.
    """
    # To the pm: a bound that was computed (half of a diametral clearance, say) must admit the fit it came from.
    lower, upper = round(float(least), 12), round(float(greatest_radial_clearance), 12)
    if not 0 <= lower <= upper:
        raise ClearanceError(
            f"Argument `greatest_radial_clearance` must be at least `least`, and `least` at least 0 (both in metres), "
            f"but they are {upper:g} and {lower:g}. Give the larger one first; interference fits are not listed."
        ).about("greatest_radial_clearance", upper, lower)
    common = (fit(diameter, name) for name in COMMON)
    fits = [f for f in common if lower <= f.radial_clearance[0] and f.radial_clearance[1] <= upper]
    return tuple(sorted(fits, key=lambda f: f.radial_clearance[1], reverse=True))


def _millimetres(diameter: SupportsFloat) -> float:
    metres = float(diameter)
    if not 0 < metres <= LARGEST:
        raise ClearanceError(
            f"Argument `diameter` must be above 0 and at most {LARGEST} m (the tables of ISO 286-1 used here), but it "
            f"is {metres:g} m. Give it in metres: 25 mm are 0.025."
        ).about("diameter", metres, LARGEST)
    return round(1e3 * metres, 6)  # 18 mm, however computed, belongs to the range up to 18


def _letter_and_grade(tolerance_class: str) -> tuple[str, int]:
    match = re.fullmatch(r"([A-Za-z]+)([0-9]+)", tolerance_class)
    if match is None:
        shown, fix = repr(tolerance_class), 'Write it as "H7" (a hole) or "g6" (a shaft).'
        raise wrong_value("Argument `tolerance_class`", "a letter and a grade", tolerance_class, shown, fix)
    letter, grade = match[1], int(match[2])
    if letter not in HOLES and letter not in SHAFTS:
        raise ClearanceError(
            f"Argument `tolerance_class` must begin with a known letter, but it is {tolerance_class!r}. "
            f"Allowed: {', '.join(HOLES)} (holes); {', '.join(SHAFTS)} (shafts)."
        ).about("tolerance_class", tolerance_class, (*HOLES, *SHAFTS))
    if grade not in TOLERANCES:
        raise ClearanceError(
            f"Argument `tolerance_class` must end with a known grade, but it is {tolerance_class!r}. "
            f"Allowed: {', '.join(map(str, TOLERANCES))}."
        ).about("tolerance_class", tolerance_class, TOLERANCES)
    return letter, grade


def _shaft(size: float, letter: str, grade: int) -> tuple[float, float]:
    """Lower and upper deviation [um] of a shaft of `size` [mm]."""
    tolerance = _entry(TOLERANCES[grade], size)
    if letter == "js":
        return -tolerance / 2, tolerance / 2
    deviation = _entry(DEVIATIONS[letter], size)
    if letter == "k" and not 4 <= grade <= 7:
        deviation = 0.0
    return (deviation - tolerance, deviation) if letter <= "h" else (deviation, deviation + tolerance)


def _hole(size: float, letter: str, grade: int) -> tuple[float, float]:
    """Lower and upper deviation [um] of a hole of `size` [mm]; `letter`: in lower case."""
    if letter.upper() not in ADDED:
        lower, upper = _shaft(size, letter, grade)
        return 0.0 - upper, 0.0 - lower  # not -upper: that of an H would be -0.0
    # The deviation of the table, also for K of the grades in which a shaft k begins at zero.
    tolerance, upper = _entry(TOLERANCES[grade], size), 0.0 - _entry(DEVIATIONS[letter], size)
    if (letter, grade) == ("m", 6) and 250 < size <= 315:
        upper = -9.0  # the one value of the standard that its rule does not give
    elif size > 3 and grade <= ADDED[letter.upper()]:
        upper += tolerance - _entry(TOLERANCES[grade - 1], size)
    elif size > 3 and letter == "n":
        upper = 0.0
    return upper - tolerance, upper


def _entry(row: tuple[int | float, ...], size: float) -> float:
    """The entry of a table's row for `size` [mm]."""
    ranges = RANGES if len(row) == len(RANGES) else FINE_RANGES
    return float(row[bisect.bisect_left(ranges, size)])
