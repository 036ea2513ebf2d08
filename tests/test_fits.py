"""ISO 286 against values read elsewhere (catalogues, the formulas behind the tables), not against the module's own."""

import numpy as np
import pytest

from clearance_jax import fits
from clearance_jax._checks import ClearanceError
from clearance_jax.fits import COMMON, Fit, fit, fits_within, limits

# Diameter [mm], class, lower and upper deviation [um]: DIN ISO 286-2 and JIS B 0401 as reprinted in tool catalogues.
LIMITS = [
    (2, "h9", -25, 0),
    (3, "H7", 0, 10),
    (3, "D9", 20, 45),
    (3, "E8", 14, 28),
    (3, "F7", 6, 16),
    (3, "G6", 2, 8),
    (3, "H8", 0, 14),
    (3, "H10", 0, 40),
    (3, "H11", 0, 60),
    (3, "H12", 0, 100),
    (3, "H13", 0, 140),
    (3, "H14", 0, 250),
    (3, "m6", 2, 8),
    (3, "n6", 4, 10),
    (3, "p6", 6, 12),
    (3, "r6", 10, 16),
    (3, "c9", -85, -60),
    (6, "c9", -100, -70),
    (3, "k6", 0, 6),
    (3, "s6", 14, 20),
    (5, "b9", -170, -140),
    (8, "E8", 25, 47),
    (8, "js7", -7.5, 7.5),
    (10, "H7", 0, 15),
    (10, "g6", -14, -5),
    (10, "c9", -116, -80),
    (18, "c9", -138, -95),
    (18, "e8", -59, -32),
    (25, "H7", 0, 21),
    (25, "g6", -20, -7),
    (25, "h6", -13, 0),
    (25, "JS9", -26, 26),
    (25, "k5", 2, 11),
    (25, "k8", 0, 33),
    (25, "m6", 8, 21),
    (30, "c9", -162, -110),
    (40, "c9", -182, -120),
    (45, "c9", -192, -130),
    (50, "H8", 0, 39),
    (50, "f7", -50, -25),
    (50, "H11", 0, 160),
    (50, "c11", -290, -130),
    (50, "d9", -142, -80),
    (50, "D9", 80, 142),
    (50, "F8", 25, 64),
    (60, "r6", 41, 60),
    (70, "r6", 43, 62),
    (70, "E13", 60, 520),
    (100, "G7", 12, 47),
    (110, "a12", -760, -410),
    (150, "n6", 27, 52),
    (240, "a12", -1280, -820),
    (250, "H14", 0, 1150),
    (300, "p6", 56, 88),
    (400, "g5", -43, -18),
    (450, "s6", 232, 272),
    (500, "h9", -155, 0),
]

# The rows of the reference table in FACTS.md section 9: diameter [mm], H7/g6 and H8/f7 diametral clearances [um].
CLEARANCES = [
    (8, (5, 29), (13, 50)),
    (15, (6, 35), (16, 61)),
    (25, (7, 41), (20, 74)),
    (40, (9, 50), (25, 89)),
    (60, (10, 59), (30, 106)),
    (100, (12, 69), (36, 125)),
]


@pytest.mark.parametrize(("size", "tolerance_class", "lower", "upper"), LIMITS)
def test_limits(size, tolerance_class, lower, upper):
    assert limits(size * 1e-3, tolerance_class) == (lower / 1e6, upper / 1e6)


@pytest.mark.parametrize(("size", "sliding", "running"), CLEARANCES)
def test_clearances(size, sliding, running):
    for name, expected in (("H7/g6", sliding), ("H8/f7", running)):
        found = fit(size * 1e-3, name)
        np.testing.assert_allclose(found.diametral_clearance, np.multiply(expected, 1e-6), rtol=1e-12)
        np.testing.assert_allclose(found.radial_clearance, np.multiply(expected, 0.5e-6), rtol=1e-12)
        assert found.is_clearance


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
    bounds = np.array(fits.RANGES, float)
    mean, largest = np.sqrt(bounds[:-1] * bounds[1:]), bounds[1:] * 1e-3
    for grade, factor in factors.items():
        tolerances = [limits(d, f"H{grade}")[1] * 1e6 for d in largest]
        np.testing.assert_allclose(tolerances, factor * (0.45 * np.cbrt(mean) + 0.001 * mean), rtol=0.05, atol=0.5)
    for letter, (factor, power) in powers.items():
        deviations = [limits(d, f"{letter}6")[letter < "i"] * 1e6 for d in largest]
        np.testing.assert_allclose(deviations, factor * mean**power, rtol=0.02, atol=1.0)
    fine = np.array(fits.FINE_RANGES, float)
    mean, largest = np.sqrt(fine[:-1] * fine[1:]), fine[1:] * 1e-3
    above = mean > 40
    formulas = {
        "a": -np.where(mean <= 120, 265 + 1.3 * mean, 3.5 * mean),
        "b": -np.where(mean <= 160, 140 + 0.85 * mean, 1.8 * mean),
        "c": np.where(above, -(95 + 0.8 * mean), np.nan),
        "s": np.where(above, [limits(d, "H7")[1] * 1e6 + 0.4 * m for d, m in zip(largest, mean, strict=True)], np.nan),
    }
    for letter, expected in formulas.items():
        deviations = np.array([limits(d, f"{letter}7")[letter < "i"] * 1e6 for d in largest])
        known = np.isfinite(expected)
        np.testing.assert_allclose(deviations[known], expected[known], rtol=0.05, atol=2.0)


def test_shafts_beyond_h_follow_their_rules():
    """ISO 286-1: m = IT7 - IT6, p = IT7 + 0 to 5 um, r the geometric mean of p and s [um], from 3 mm on."""
    for diameter in np.array(fits.FINE_RANGES[1:]) * 1e-3:
        m, p, r, s = (limits(diameter, f"{letter}6")[0] * 1e6 for letter in "mprs")
        fine, coarse, coarser = (limits(diameter, f"H{grade}")[1] * 1e6 for grade in (6, 7, 8))
        assert m == pytest.approx(coarse - fine, abs=0.1)
        assert -0.1 < p - coarse < 5.1
        assert r == pytest.approx(np.sqrt(p * s), abs=1.5)
        assert diameter > 0.05 or 0.9 < s - coarser < 4.1


def test_finest_grades():
    """Shafts h3 and h4 of a tool catalogue (BIG Daishowa, shaft tolerances, page 139) [um]."""
    h3 = [2, 2.5, 2.5, 3, 4, 4, 5, 6, 8, 10, 12, 13, 15]
    h4 = [3, 4, 4, 5, 6, 7, 8, 10, 12, 14, 16, 18, 20]
    for bound, third, fourth in zip(fits.RANGES, h3, h4, strict=True):
        assert limits(bound * 1e-3, "h3") == (-third / 1e6, 0)
        assert limits(bound * 1e-3, "h4") == (-fourth / 1e6, 0)


def test_tables_are_complete_and_monotone():
    for row in (*fits.TOLERANCES.values(), *fits.DEVIATIONS.values()):
        assert len(row) in (len(fits.RANGES), len(fits.FINE_RANGES))
        assert np.all(np.diff(np.abs(row)) >= 0)
    assert np.all(np.diff(list(fits.TOLERANCES.values()), axis=0) > 0)


@pytest.mark.parametrize("letter", "ABCDEFGH")
def test_a_hole_mirrors_the_shaft(letter):
    lower, upper = limits(0.03, f"{letter}8")
    assert limits(0.03, f"{letter.lower()}8") == (-upper, -lower)
    assert upper - lower == pytest.approx(33e-6)


def test_a_range_includes_its_upper_bound():
    assert limits(0.018, "H7") == limits(0.0101, "H7") == (0, 18e-6)
    assert limits(0.0180001, "H7") == (0, 21e-6)
    assert limits(0.01, "H7") == (0, 15e-6)
    # Noise of binary fractions does not carry a diameter over the bound.
    assert 3 * 0.006 > 0.018
    assert limits(3 * 0.006, "H7") == (0, 18e-6)


def test_loose_transition_and_interference_fits():
    loose = fit(0.05, "H11/c11")
    assert loose == Fit("H11/c11", 0.05, (0.0, 160e-6), (-290e-6, -130e-6))
    assert loose.radial_clearance == (65e-6, 225e-6)
    assert str(loose) == "H11/c11 at 50 mm: radial clearance 65 to 225 um"
    assert str(fit(0.025, "H7/h6")) == "H7/h6 at 25 mm: radial clearance 0 to 17 um"
    transition = fit(0.025, "H7 / k6")
    assert transition.name == "H7/k6"
    assert transition.diametral_clearance == (-15e-6, 19e-6)
    assert not transition.is_clearance
    press = fit(0.025, "H7/s6")
    assert press.diametral_clearance == (-48e-6, -14e-6)
    assert not press.is_clearance
    assert fit(0.025, "F8/h6").radial_clearance == (10e-6, 33e-6)


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


@pytest.mark.parametrize("diameter", [0.0, -0.01, 0.5001, 25.0, float("nan")])
def test_diameters_out_of_range(diameter):
    with pytest.raises(ClearanceError, match=r"`diameter` must be above 0 and at most 0\.5 m"):
        limits(diameter, "H7")
    with pytest.raises(ClearanceError, match=r"25 mm are 0\.025"):
        fits_within(diameter, 1e-4)


@pytest.mark.parametrize(
    ("tolerance_class", "message"),
    [
        ("K7", "Allowed: A, B, C, D, E, F, G, H, JS .holes.; a, b, c"),
        ("Js7", "known letter"),
        ("t6", "known letter"),
        ("H2", "Allowed: 3, 4, 5"),
        ("g17", "14, 15, 16"),
        ("H", "a letter and a grade"),
        ("7H", "a letter and a grade"),
        ("H7.5", "a letter and a grade"),
        ("", "a letter and a grade"),
    ],
)
def test_unknown_classes(tolerance_class, message):
    with pytest.raises(ClearanceError, match=message):
        limits(0.025, tolerance_class)


@pytest.mark.parametrize("name", ["H7", "H7g6", "g6/H7", "H7/H8", "h6/g6", "", "/", "H7/"])
def test_malformed_fits(name):
    with pytest.raises(ClearanceError, match='Write it as "H7/g6"'):
        fit(0.025, name)


def test_what_the_standard_lacks_up_to_one_millimetre():
    for tolerance_class in ("a9", "B11", "H14"):
        with pytest.raises(ClearanceError, match="up to 1 mm"):
            limits(0.001, tolerance_class)
        assert limits(0.00101, tolerance_class)[1] != 0


@pytest.mark.parametrize("bounds", [(1e-6, 2e-6), (-1e-6, 0.0), (1e-5, -1e-6), (float("nan"), 0.0)])
def test_bounds_in_the_wrong_order(bounds):
    with pytest.raises(ClearanceError, match="`least`"):
        fits_within(0.025, *bounds)
