"""Andrews' squeezing mechanism, three ideal loops: the end state of the Test Set for IVP Solvers."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import clearance_jax as cj
from clearance_jax.dynamics.equations import openings
from clearance_jax.mechanism.mechanism import layout

SCENE = Path(__file__).parents[1] / "experiments" / "scenes" / "squeezer.toml"
# q at 0.03 s; the crank (beta) has turned two and a half times by then.
END = {
    "beta": 15.81077119629904,
    "theta": -15.75637105984298,
    "gamma": 0.04082224013073101,
    "phi": -0.5347301163226948,
    "delta": 0.5244099658805304,
    "omega": 0.5347301163226948,
    "epsilon": 1.048080741042263,
}
# Every coordinate of the scene is the test set's angle of its name, so nothing is converted: its gamma, delta and
# epsilon are absolute and hang on the ground, its theta, phi and omega are relative and hang on the body before.


def test_the_start_closes_all_loops():
    mechanism = cj.load(SCENE)
    start = [float(c.motion.position) for c in mechanism.free_coordinates()]
    gaps = openings(jnp.asarray(0.0), jnp.array([*start, *np.zeros(len(start))]), mechanism.prepared())
    assert len(gaps) == 3
    assert max(map(float, gaps.values())) < 1e-16


@pytest.mark.slow
def test_end_state_of_the_test_set():
    mechanism = cj.load(SCENE)
    out = cj.simulate(mechanism, 0.03, rtol=1e-11, solver="dopri8")
    end = dict(zip(layout(mechanism).names, np.asarray(out.final), strict=False))
    # Converged solutions, of any solver here and of the test set's equations elsewhere, are 1.4e-9 from these digits.
    np.testing.assert_allclose([end[name] for name in END], list(END.values()), rtol=0, atol=2e-9)
