"""Datasets: the units of what is in them."""

import catalogue
import pytest

import clearance_jax as cj


@pytest.fixture(scope="module")
def crank():
    mechanism = catalogue.slider_crank()
    return mechanism, cj.trace(mechanism, 4e-3, samples=21)


# Units -------------------------------------------------------------------------------------------------------------


def test_every_coordinate_has_its_own_unit(tmp_path, crank):
    cj.save(cj.to_dataset(*crank), tmp_path / "a.nc")
    dataset = cj.load_dataset(tmp_path / "a.nc")
    assert dict(zip(dataset.coordinate.values, dataset.coordinate_unit.values, strict=True)) == {
        "main": "rad",
        "crankpin": "rad",
        "guide": "m",
    }
    assert list(dataset.rate_unit.values) == ["rad/s", "rad/s", "m/s"]
    assert dataset.q.attrs["units"] == "see coordinate_unit"
    assert dataset.v.attrs["units"] == "see rate_unit"
    assert dataset.drive_force.attrs["units"] == "N m"
    assert str(dataset.v.sel(coordinate="guide").rate_unit.values) == "m/s"


def test_one_unit_for_all_is_said_at_the_variable():
    motion = cj.Motion(cj.Harmonic(0.1, 10.0))
    pushed = cj.Mechanism(
        bodies=(cj.Body("cart", 1.0), cj.Body("block", 1.0)),
        joints=(
            cj.Prismatic("rail", "ground", "cart", motion=motion),
            cj.Prismatic("slot", "cart", "block"),
        ),
    )
    dataset = cj.to_dataset(pushed, cj.simulate(pushed, 0.1, save_at=3))
    assert [dataset[name].attrs["units"] for name in ("q", "v", "drive_force")] == ["m", "m/s", "N"]
    assert "joint" not in dataset.coords
