"""Andrews' squeezing mechanism, three ideal loops: the end state of the Test Set for IVP Solvers."""

import jax.numpy as jnp
import numpy as np
import pytest
from places import SCENES

import clearance_jax as cj
from clearance_jax.dynamics.closures import correct
from clearance_jax.mechanism.state import layout
from experiments.reference import squeezer

pytestmark = pytest.mark.quick

SCENE = SCENES / "squeezer.toml"
# Every coordinate of the scene is the test set's angle of its name, so nothing is converted: its gamma, delta and
# epsilon are absolute and hang on the ground, its theta, phi and omega are relative and hang on the body before.


def test_the_start_closes_all_loops():
    mechanism = cj.load(SCENE)
    start = [float(c.motion.position) for c in mechanism.free_coordinates()]
    state = jnp.array([*start, *np.zeros(len(start))])
    _, gaps = correct(jnp.asarray(0.0), state, mechanism.prepare(), mechanism.loops)
    assert gaps.shape == (3,)
    assert float(jnp.max(gaps)) < 1e-15


def test_the_equations_written_by_hand_agree_with_their_extended_solution():
    np.testing.assert_allclose(squeezer.in_double(), squeezer.COMPUTED, rtol=0, atol=1e-11)


@pytest.mark.slow
def test_end_state():
    mechanism = cj.load(SCENE)
    out = cj.simulate(mechanism, float(squeezer.T1), rtol=1e-11, solver="dopri8")
    state = dict(zip(layout(mechanism).positions, np.asarray(out.final), strict=False))
    end = [state[name] for name in squeezer.NAMES]
    np.testing.assert_allclose(end, squeezer.COMPUTED, rtol=0, atol=1e-11)
    # The published digits are good to 1.4e-9 rad only (see `squeezer`).
    np.testing.assert_allclose(end, squeezer.PUBLISHED, rtol=0, atol=2e-9)
