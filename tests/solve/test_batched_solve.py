"""Lanes: a batch is each of its motions alone; in chunks, with all that a solve has."""

import catalogue
import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import SCENES

import clearance_jax as cj
from clearance_jax._compile.barriers import barrier, share, sharing
from clearance_jax._compile.lane_axis import each_lane, least, to_lanes
from clearance_jax.solve.codes import Result
from clearance_jax.solve.drivers import lanes
from clearance_jax.solve.drivers.lanes import batch_by, over_chunks
from clearance_jax.solve.flow import Inputs, task_of
from clearance_jax.solve.settings import Settings

T1 = 3e-3
CLEARANCES = jnp.linspace(5e-5, 5e-4, 5)


def same_as_alone(lane, values, rtol, **tolerance):
    """Every lane's tree of results is what it is alone, to 10 rtol of the largest."""
    together = jax.jit(jax.vmap(lane))(values)
    alone = jax.jit(lane)
    for i, value in enumerate(values):
        for batch, single in zip(jax.tree.leaves(together), jax.tree.leaves(alone(value)), strict=True):
            scale = np.max(np.abs(np.where(np.isfinite(single), single, 0.0)), initial=1e-300)
            np.testing.assert_allclose(batch[i] / scale, single / scale, rtol=0, atol=10 * rtol, **tolerance)


def solve(mechanism, **options):
    """What every lane is compared in: states, samples, how it ended, how well its energy balance closes."""
    s = cj.simulate(mechanism, options.pop("t1", T1), throw=False, **options)
    return s.final, s.y, s.code, s.steps, s.rejected, s.end_time


def test_the_least_of_any_number_of_rows():
    rng = np.random.default_rng(0)
    for rows in (1, 2, 3, 7, 64, 65):
        values = np.where(rng.uniform(size=(rows, 5)) < 0.2, np.inf, rng.normal(size=(rows, 5)))
        np.testing.assert_array_equal(least(jnp.asarray(values)), values.min(axis=0))
        assert least(jnp.asarray(values[:, 0])) == values[:, 0].min()


@pytest.mark.slow
def test_a_crank_with_samples_and_books():
    def lane(c):
        return solve(catalogue.slider_crank(c), rtol=1e-7, save_at=17)

    same_as_alone(lane, CLEARANCES, 1e-7)


@pytest.mark.slow
def test_memory_closures_and_breaks_of_drives():
    """A law that latches and a bristle; a loop without play; a drive that switches."""
    sticky = catalogue.slider_crank().with_clearance(
        "wrist",
        cj.RevoluteClearance(5e-4, 0.01, catalogue.NORMAL["flores"], catalogue.FRICTION["lugre"]),
    )
    closed = cj.load("experiments/scenes/four_bar.toml")
    arm = cj.load("experiments/scenes/joint5_velocity_1.toml")
    for mechanism, name, values, t1 in (
        (sticky, "wrist.radial_clearance", [4e-4, 5e-4], 1e-3),
        (closed, closed.clearance_joints()[0].name + ".radial_clearance", [1e-4, 2e-4], 5e-3),
        (arm, "joint5.radial_clearance", [1e-4, 5e-4], 0.6),
    ):

        def lane(c, mechanism=mechanism, name=name, t1=t1):
            # A step more or less where the two programs' round-off differs is none of the contract.
            final, _, code, _, _, end = solve(cj.replace(mechanism, {name: c}), rtol=1e-6, t1=t1, energy_balance=False)
            return final, code, end

        same_as_alone(lane, jnp.asarray(values), 1e-6)


@pytest.mark.slow
def test_observers_and_integrals():
    metrics = {
        "peak": cj.metrics.Peak(cj.metrics.PositionError("piston"), count=2),
        "force": cj.metrics.Peak(cj.metrics.ContactForce("wrist"), since=5e-4),
        "rms": cj.metrics.Rms(cj.metrics.PositionError("piston")),
        "impacts": cj.metrics.Impacts("wrist"),
    }

    def lane(c):
        return cj.measure(catalogue.slider_crank(c), metrics, T1, rtol=1e-7)

    same_as_alone(lane, CLEARANCES, 1e-5)


@pytest.mark.slow
def test_a_lane_that_fails_harms_no_other():
    """Impossible numbers, no time, too few steps: each a code of its own, beside lanes that end as they do alone."""
    clearances = jnp.array([1e-4, jnp.nan, 3e-4, 1e-4, -1e-4])
    ends = jnp.array([T1, T1, T1, jnp.nan, T1])

    def lane(c, t1):
        return solve(catalogue.slider_crank(c), rtol=1e-7, t1=t1, save_at=3, max_steps=100_000)

    final, y, code, *_ = jax.jit(jax.vmap(lane))(clearances, ends)
    ended, bad = int(Result.REACHED_END), int(Result.IMPOSSIBLE)
    assert code.tolist() == [ended, bad, ended, bad, bad]
    for i in (0, 2):
        expected = lane(clearances[i], ends[i])
        np.testing.assert_allclose(final[i], expected[0], rtol=1e-9)
        np.testing.assert_allclose(y[i], expected[1], rtol=1e-9)
    short = jax.jit(jax.vmap(lambda c: solve(catalogue.slider_crank(c), rtol=1e-7, max_steps=20)))(clearances[:1])
    assert short[2].tolist() == [int(Result.MAX_STEPS)]


def test_an_impossible_lane_takes_no_attempt_wherever_its_start_was_computed():
    """In a loop two programs may compute a lane's start, one for where it is and one for where it ends, an ulp apart:
    a lane whose state is no number would go on until its steps are used up, and its chunk with it.
    """
    options = Settings(solver=diffrax.Tsit5(), max_steps=50)

    def begin(speed, t0):
        mechanism = cj.replace(catalogue.slider_crank(), {"drive.main.speed": speed})
        return task_of(Inputs(mechanism, t0, jnp.asarray(1e-3), None, jnp.asarray(1e-5), None, None), options)

    @jax.jit
    def tries(speeds, starts, apart):
        task = jax.vmap(begin)(speeds, starts)
        out = lanes.integrate(to_lanes(task._replace(t0=task.t0 - apart)), options)
        return out.accepted + out.rejected

    starts = jnp.full(3, 9.9e-4)
    for apart in (jnp.zeros(3), jnp.spacing(starts)):
        found = tries(jnp.array([500.0, jnp.nan, jnp.inf]), starts, apart).tolist()
        assert 0 < found[0] < 50
        assert found[1:] == [0, 0]


@pytest.mark.slow
def test_a_batch_of_batches_is_one_batch():
    def lane(c, speed):
        changed = cj.replace(catalogue.slider_crank(c), {"drive.main.speed": speed})
        return cj.simulate(changed, 1e-3, rtol=1e-6, energy_balance=False).final

    speeds = jnp.array([300.0, 500.0, 524.0])
    grid = jax.jit(jax.vmap(jax.vmap(lane, (None, 0)), (0, None)))(CLEARANCES[:2], speeds)
    assert grid.shape[:2] == (2, 3)
    np.testing.assert_allclose(grid[1, 2], lane(CLEARANCES[1], speeds[2]), rtol=1e-9)


@pytest.mark.slow
def test_derivatives_of_a_batch_are_each_lanes():
    def end(c):
        return cj.simulate(catalogue.slider_crank(c), 1e-3, rtol=1e-7, energy_balance=False)["piston.position.x"]

    together = jax.jit(jax.vmap(jax.grad(end)))(CLEARANCES[:2])
    alone = jax.jit(jax.grad(end))
    np.testing.assert_allclose(together, [alone(c) for c in CLEARANCES[:2]], rtol=1e-5)


@pytest.mark.slow
def test_derivatives_of_what_laws_remember_are_each_lanes():
    play = cj.RevoluteClearance(1e-4, 0.01, catalogue.NORMAL["hunt-crossley"], catalogue.FRICTION["dahl"])
    turns = cj.Motion(cj.drives.ConstantSpeed(1.0))
    hip = cj.Revolute("hip", "ground", "pin", motion=turns, clearance=play)
    m = cj.Mechanism((cj.Body("pin", 1.0),), (hip,), gravity=cj.Gravity(y=-9.81))

    def lane(c):
        def last(c):
            changed = cj.replace(m, {"hip.radial_clearance": c})
            return cj.simulate(changed, 6e-3, rtol=1e-6, energy_balance=False).final[:4]

        return jax.jvp(last, (c,), (jnp.ones(()),))

    same_as_alone(lane, jnp.asarray([8e-5, 1e-4]), 1e-6)


def test_laws_are_told_of_every_touch():
    """A cut step may end a round-off before its touch, and a law that is not told forces the pin by its last impact."""
    crank = cj.load(SCENES / "slider_crank.toml")
    wrist, law = crank.joint("wrist"), cj.laws.exact_restitution(stiffness=1e9, restitution=0.6)
    speed = cj.parameters(crank)["drive.main.speed"].value
    crank = crank.with_joint(eqx.tree_at(lambda joint: joint.clearance.normal, wrist, law))

    def states(part, rtol):
        moved = cj.replace(crank, {"drive.main.speed": part * speed})
        return cj.simulate(moved, 12e-3, rtol=rtol, solver="dopri8", save_at=41).y[:, :4]

    lanes, parts = jax.jit(jax.vmap(states, (0, None))), jnp.linspace(0.8, 1.2, 256)
    right = lanes(parts, 1e-12)
    for rtol in (3e-6, 1e-6, 3e-7):
        off = jnp.abs(lanes(parts, rtol) - right) / jnp.max(jnp.abs(right), (0, 1), keepdims=True)
        assert float(jnp.max(off)) < 60 * rtol


@pytest.mark.parametrize("count", [1, 4, 5, 13])
def test_chunks_put_results_back_in_order(count):
    seen = []

    def solve(batch):
        seen.append(batch["x"].shape[0])
        return {"twice": 2 * batch["x"], "sum": batch["x"] + batch["y"][:, 0]}

    x = jnp.arange(float(count))
    out = over_chunks(solve, {"x": x, "y": x[:, None]}, count, lanes=4)
    np.testing.assert_array_equal(out["twice"], 2 * x)
    np.testing.assert_array_equal(out["sum"], 2 * x)
    assert max(seen) <= 4


def test_alone_is_alone_and_a_batch_is_together():
    function = batch_by(lambda x: x + 1, lambda batch: batch + 10)
    assert float(function(jnp.asarray(1.0))) == 2.0
    np.testing.assert_array_equal(jax.vmap(function)(jnp.arange(3.0)), [10.0, 11.0, 12.0])
    np.testing.assert_array_equal(jax.vmap(jax.vmap(function))(jnp.zeros((2, 3))), np.full((2, 3), 10.0))


def test_shared_numbers_are_the_same_numbers():
    assert share((1.0, "name", jnp.asarray(3.0)))[:2] == (1.0, "name")
    with sharing():
        program = jax.make_jaxpr(share)(jnp.asarray(2.0)).jaxpr
        assert program.eqns[-1].primitive is barrier
        assert int(share(jnp.asarray(3))) == 3
    doubled = each_lane(lambda a, b: share(a) * b, jnp.zeros(3))
    np.testing.assert_array_equal(doubled(jnp.arange(3.0), jnp.full(3, 2.0)), [0.0, 2.0, 4.0])
