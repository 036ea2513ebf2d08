"""ISO 286 against values read elsewhere (catalogues, the formulas behind the tables), not against the module's own."""

import numpy as np
import pytest
from places import ANY, refused

from clearance_jax.joints import fits
from clearance_jax.joints.fits import COMMON, Fit, fit, fits_within, limit_deviations

pytestmark = pytest.mark.quick

# Lower and upper deviation [um] by class and diameter [mm]: DIN ISO 286-2 and JIS B 0401 as tool catalogues have them.
LIMITS = {
    "h9": {2: (-25, 0), 500: (-155, 0)},
    "H7": {3: (0, 10), 10: (0, 15), 25: (0, 21)},
    "D9": {3: (20, 45), 50: (80, 142)},
    "E8": {3: (14, 28), 8: (25, 47)},
    "F7": {3: (6, 16)},
    "G6": {3: (2, 8)},
    "H8": {3: (0, 14), 50: (0, 39)},
    "H10": {3: (0, 40)},
    "H11": {3: (0, 60), 50: (0, 160)},
    "H12": {3: (0, 100)},
    "H13": {3: (0, 140)},
    "H14": {3: (0, 250), 250: (0, 1150)},
    "m6": {3: (2, 8), 25: (8, 21)},
    "n6": {3: (4, 10), 150: (27, 52)},
    "p6": {3: (6, 12), 300: (56, 88)},
    "r6": {3: (10, 16), 60: (41, 60), 70: (43, 62)},
    "c9": {
        3: (-85, -60),
        6: (-100, -70),
        10: (-116, -80),
        18: (-138, -95),
        30: (-162, -110),
        40: (-182, -120),
        45: (-192, -130),
    },
    "k6": {3: (0, 6)},
    "s6": {3: (14, 20), 450: (232, 272)},
    "b9": {5: (-170, -140)},
    "js7": {8: (-7.5, 7.5)},
    "g6": {10: (-14, -5), 25: (-20, -7)},
    "e8": {18: (-59, -32)},
    "h6": {25: (-13, 0)},
    "JS9": {25: (-26, 26)},
    "k5": {25: (2, 11)},
    "k8": {25: (0, 33)},
    "f7": {50: (-50, -25)},
    "c11": {50: (-290, -130)},
    "d9": {50: (-142, -80)},
    "F8": {50: (25, 64)},
    "E13": {70: (60, 520)},
    "G7": {100: (12, 47)},
    "a12": {110: (-760, -410), 240: (-1280, -820)},
    "g5": {400: (-43, -18)},
    "K6": {3: (-6, 0), 25: (-11, 2)},
    "K7": {3: (-10, 0), 25: (-15, 6), 100: (-25, 10)},
    "K8": {25: (-23, 10)},
    "K9": {3: (-25, 0)},
    "M6": {25: (-17, -4), 250: (-37, -8), 251: (-41, -9), 315: (-41, -9), 316: (-46, -10)},
    "M7": {3: (-12, -2), 25: (-21, 0), 300: (-52, 0)},
    "M8": {25: (-29, 4)},
    "M9": {25: (-60, -8)},
    "N7": {3: (-14, -4), 25: (-28, -7), 60: (-39, -9)},
    "N9": {2: (-29, -4), 8: (-36, 0), 25: (-52, 0)},
    "P7": {3: (-16, -6), 25: (-35, -14)},
    "P9": {8: (-51, -15), 25: (-74, -22)},
    "R7": {25: (-41, -20), 60: (-60, -30), 70: (-62, -32)},
    "S7": {25: (-48, -27), 60: (-72, -42)},
}

# The rows of the reference table in FACTS.md section 9, and further fits: least and greatest diametral clearance [um]
# by diameter [mm].
FITS = {
    "H7/g6": {8: (5, 29), 15: (6, 35), 25: (7, 41), 40: (9, 50), 60: (10, 59), 100: (12, 69)},
    "H8/f7": {8: (13, 50), 15: (16, 61), 25: (20, 74), 40: (25, 89), 60: (30, 106), 100: (36, 125)},
    "H11/c11": {50: (130, 450)},
    "F8/h6": {25: (20, 66)},
    "H7/k6": {25: (-15, 19)},
    "H7/s6": {25: (-48, -14)},
    "P7/h6": {25: (-35, -1)},
    "N9/h9": {8: (-36, 36)},
}


def rows(table):
    return [(size, name, *row) for name, sizes in table.items() for size, row in sizes.items()]


def um(*values):
    """The values [um] in metres."""
    return tuple(value / 1e6 for value in values)


def tolerances(grade, diameters):
    """Tolerances of a grade [um]."""
    return np.array([limit_deviations(d, f"H{grade}")[1] for d in diameters]) * 1e6


def deviations(shaft, diameters):
    """Of both deviations of a shaft the one nearer to zero [um]: the upper one up to h, the lower one beyond."""
    return np.array([limit_deviations(d, shaft)[shaft < "i"] for d in diameters]) * 1e6


def means(ranges):
    """Geometric means [mm] and upper bounds [m] of ranges of diameters."""
    bounds = np.array(ranges, float)
    return np.sqrt(bounds[:-1] * bounds[1:]), bounds[1:] * 1e-3


@pytest.mark.parametrize(("size", "tolerance_class", "lower", "upper"), rows(LIMITS))
def test_limit_deviations(size, tolerance_class, lower, upper):
    assert limit_deviations(size * 1e-3, tolerance_class) == um(lower, upper)


@pytest.mark.parametrize(("size", "name", "least", "greatest"), rows(FITS))
def test_clearances(size, name, least, greatest):
    found = fit(size * 1e-3, name)
    assert found.diametral_clearance == um(least, greatest)
    assert found.radial_clearance == um(least / 2, greatest / 2)
    assert found.is_clearance == (least >= 0)


def test_tables_follow_the_formulas_they_were_rounded_from():
    """ISO 286-1: i = 0.45 D^(1/3) + 0.001 D and powers of D [mm], D the geometric mean of the range; from 3 mm on."""
    factors = {5: 7, 6: 10, 7: 16, 8: 25, 9: 40, 10: 64, 11: 100, 12: 160, 13: 250, 14: 400, 15: 640, 16: 1000}
    powers = {
        "d": (-16, 0.44),
        "e": (-11, 0.41),
        "f": (-5.5, 0.41),
        "g": (-2.5, 0.34),
        "n": (5, 0.34),
        "k": (0.6, 1 / 3),
    }
    mean, largest = means(fits.RANGES)
    for grade, factor in factors.items():
        expected = factor * (0.45 * np.cbrt(mean) + 0.001 * mean)
        np.testing.assert_allclose(tolerances(grade, largest), expected, rtol=0.05, atol=0.5)
    for letter, (factor, power) in powers.items():
        np.testing.assert_allclose(deviations(f"{letter}6", largest), factor * mean**power, rtol=0.02, atol=1.0)
    mean, largest = means(fits.FINE_RANGES)
    formulas = {
        "a": -np.where(mean <= 120, 265 + 1.3 * mean, 3.5 * mean),
        "b": -np.where(mean <= 160, 140 + 0.85 * mean, 1.8 * mean),
        "c": np.where(mean > 40, -(95 + 0.8 * mean), np.nan),
        "s": np.where(mean > 40, tolerances(7, largest) + 0.4 * mean, np.nan),
    }
    for letter, expected in formulas.items():
        known = np.isfinite(expected)
        np.testing.assert_allclose(deviations(f"{letter}7", largest)[known], expected[known], rtol=0.05, atol=2.0)


def test_shafts_beyond_h_follow_their_rules():
    """ISO 286-1: m = IT7 - IT6, p = IT7 + 0 to 5 um, r the geometric mean of p and s [um], from 3 mm on."""
    _, largest = means(fits.FINE_RANGES)
    m, p, r, s = (deviations(f"{letter}6", largest) for letter in "mprs")
    fine, coarse, coarser = (tolerances(grade, largest) for grade in (6, 7, 8))
    np.testing.assert_allclose(m, coarse - fine, rtol=0, atol=0.1)
    assert np.all((p - coarse > -0.1) & (p - coarse < 5.1))
    np.testing.assert_allclose(r, np.sqrt(p * s), rtol=0, atol=1.5)
    above = (s - coarser)[largest <= 0.05]
    assert np.all((above > 0.9) & (above < 4.1))


def test_finest_grades():
    """Shafts h3 and h4 of a tool catalogue (BIG Daishowa, shaft tolerances, page 139) [um]."""
    h3 = [2, 2.5, 2.5, 3, 4, 4, 5, 6, 8, 10, 12, 13, 15]
    h4 = [3, 4, 4, 5, 6, 7, 8, 10, 12, 14, 16, 18, 20]
    for bound, third, fourth in zip(fits.RANGES, h3, h4, strict=True):
        assert limit_deviations(bound * 1e-3, "h3") == um(-third, 0)
        assert limit_deviations(bound * 1e-3, "h4") == um(-fourth, 0)


def test_tables_are_complete_and_monotone():
    for row in (*fits.TOLERANCES.values(), *fits.DEVIATIONS.values()):
        assert len(row) in (len(fits.RANGES), len(fits.FINE_RANGES))
        assert np.all(np.diff(np.abs(row)) >= 0)
    assert np.all(np.diff(list(fits.TOLERANCES.values()), axis=0) > 0)


@pytest.mark.parametrize("letter", "KMNPRS")
@pytest.mark.parametrize("grade", [5, 6, 7])
def test_a_hole_and_a_shaft_of_one_letter_grip_as_much_on_either_basis(letter, grade):
    """The rule for which ISO 286-1 adds a difference of tolerances: a hole H with the next finer shaft (H7/p6) grips as
    the mirrored pair (P7/h6).
    """
    for size in (0.004, 0.025, 0.06, 0.1, 0.4):
        shaft, hole = (
            fit(size, f"H{grade}/{letter.lower()}{grade - 1}"),
            fit(size, f"{letter}{grade}/h{grade - 1}"),
        )
        assert hole.diametral_clearance == shaft.diametral_clearance


@pytest.mark.parametrize("letter", "ABCDEFGH")
def test_a_hole_mirrors_the_shaft(letter):
    lower, upper = limit_deviations(0.03, f"{letter}8")
    assert limit_deviations(0.03, f"{letter.lower()}8") == (-upper, -lower)
    assert upper - lower == pytest.approx(33e-6)


def test_a_range_includes_its_upper_bound():
    # Noise of binary fractions does not carry a diameter over the bound.
    assert 3 * 0.006 > 0.018
    for diameter, upper in ((0.01, 15), (0.0101, 18), (0.018, 18), (3 * 0.006, 18), (0.0180001, 21)):
        assert limit_deviations(diameter, "H7") == um(0, upper)


def test_fits_as_records_and_text():
    assert fit(0.05, "H11/c11") == Fit("H11/c11", 0.05, um(0, 160), um(-290, -130))
    assert str(fit(0.05, "H11/c11")) == "H11/c11 at 50 mm: radial clearance 65 to 225 um"
    assert str(fit(0.025, "H7/h6")) == "H7/h6 at 25 mm: radial clearance 0 to 17 um"
    assert fit(0.025, "H7 / k6") == fit(0.025, "H7/k6")
    assert fit(0.025, "H7 / k6").name == "H7/k6"


def test_common_fits_exist_and_clear_at_every_diameter():
    assert len(set(COMMON)) == len(COMMON)
    for diameter in (0.0005, *np.array(fits.FINE_RANGES) * 1e-3):
        assert all(fit(diameter, name).is_clearance for name in COMMON)


def test_fits_within():
    names = [found.name for found in fits_within(0.025, 25e-6)]
    assert names == ["H7/g6", "G7/h6", "H7/h6", "H6/g5", "H6/h5"]
    assert [found.name for found in fits_within(0.025, 25e-6, least=1e-6)] == ["H7/g6", "G7/h6", "H6/g5"]
    # All of them, sorted; bounds that are met exactly count.
    everything = fits_within(0.05, 1.0)
    greatest = [found.radial_clearance[1] for found in everything]
    assert {found.name for found in everything} == set(COMMON)
    assert greatest == sorted(greatest, reverse=True)
    assert everything[0].name == "H11/c11"
    assert fits_within(0.025, 17e-6, 0)[0].name == "H7/h6"
    assert "H7/h6" not in [found.name for found in fits_within(0.025, 16.99e-6)]
    assert fits_within(0.025, 1e-6) == ()


@pytest.mark.parametrize("name", COMMON)
def test_a_fit_lies_within_its_own_clearances(name):
    for diameter in (0.002, 0.012, 0.033, 0.2):
        own = fit(diameter, name)
        least, greatest = own.radial_clearance
        assert own in fits_within(diameter, greatest * (1 - 1e-15), least)
        assert own not in fits_within(diameter, greatest - 1e-9)


OUT_OF_RANGE = (0.0, -0.01, 0.5001, 25.0, float("nan"))
REFUSED = [
    *((limit_deviations, (diameter, "H7"), ("diameter", ANY, 0.5)) for diameter in OUT_OF_RANGE),
    *((fits_within, (diameter, 1e-4), ("diameter", ANY, 0.5)) for diameter in OUT_OF_RANGE),
    (limit_deviations, (0.025, "T7"), ("tolerance_class", "T7", "JS")),
    (limit_deviations, (0.025, "K9"), ("tolerance_class", "K9")),
    (limit_deviations, (0.025, "P3"), ("tolerance_class", "P3")),
    (limit_deviations, (0.025, "Js7"), ("tolerance_class", "Js7", "s")),
    (limit_deviations, (0.025, "t6"), ("tolerance_class", "t6", "s")),
    (limit_deviations, (0.025, "H2"), ("tolerance_class", "H2", "3")),
    (limit_deviations, (0.025, "g17"), ("tolerance_class", "g17", "16")),
    *(
        (limit_deviations, (0.025, malformed), ("tolerance_class", malformed, "a letter and a grade"))
        for malformed in ("H", "7H", "H7.5", "")
    ),
    *(
        (fit, (0.025, malformed), ("name", malformed))
        for malformed in ("H7", "H7g6", "g6/H7", "H7/H8", "h6/g6", "", "/", "H7/")
    ),
    *(
        (fits_within, (0.025, greatest, least), ("greatest_radial_clearance", ANY, least))
        for greatest, least in ((1e-6, 2e-6), (-1e-6, 0.0), (1e-5, -1e-6), (float("nan"), 0.0))
    ),
]


@pytest.mark.parametrize(("function", "arguments", "about"), REFUSED)
def test_refusals(function, arguments, about):
    with refused(*about):
        function(*arguments)


def test_what_the_standard_lacks_up_to_one_millimetre():
    for tolerance_class in ("a9", "B11", "H14", "N9"):
        with refused("tolerance_class", tolerance_class):
            limit_deviations(0.001, tolerance_class)
        assert limit_deviations(0.00101, tolerance_class)[1] != 0
