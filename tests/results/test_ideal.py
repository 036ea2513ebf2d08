"""Errors in datasets are those of the metrics, which compute the ideal mechanism by themselves."""

import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax.metrics import At, PositionError

TIMES = np.linspace(0.0, 4e-3, 41)


def pendulum() -> cj.Mechanism:
    """A pendulum that nothing drives, with play in its pin."""
    arm = cj.Body("arm", 2.0, 0.03, cj.Position(0.2, 0.0))
    hip = cj.Revolute("hip", "ground", "arm")
    tip = cj.Point("tip", "arm", cj.Position(0.4, 0.0))
    ideal = cj.Mechanism((arm,), (hip,), points=(tip,), gravity=cj.Gravity(0.0, -9.81))
    return ideal.with_clearance("hip", radial_clearance=1e-4, pin_radius=0.01)


def errors(mechanism: cj.Mechanism, point: str) -> np.ndarray:
    return np.asarray(cj.measure(mechanism, {"error": At(PositionError(point), TIMES)}, TIMES[-1])["error"])


def test_errors_of_a_driven_mechanism_are_those_of_the_metric():
    crank = cj.examples.slider_crank()
    dataset = cj.to_dataset(crank, cj.simulate(crank, TIMES[-1], save_at=TIMES))
    assert "ideal" not in dataset.attrs
    expected = errors(crank, "piston")
    assert expected.max() > 1e-4
    np.testing.assert_allclose(dataset["position_error"].sel(point="piston"), expected, rtol=0, atol=1e-14)
    # The marks of the ideal loop are as far from each other as the links are long.
    names = [str(name) for name in dataset["mark"].values]
    at = dataset["ideal_mark_position"].values
    ends = [at[:, k] for k, name in enumerate(names) if name == "wrist"]
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-14)


def test_an_ideal_mechanism_that_moves_freely_must_be_given():
    swing = pendulum()
    solution = cj.simulate(swing, TIMES[-1], save_at=TIMES)
    without = cj.to_dataset(swing, solution)
    assert "position_error" not in without
    assert "moves freely" in without.attrs["ideal"]
    ideal = cj.simulate(swing.ideal(), TIMES[-1], save_at=TIMES)
    dataset = cj.to_dataset(swing, solution, ideal=ideal)
    np.testing.assert_allclose(dataset["position_error"].sel(point="tip"), errors(swing, "tip"), rtol=0, atol=1e-9)
    with refused("ideal"):
        cj.to_dataset(swing, solution, ideal=cj.simulate(swing.ideal(), TIMES[-1], save_at=TIMES[:-1]))


def test_a_mechanism_without_play_has_no_errors():
    rigid = pendulum().ideal()
    dataset = cj.to_dataset(rigid, cj.simulate(rigid, TIMES[-1], save_at=TIMES))
    assert "position_error" not in dataset
    assert dataset.attrs["ideal"] == "the mechanism is ideal itself"


@pytest.mark.slow
def test_errors_in_space_are_those_of_the_metric():
    changer = cj.examples.tool_changer()
    dataset = cj.to_dataset(changer, cj.simulate(changer, TIMES[-1], save_at=TIMES))
    expected = errors(changer, "end")
    np.testing.assert_allclose(dataset["position_error"].sel(point="end"), expected, rtol=0, atol=1e-14)
