"""Designs whose simulations are lanes of a sweep: the same numbers as one by one, here and on a cluster."""

import importlib
import sys
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from distributed import Client, LocalCluster
from numpy.testing import assert_allclose
from places import SCENES, refused

import clearance_jax as cj
from clearance_jax import design
from clearance_jax.design.asked import formulation
from clearance_jax.design.asked.specification import scenarios_of
from clearance_jax.design.search import evaluate
from clearance_jax.metrics import Peak, PositionError

SCENE = SCENES / "slider_crank.toml"
CLEARANCE, MASS, T1 = "wrist.radial_clearance", "slider.mass", 2e-3
# Whole chunks of 64 lanes in all that is asked: one program.
SCATTERED = design.Yield({CLEARANCE: 0.1, MASS: 0.05}, target=0.8, samples=32)
X = np.array([2e-4])


@pytest.fixture(scope="module")
def problem():
    """Three peaks of one error, in two conditions."""
    return design.ToleranceProblem(
        cj.load(SCENE),
        T1,
        {CLEARANCE: (1e-5, 1e-3)},
        [design.Limit(Peak(PositionError("piston")), 2e-4)],
        conditions={"slow": {"drive.main.speed": 400.0}, "fast": {"drive.main.speed": 500.0}},
        manufacture=SCATTERED,
        rtol=1e-7,
    )


@pytest.fixture(scope="module")
def alone(problem):
    """Every limit of every scenario, and its slopes, one solve after the other."""
    simulations = evaluate.simulations_of(problem.specification)
    return simulations.together(X, scenarios_of(problem.specification), True)


@pytest.mark.slow
def test_lanes_are_what_single_solves_are(problem, alone, monkeypatch):
    monkeypatch.setattr(sys.modules["clearance_jax.ask.answers"], "FEW", 4)
    simulations = evaluate.simulations_of(problem.specification)
    scenarios = scenarios_of(problem.specification)
    limits, slopes = simulations.together(X, scenarios, True)
    assert slopes is not None
    assert limits.shape == (64, 3)
    assert slopes.shape == (64, 3, 1)
    # To 10 rtol of the error itself, which is what is bounded; slopes are of a size of 1 / bound.
    assert_allclose(limits + 1, alone[0] + 1, atol=1e-6 * np.abs(alone[0] + 1).max())
    assert_allclose(slopes, alone[1], atol=1e-4 * np.abs(alone[1]).max())
    # A condition in which a part cannot be made: out of its bounds, it fails alone.
    wrong = scenarios[0]._replace(values={**scenarios[0].values, MASS: jnp.asarray(-1.0)})
    worst = simulations.worst(X, [wrong, *scenarios[1:]])
    assert worst[0] == np.inf
    assert_allclose(worst[1:], simulations.together(X, scenarios, False)[0][1:].max(1), rtol=1e-9)


@pytest.mark.slow
def test_a_cluster_gives_the_same(problem, monkeypatch):
    monkeypatch.setattr(sys.modules["clearance_jax.ask.answers"], "FEW", 4)
    specification, scenarios = problem.specification, scenarios_of(problem.specification)
    here = evaluate.simulations_of(specification).together(X, scenarios, False)[0]
    points = [0.9 * X, X, 1.1 * X]
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None) as made:
        cluster: Any = made
        with Client(cluster) as client:
            there = evaluate.simulations_of(specification, place=client).together(X, scenarios, False)[0]
            assert_allclose(there, here, rtol=1e-12, atol=1e-12)
            # A sweep of designs is one question, and what is known is not asked again.
            program = formulation.formulate(specification, place=client)
            each = program.at_each(points)
            assert [point.x.tolist() for point in program.at_each(points[1:])] == [x.tolist() for x in points[1:]]
            assert program.evaluations == 3
        # By the scheduler's address.
        whole = design.Design(specification, program, design.METHODS["cobyqa"], each[1], "", "")
        fresh = whole.yield_estimate(64, cluster=cluster.scheduler_address)
    assert fresh == whole.yield_estimate(64)
    lanes_here = formulation.formulate(specification)
    for point in each:
        assert_allclose(point.limits, lanes_here.at(point.x).limits, rtol=1e-9)


def test_an_unreachable_cluster_is_said_before_anything_runs(problem, monkeypatch):
    monkeypatch.setattr(importlib.import_module("clearance_jax.ask.answers"), "PATIENCE", "1s")
    with refused("cluster", "tcp://127.0.0.1:1"):
        problem.solve(cluster="tcp://127.0.0.1:1")
