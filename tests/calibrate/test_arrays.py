"""Calibration of arrays, the entries of which have priors: a coefficient of friction as heights over the slip."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from jaxtyping import Array

import clearance_jax as cj

SLIPS, END, NOISE = np.linspace(-0.3, 0.3, 9), 0.06, 2e-6
TIMES = np.linspace(0.0, END, 61)[1:]
HEIGHTS = 0.1 + 0.05 * np.cos(8.0 * SLIPS)
OPTIONS: dict[str, Any] = {"rtol": 1e-8}


class Profile(eqx.Module):
    """Bumps over the slip, each with its height."""

    heights: Array

    def __call__(self, slip):
        return jnp.sum(self.heights * jnp.exp(-(((slip - SLIPS) / 0.06) ** 2)))


class Learned(cj.laws.AbstractFrictionLaw):
    profile: Any
    smoothness: ClassVar = "C2"

    def traction(self, constants, slip, normal_force, memory):
        v = slip[0]
        return (-self.profile(v) * normal_force * v / jnp.sqrt(v * v + 1e-4),)


def arm(heights=np.full(9, 0.1)):
    known = cj.examples.arm()
    law: Any = Learned
    return known.with_joint(
        eqx.tree_at(lambda j: j.clearance.friction, known.joint("hip"), law(Profile(jnp.asarray(heights))))
    )


def place(heights):
    return cj.simulate(arm(heights), END, save_at=TIMES, **OPTIONS)["tip.position.x"]


@pytest.fixture(scope="module")
def measured():
    noise = NOISE * np.random.default_rng(3).standard_normal(len(TIMES))
    return xr.Dataset({"tip.position.x": ("time", np.asarray(place(HEIGHTS)) + noise)}, {"time": TIMES})


PRIOR = {"hip.friction": (0.1, 0.05)}


def test_an_array_is_fitted_with_what_is_known_beforehand(measured):
    """The least of the sum of both squares, and the covariance of a normal posterior, from derivatives of their own."""
    found = cj.calibrate(
        arm(), measured, ["hip.friction"], priors=PRIOR, deviations={"tip.position.x": NOISE}, **OPTIONS
    )
    (name,) = found.arrays
    heights = found.arrays[name]
    assert name == "hip.friction.profile.heights"
    np.testing.assert_array_equal(cj.parameters(found.mechanism)[name].value, heights)
    off = (np.asarray(place(heights)) - measured["tip.position.x"].values) / NOISE
    slopes = np.asarray(jax.jacrev(place)(jnp.asarray(heights))) / NOISE
    pull = slopes.T @ off + (heights - 0.1) / 0.05**2
    precision = slopes.T @ slopes + np.eye(9) / 0.05**2
    deviations = np.sqrt(np.diag(np.linalg.inv(precision)))
    # The pull is of no step worth making.
    assert np.max(np.abs(np.linalg.solve(precision, pull)) / deviations) < 1e-2
    # Residuals may be larger than the given noise, and the deviations are then larger by the same factor.
    factor = np.sqrt(np.diag(found.covariance)) / deviations
    np.testing.assert_allclose(factor, factor[0], rtol=1e-3)
    assert 1 - 1e-3 <= factor[0] <= 1.3
    assert np.max(np.abs(heights - HEIGHTS) / deviations) < 4
    assert np.max(deviations) > 0.04 > 10 * np.min(deviations)
    assert found.expected == 9
    assert found.values == found.intervals == {}
    assert f"{name}: 9 numbers\n60 numbers compared" in str(found)


def test_numbers_beside_an_array_have_their_intervals(measured, tmp_path):
    both = {"hip.friction": None, "hip.radial_clearance": (5e-5, 5e-4)}
    found = cj.calibrate(arm(), measured, both, priors=PRIOR, **OPTIONS)
    truth = float(cj.parameters(arm())["hip.radial_clearance"].value)
    (low, high) = found.intervals["hip.radial_clearance"]
    assert low < truth < high
    assert list(found.correlation["parameter"].values) == list(found.deviations) == ["hip.radial_clearance"]
    assert found.noise["tip.position.x"] == pytest.approx(NOISE, rel=0.3)
    cj.calibration_report(found, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8").replace("<wbr>", "")
    assert "hip.friction.profile.heights" in page
    assert "60 measured numbers" in page


def test_more_numbers_than_data_need_priors(measured):
    few = measured.isel(time=slice(0, 60, 10))
    with pytest.raises(cj.ClearanceError) as caught:
        cj.calibrate(arm(), few, ["hip.friction"], **OPTIONS)
    assert "6 measured numbers cannot determine 9 parameters" in str(caught.value)
    found = cj.calibrate(arm(), few, ["hip.friction"], priors=PRIOR, deviations={"tip.position.x": NOISE}, **OPTIONS)
    assert found.converged
    assert found.freedom == 6
    assert (
        np.max(np.diag(found.covariance.sel(parameter=[f"hip.friction.profile.heights.{i}" for i in range(9)])))
        < 0.06**2
    )


def test_wrong_priors_are_named(measured):
    for priors, said in (
        ({"hip.friction": ("low", 0.1)}, "a value and its standard deviation"),
        ({"hip.friction": (0.1, 0.0)}, "above zero"),
        ({"hip.pin_radius": (0.01, 1e-3)}, "`hip.pin_radius` is not looked for"),
    ):
        with pytest.raises(cj.ClearanceError) as caught:
            cj.calibrate(arm(), measured, ["hip.friction"], priors=priors, **OPTIONS)
        assert said in str(caught.value)
