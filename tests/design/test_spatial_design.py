"""Tolerance design in space: what tilt does to the end of an arm, what is seen of a design."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from made_findings import answer, made, piston_limit, rows_of, text_of

import clearance_jax as cj
from clearance_jax import design, laws
from clearance_jax.design.judge.static import _both_ends, static_error
from clearance_jax.joints import AbstractClearance
from clearance_jax.metrics.observed import pin_wrenches
from clearance_jax.report.html import render
from clearance_jax.results.dataset import picture_dataset
from clearance_jax.results.places import outline, picture, places
from clearance_jax.results.play import play
from optimize import tool_changer

RADIAL, AXIAL, RADIUS, LENGTH = 1e-4, 5e-5, 0.01, 0.04
LAW = laws.HuntCrossley(1e9, 0.5)
SLEEVE = cj.SleeveClearance(RADIAL, RADIUS, LENGTH, LAW, axial_clearance=AXIAL)
# Of a pin: its place, and how it leans.
LEANING = (2e-5, -1.2e-4, 1e-5, 0.0, 3e-3)


def arm(clearance: AbstractClearance, **end) -> cj.Mechanism:
    """A driven arm on a pin about z."""
    body = cj.Body("arm", 2.0, cj.Inertia(2e-3, 0.03, 0.03), cj.Position(0.2, None, 0.02))
    hip = cj.Revolute("hip", "ground", "arm", motion=cj.Motion(cj.drives.Harmonic(0.35, 30.0)), clearance=clearance)
    point = cj.Point("tip", "arm", cj.Position(**end))
    return cj.Mechanism((body,), (hip,), points=(point,), gravity=cj.Gravity(z=-9.81))


def weights(**end) -> dict[str, float]:
    return design.static_weights(arm(SLEEVE, **end), "tip", 0.1, 3)


@pytest.mark.parametrize(("factor", "weight"), [(0.3, 1.0), (0.5, 1.0), (0.8, 1.6), (5.0, 10.0)])
def test_the_end_of_an_arm_along_the_axis(factor, weight):
    """The clearance within the sleeve, 2 c l / L beyond; axial play moves it by itself."""
    found = weights(z=factor * LENGTH)
    assert found == pytest.approx({"hip": weight, "hip.axial_clearance": 1.0}, rel=1e-9)
    bound = static_error(arm(SLEEVE, z=factor * LENGTH), found)
    assert bound == pytest.approx(weight * RADIAL + AXIAL, rel=1e-9)


def test_the_end_of_an_arm_across_the_axis():
    """It is 2 c r / L up or down where that is more than c."""
    assert weights(x=0.4)["hip"] == pytest.approx(20.0, rel=1e-9)
    assert weights(x=0.015)["hip"] == pytest.approx(1.0, rel=1e-9)
    # A plane pin cannot tilt.
    assert design.static_weights(arm(cj.RevoluteClearance(RADIAL, RADIUS, LAW), x=0.4), "tip", 0.1, 3) == pytest.approx(
        {"hip": 1.0}, rel=1e-9
    )


def test_the_largest_reach_is_that_of_all_directions():
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(2, 20, 3, 2))
    ways = rng.normal(size=(200000, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    for p, q, found in zip(one, other, _both_ends(one, other), strict=True):
        every = (np.linalg.norm(ways @ p, axis=1) + np.linalg.norm(ways @ q, axis=1)).max()
        assert every <= found * (1 + 1e-12)
        assert every == pytest.approx(found, rel=1e-3)


def test_a_block_may_be_in_a_corner_of_its_guide():
    """Each of its ends at two walls at once: sqrt(2) of the clearance near the guide, 2 l / L of that along it beyond;
    across it by turning too, about the guide's axis by at most 2 c / 30 mm.
    """
    box = cj.GuideClearance(RADIAL, LENGTH, 0.03, LAW, width=0.02)
    slide = cj.Prismatic(
        "guide", "ground", "block", axis="z", motion=cj.Motion(cj.drives.Harmonic(0.1, 30.0)), clearance=box
    )
    body = cj.Body("block", 1.0, cj.Inertia(2e-3, 2e-3, 2e-3))
    points = (cj.Point("far", "block", cj.Position(z=0.1)), cj.Point("aside", "block", cj.Position(0.3)))
    block = cj.Mechanism((body,), (slide,), points=points)
    assert design.static_weights(block, "far", 0.1, 3) == pytest.approx(
        {"guide": np.sqrt(2) * 2 * 0.1 / LENGTH}, rel=1e-9
    )
    # Beside the guide: along z by a tilt of 2 c / L, and along y with both ends.
    tilted, rolled = np.hypot(2 * 0.3 / LENGTH, 1.0), 2 * 0.3 / 0.03
    assert design.static_weights(block, "aside", 0.1, 3) == pytest.approx({"guide": tilted + rolled}, rel=1e-9)


def seen(function: Any, mechanism: cj.Mechanism, *play: float) -> Any:
    """A function of two instants, with the play in the joint as given, at rest."""
    prepared, state = mechanism.prepare(), jnp.asarray([*play, *(0.0 for _ in play)])
    return jax.tree.map(np.asarray, jax.vmap(lambda t: function(prepared, t, state))(jnp.asarray([0.0, 0.05])))


def leaning() -> xr.Dataset:
    """The arm with its pin down and leaning in its sleeve."""
    mechanism = arm(SLEEVE, x=0.4)
    return picture_dataset(mechanism, np.array([0.0, 0.05]), seen(picture, mechanism, *LEANING))


def test_what_is_seen_of_a_design_in_space():
    motion, lean = leaning(), LEANING[-1]
    at = places(motion)
    turned = 0.35 * np.sin(30.0 * 0.05)
    # From the pin's centre along the arm, down by how its axis leans (to second order in that).
    tip = [2e-5 + 0.4 * np.cos(turned), -1.2e-4 + 0.4 * np.sin(turned), 1e-5 - 0.4 * lean * np.cos(turned)]
    np.testing.assert_allclose(at.at[1, at.points["tip"]], tip, atol=2e-6)
    assert len(at.bodies["arm"]) == 2
    pin = play(motion, "hip")
    assert pin is not None
    # The sleeve's axes stand still: the axis comes by both ends of the sleeve half a length up and down it.
    ends = pin.centres(pin.outline.heights[[0, -1]])
    middle = 2e-5 - 1e-5 * lean
    np.testing.assert_allclose(ends[0, :, 0], [middle - LENGTH / 2 * lean, middle + LENGTH / 2 * lean], rtol=1e-5)
    np.testing.assert_allclose(ends[0, :, 1], -1.2e-4, rtol=1e-9)
    assert (pin.outline.clearance, pin.outline.axial) == pytest.approx((RADIAL, AXIAL))
    np.testing.assert_allclose(pin.place[:, 2], 1e-5)
    force, moment = seen(pin_wrenches, arm(SLEEVE, x=0.4), *LEANING)["hip"]
    assert force[0, 1] > 0  # the wall below pushes up
    assert moment.shape == (2, 3)
    found = outline(motion)
    # It swings about z: seen from there nothing hides.
    assert found.seen == "z"
    np.testing.assert_array_equal(found.places.at, at.at[..., :2])


def test_the_report_of_a_design_in_space():
    load = design.JointLoad("hip", "", 50.0, 0.05, 40.0, 1, 0.1, 0.2, 0.02, LENGTH, (1.0, -2.0, 48.0), 3.5)
    found = made(answer([piston_limit()]))._replace(loads=(load,), motions={"": leaning()})
    page = render(found, "An arm")
    (row,) = [row for row in rows_of(page, "largest force") if "50 N" in row]
    assert row[-4:] == ["1 N", "-2 N", "48 N", "3.5 N m"]
    assert "Seen along z." in text_of(page)
    assert "Path of the pin in the sleeve of hip" in text_of(page)
    assert "end at +z" in page


@pytest.mark.slow
def test_the_largest_clearance_of_the_tool_changer():
    """The one of `docs/benchmarks/tool_changer.md`: a little more, and the end leaves its bound."""
    (found,) = tool_changer.main(quick=True)
    clearance = found.clearances[tool_changer.NAME]
    assert found.feasible
    assert clearance == pytest.approx(118.286e-6, rel=1e-4)
    assert found.program.at(np.array([1.001 * clearance])).worst > 0
