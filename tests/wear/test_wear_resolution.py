"""Wear over sectors and over time: volumes converge, and orders are measured; a pin that runs in."""

import jax.numpy as jnp
import numpy as np
import pytest

from clearance_jax import wear
from clearance_jax.joints import Sections
from clearance_jax.wear import Contacts
from experiments import wear_checks
from experiments.wear_checks import CLEARANCE, LENGTH, SECTORS, STEPS, geometry, order


@pytest.mark.slow
def test_orders_and_running_in(tmp_path):
    """Over sectors, over time, and against the closed form of a rigid pin that wears its way into its sleeve."""
    found = wear_checks.main(quick=True, out=tmp_path)
    volumes, profiles = found["sectors"]
    # A kink at either edge of the patch: what a rule of midpoints misses there is of second order.
    assert order(SECTORS, volumes) == pytest.approx(2, abs=0.2)
    assert volumes[-1] < 1e-7
    # The two sectors of the edges themselves are of first order, and small.
    assert order(SECTORS, profiles) == pytest.approx(1, abs=0.2)
    assert profiles[-1] < 1e-4
    assert order(STEPS, found["time"]) == pytest.approx(6, abs=0.5)
    (run,) = found["runs"].values()
    assert run.deep[-1] > 0.5
    assert run.deep[-1] == pytest.approx(run.rigid[-1], rel=1e-3)
    exact = wear_checks.slid_by(CLEARANCE * run.rigid, 3000.0 / LENGTH, 1e-13)
    assert exact == pytest.approx(run.slid, rel=1e-4)


def test_a_profile_that_wears_converges_with_its_sectors():
    """A pin held by a force wears its way in, its foundation on the worn profile: against four times the sectors."""
    foundation, law, force = wear.Foundation(2e12), wear.Archard(1e-13), 3000.0
    sleeve = Sections(geometry(), jnp.zeros(1), jnp.asarray([LENGTH]))
    one = jnp.ones((1, 1))
    # So far that k s times the stiffness is half of one: beyond two, depths run away from one sector to the next.
    seen = Contacts(one[0], 2.5 * one[0], force * one, 0.7 * one, one, 0 * one, jnp.zeros((1, 1, 2)))

    def worn_in(count):
        depth, volume = jnp.zeros(count), 0.0
        for _ in range(12):
            found = wear.wear_of(seen, sleeve, law, foundation, depth=depth)
            depth, volume = depth + found.depth[0], volume + float(found.volume)
        return np.asarray(depth), volume

    best, whole = worn_in(2880)
    assert best.max() > 0.1 * CLEARANCE
    off, volumes = [], []
    for count in SECTORS:
        depth, volume = worn_in(count)
        # Mean values of the wider sectors, whose middles are those of fine ones.
        ratio = 2880 // count
        edges = np.concatenate([[0.5], np.ones(ratio - 1), [0.5]]) / ratio
        ends = np.arange(count)[:, None] * ratio + np.arange(ratio + 1) - ratio // 2
        wide = np.take(best, ends, mode="wrap") @ edges
        off.append(np.abs(depth - wide).max() / best.max())
        volumes.append(abs(volume / whole - 1))
    # Between the orders of the edges and of all else, for the edges move on.
    assert order(SECTORS, off) == pytest.approx(1.5, abs=0.3)
    assert off[-1] < 1e-3
    assert max(volumes) < 1e-3
    assert volumes[-1] < 1e-5
