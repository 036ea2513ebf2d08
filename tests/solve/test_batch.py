"""`cj.batch`: a function over lanes is what `jax.vmap` makes of it, whatever the order, the cores and the chunks."""

import os
import threading
from typing import Any

import catalogue
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import ANY, refused

import clearance_jax as cj
from clearance_jax.solve.codes import Result
from clearance_jax.solve.drivers.batch import cores_here, side_by_side
from clearance_jax.solve.drivers.effort import count, effort
from clearance_jax.solve.drivers.expected import as_numbers, cut, largest_of, pilots, sorted_lanes
from clearance_jax.solve.drivers.lanes import LANES as CHUNK
from clearance_jax.solve.drivers.lanes import LANES_ON_GPU, chunk_on

NONE = jnp.zeros((), int)
RNG = np.random.default_rng(5)


def reported(function, lanes, **options) -> tuple[Any, Any]:
    reports = []
    values = cj.batch(function, lanes, report=reports.append, **options)
    (report,) = reports
    return values, report


# Solves --------------------------------------------------------------------------------------------------------------

# A chunk and a part of one; one lane with an impossible number, one that is much longer than its neighbours.
COUNT = CHUNK + 8
LANES = {"clearance": np.linspace(5e-5, 5e-4, COUNT), "t1": np.full(COUNT, 2e-4)}
LANES["clearance"][7], LANES["t1"][-5] = np.nan, 1e-3


def lane(numbers):
    return cj.simulate(catalogue.slider_crank(numbers["clearance"]), numbers["t1"], rtol=1e-6, energy_balance=False)


@pytest.fixture(scope="module")
def expected():
    return jax.jit(jax.vmap(lane))(LANES)


@pytest.mark.slow
@pytest.mark.parametrize("cost", ["learned", None, -LANES["clearance"]], ids=["learned", "given", "cost"])
@pytest.mark.parametrize("cores", [1, 2])
def test_every_lane_is_what_vmap_makes_of_it(expected, cost, cores):
    values, report = reported(lane, LANES, cost=cost, cores=cores)
    assert isinstance(values, cj.Solution)
    for ours, theirs in zip(jax.tree.leaves(values), jax.tree.leaves(expected), strict=True):
        assert isinstance(ours, np.ndarray)
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-15)
    assert (report.lanes, report.chunks, report.cores) == (COUNT, 2, cores)
    # The lane that fails is data, and harms no other.
    assert [int(code) for code in values.code] == [int(Result.IMPOSSIBLE if i == 7 else 0) for i in range(COUNT)]
    assert values["piston.position"].shape == (COUNT, 2)
    assert f"{COUNT - 1} reached t1; 1 a number" in repr(values)


def test_efficiency_is_that_of_the_attempts():
    values, report = reported(lane, LANES, cost=None)
    attempts = values.steps + values.rejected
    ran = CHUNK * (attempts[:CHUNK].max() + attempts[CHUNK:].max())
    assert report.efficiency == pytest.approx(attempts.sum() / ran)
    assert f"lane efficiency {report.efficiency:.3f} (order: given)" in str(report)


@pytest.mark.slow
def test_a_metric_is_a_function_too():
    """With NaN where the solve fails, as under vmap; its solve is counted as `simulate`'s."""
    metric = cj.metrics.Rms(cj.metrics.PositionError("piston"))
    short = jax.tree.map(lambda x: x[5:9], LANES)
    values, report = reported(lambda n: metric(catalogue.slider_crank(n["clearance"]), n["t1"], rtol=1e-5), short)
    assert np.isfinite(values).tolist() == [True, True, False, True]
    assert 0.5 < report.efficiency <= 1


# The rest is about chunks, and needs no solve: functions say what they would have cost.


def costly(numbers):
    """As if it were a solve of so many attempts."""
    count(numbers["cost"].astype(int), NONE)
    return {"double": 2 * numbers["cost"], "pair": jnp.stack([numbers["other"], numbers["cost"]])}


def lanes_of(costs):
    return {"cost": costs, "other": RNG.uniform(size=len(costs))}


@pytest.mark.parametrize("size", [1, 5, CHUNK, CHUNK + 1, 2 * CHUNK, 257])
@pytest.mark.parametrize("cost", ["learned", None])
def test_results_are_in_the_order_of_the_lanes(size, cost):
    lanes = lanes_of(RNG.integers(100, 1000, size).astype(float))
    values = cj.batch(costly, lanes, cores=3, cost=cost)
    np.testing.assert_array_equal(values["double"], 2 * lanes["cost"])
    np.testing.assert_array_equal(values["pair"], np.stack([lanes["other"], lanes["cost"]], 1))


def test_the_order_is_learned_where_that_fills_chunks():
    lanes = lanes_of(RNG.integers(100, 1000, 2000).astype(float))
    _, given = reported(costly, lanes, cost=None)
    _, learned = reported(costly, lanes)
    _, known = reported(costly, lanes, cost=lanes["cost"])
    assert (given.order, learned.order, known.order) == ("given", "learned", "cost")
    assert given.efficiency < 0.6
    assert learned.efficiency > 0.8  # the chunks from which is learned are as they come
    assert known.efficiency > 0.95


def test_lanes_that_come_in_order_are_left_so():
    """Costs along a bend: neighbours are nearer to each other than they are to a line."""

    def bent(x):
        return costly({"cost": 1000 - 800 * x**2, "other": x})["pair"]

    _, report = reported(bent, np.linspace(-1, 1, 2000))
    assert report.order == "given"
    assert report.efficiency > 0.95


def test_lanes_that_end_at_once_are_learned_from_too():
    """Not a number: no cost is to be expected of it, and nothing to be learned."""
    costs = RNG.integers(100, 1000, 2000).astype(float)
    lanes = lanes_of(costs)
    lanes["other"][::10] = np.nan
    values, report = reported(costly, lanes)
    assert report.order == "learned"
    np.testing.assert_array_equal(values["double"], 2 * costs)


HIDDEN = {
    "jit": jax.jit(costly),
    "vmap": lambda n: jax.vmap(lambda c: costly({**n, "cost": c}))(jnp.stack([n["cost"], n["cost"]])),
    "map": lambda n: jax.lax.map(lambda c: costly({**n, "cost": c}), jnp.stack([n["cost"], n["cost"]])),
    "grad": jax.grad(lambda n: costly(n)["double"]),
    "none": lambda n: n["cost"],
}


@pytest.mark.parametrize("where", HIDDEN)
def test_effort_that_cannot_be_seen_is_not_known(where):
    lanes = lanes_of(np.arange(1.0, 161.0))
    values, report = reported(HIDDEN[where], lanes)
    assert report.efficiency is None
    assert report.order == "given"
    assert "not known" in str(report)
    for ours, theirs in zip(jax.tree.leaves(values), jax.tree.leaves(jax.vmap(HIDDEN[where])(lanes)), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_solves_that_nobody_counts_are_not_counted():
    one, two = jnp.asarray(1), jnp.asarray(2)
    count(one, one)
    with effort() as outer:
        count(one, two)
        with effort() as inner:
            count(two, two)
        count(one, one)
    assert (outer.known, inner.known) == ([3, 2], [4])


def test_numbers_of_a_function_are_no_part_of_the_program():
    traced = []

    def scaled(factor, x):
        traced.append(1)
        return factor * x

    for factor in (2.0, 3.0):
        for size in (CHUNK + 8, 2 * CHUNK):
            function = jax.tree_util.Partial(scaled, jnp.asarray(factor))
            np.testing.assert_array_equal(cj.batch(function, np.arange(size)), factor * np.arange(size))
    assert len(traced) == 1

    class Shift(eqx.Module):
        by: jax.Array

        def __call__(self, x):
            return x + self.by

    np.testing.assert_array_equal(cj.batch(Shift(jnp.asarray(1.0)), jnp.arange(3.0)), [1.0, 2.0, 3.0])


# Cores, progress, interruption ---------------------------------------------------------------------------------------


@pytest.mark.skipif(os.cpu_count() == 1, reason="there is no second core")
def test_chunks_run_at_the_same_time():
    """Each of two chunks waits for the other: on one core they would wait for ever."""
    together = threading.Barrier(2, timeout=60)

    def meet(x):
        together.wait()
        return x

    def function(x):
        shape = jax.ShapeDtypeStruct((), x.dtype)
        return jax.pure_callback(meet, shape, x, vmap_method="expand_dims")

    lanes = np.arange(2.0 * CHUNK)
    np.testing.assert_array_equal(cj.batch(function, lanes, cores=2), lanes)
    assert not together.broken


def test_progress_ends_with_one():
    seen = []
    cj.batch(costly, lanes_of(np.full(5 * CHUNK, 10.0)), progress=seen.append)
    assert seen == sorted(seen)
    assert (seen[-1], len(seen) <= 10) == (1.0, True)


def test_a_chunk_is_what_the_platform_is_best_at_or_what_is_asked(monkeypatch):
    assert (chunk_on("cpu"), chunk_on("gpu"), chunk_on()) == (CHUNK, LANES_ON_GPU, CHUNK)
    numbers = jnp.arange(3.0 * CHUNK)

    def chunks(**options):
        return reported(lambda x: 2 * x, numbers, cores=1, **options)[1].chunks

    assert (chunks(), chunks(chunk=CHUNK // 2)) == (3, 6)
    # A GPU in words only: the chunk is for it, the program is this CPU's.
    monkeypatch.setattr("clearance_jax.solve.drivers.lanes.jax.default_backend", lambda: "gpu")
    assert chunks() == 1


def test_an_interruption_stops_within_a_chunk():
    ran = []

    def seen(x):
        ran.append(1)
        return x

    def function(x):
        return jax.pure_callback(seen, jax.ShapeDtypeStruct((), x.dtype), x, vmap_method="expand_dims")

    def interrupt(_done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cj.batch(function, np.arange(100.0 * CHUNK), cores=2, progress=interrupt)
    assert len(ran) <= 8  # of a hundred


# What is refused -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lanes", "options", "about"),
    [
        (np.zeros(0), {}, ("lanes", 0)),
        ({}, {}, ("lanes", None)),
        ([1.0, 2.0], {}, ("lanes[0]", 1.0, "numbers")),
        ({"a": np.zeros(3), "b": np.zeros((2, 3))}, {}, ("lanes['b']", 2)),
        (np.array(["1 mm"]), {}, ("lanes", "array(['1 mm'], dtype='<U4')", "numbers")),
        (jax.random.split(jax.random.key(0), 3), {}, ("lanes", ANY, "numbers")),
        (np.zeros(3), {"cores": 0}, ("cores", 0, "a whole number, at least 1")),
        (np.zeros(3), {"cost": "best"}, ("cost", "best")),
        (np.zeros(3), {"cost": np.zeros(2)}, ("cost", "array([0., 0.])")),
    ],
)
def test_refusals(lanes, options, about):
    with refused(*about):
        cj.batch(lambda x: x, lanes, **options)


def test_refusals_of_the_function_and_the_place():
    with refused("function", 3):
        cj.batch(3, np.zeros(3))
    with refused("batch"):
        jax.jit(lambda x: cj.batch(jnp.sin, x))(jnp.zeros(3))

    def fails(_x):
        raise ZeroDivisionError("whatever it says")

    with pytest.raises(ZeroDivisionError, match="whatever it says"):
        cj.batch(fails, np.zeros(3))


# Orders --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("chunks", "first"), [(1, 0), (3, 0), (4, 1), (9, 2), (100, 8)])
def test_pilots_are_a_few_whole_chunks(chunks, first):
    every = cut(np.arange(32 * chunks - 5), 32)
    assert len(every) == chunks
    begin, later = pilots(every)
    assert len(begin) == first
    assert all(len(chunk) == 32 for chunk in begin)
    assert sorted(np.concatenate([*begin, *later]).tolist()) == list(range(32 * chunks - 5))


def test_the_largest_of_some():
    draws = np.linspace(0, 1, 10_001)
    assert largest_of(draws, 1) == pytest.approx(0.5, abs=1e-3)
    assert largest_of(draws, 32) == pytest.approx(32 / 33, abs=1e-3)


def test_numbers_are_scaled_and_constants_left_out():
    table = as_numbers([np.array([1e-4, 3e-4, np.nan]), np.ones((3, 2)), np.array([[1, 2], [3, 4], [9, 9]])], 3)
    np.testing.assert_allclose(table, [[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5], [np.nan] * 3])
    assert as_numbers([np.full(3, np.inf)], 3).shape == (3, 0)


def test_too_many_numbers_are_not_fitted():
    numbers, attempts = RNG.uniform(size=(200, 16)), RNG.uniform(size=200)
    tried, others = np.arange(64), np.arange(64, 200)
    assert sorted_lanes(numbers, attempts, tried, others, 0.0, 32) is None
    assert sorted_lanes(numbers[:, :2], attempts, tried, others, 0.0, 32) is not None


def test_programs_with_large_batches_of_lapack_end_side_by_side():
    """Each of its kernels shares its work among XLA's threads, and waits for them: some must be left (it hung else)."""

    def factors(c):
        matrix = (2 + c) * jnp.eye(36) + 0.01

        def once(_, x):
            return 1e-3 * jnp.linalg.cholesky((1 + x) * matrix).sum()

        return jax.lax.fori_loop(0, 50, once, c)

    found = cj.batch(factors, jnp.linspace(0.0, 1.0, 4 * CHUNK), cores=2)
    assert np.all(np.isfinite(np.asarray(found)))


def test_fewer_programs_run_side_by_side_than_xla_has_threads(monkeypatch):
    monkeypatch.setenv("PJRT_NPROC", "2")
    assert (side_by_side(), cores_here()) == (1, 1)
    reports: list[Any] = []
    cj.batch(lambda c: 2 * c, jnp.arange(3.0 * CHUNK), cores=2, report=reports.append)
    assert reports[0].cores == 1
    monkeypatch.setenv("PJRT_NPROC", "9")
    assert side_by_side() == 8
