"""`cj.sweep`: every lane is its own solve, whatever its company, its store, and whoever died on the way."""

import functools
import importlib

import jax
import numpy as np
import pytest
import scipy.stats
import sweeping
import xarray as xr
from places import refused
from scipy import stats
from sweeping import CLEARANCES, SCENE, SPEEDS, swept

import clearance_jax as cj
from clearance_jax.sweep.grid import Partition, partition

MECHANISM = cj.load(SCENE)
PEAK = cj.metrics.Peak(cj.metrics.PositionError("piston"))


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    sweeping.small_regions(monkeypatch)


@pytest.fixture(scope="module")
def whole():
    """The answers in memory."""
    return swept()


def same(found, expected):
    """Bit by bit, coordinates too."""
    xr.testing.assert_identical(found.load().drop_attrs(), expected.drop_attrs()[list(found.data_vars)])


# What comes out ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_lane_is_its_own_solve(whole):
    """To ten times the tolerance: the motion is regular here."""

    def solved(clearance, speed):
        single = cj.replace(MECHANISM, {"wrist.radial_clearance": clearance, "drive.main.speed": speed})
        solution = cj.simulate(single, 5e-4, rtol=1e-6, energy_balance=False)
        return PEAK(single, 5e-4, rtol=1e-6), solution["piston.position"]

    solved = jax.jit(solved)
    for i, j in np.random.default_rng(0).integers((0, 0), (len(CLEARANCES), len(SPEEDS)), (24, 2)):
        lane = whole.isel({"wrist.radial_clearance": i, "drive.main.speed": j})
        peak, end = solved(CLEARANCES[i], SPEEDS[j])
        np.testing.assert_allclose(lane["peak"], peak, rtol=1e-5)
        np.testing.assert_allclose(lane["end"], end, rtol=1e-5, atol=1e-15)


@pytest.mark.slow
def test_the_answer_is_labelled(whole):
    assert whole["peak"].dims == ("wrist.radial_clearance", "drive.main.speed")
    assert whole["end"].dims == (*whole["peak"].dims, "axis")
    assert (whole["peak"].attrs["units"], whole["wrist.radial_clearance"].attrs["units"]) == ("m", "m")
    assert whole["drive.main.speed"].attrs == {"units": "rad/s", "long_name": "drive.main.speed"}
    assert (whole.attrs["lanes"], whole.attrs["failed"], whole.attrs["not_run"]) == (512, 0, 0)
    np.testing.assert_array_equal(whole["drive.main.speed"], SPEEDS)


@pytest.fixture
def limited():
    """A sweep of four lanes, which take 83, 71, 61 and 43 attempts, with fewer allowed."""
    return functools.partial(
        cj.sweep, MECHANISM, {"wrist.radial_clearance": [1e-4, 2e-4, 4e-4, 5e-4]}, {"end": "piston.position"}, 5e-4,
        rtol=1e-6, solver="tsit5", max_steps=66,
    )  # fmt: skip


@pytest.mark.slow
def test_failed_lanes_are_masked_counted_and_run_again(limited):
    few, again = limited(), limited(again={"max_steps": 10_000})
    assert (few.attrs["failed"], again.attrs["failed"]) == (2, 0)
    assert few.attrs["failures"] == "2 the largest number of steps was reached"
    np.testing.assert_array_equal(few["code"], [3, 3, 0, 0])
    np.testing.assert_array_equal(np.isnan(few["end"].isel(axis=0)), [True, True, False, False])
    np.testing.assert_array_equal(again["again"], [1, 1, 0, 0])
    assert np.all(np.isfinite(again["end"]))
    np.testing.assert_array_equal(again["end"][2:], few["end"][2:])


@pytest.mark.slow
def test_models_scatter_and_samples_in_time():
    """A law for each label, correlated scatter along a dimension of samples, a quantity over time."""

    def rough(mechanism):
        return cj.replace(mechanism, {"wrist.friction.coefficient": 0.3})

    scatter = {
        "slider.mass": cj.scatter(0.14, 1e-3),
        "wrist.radial_clearance": cj.scatter(2e-4, 1e-5, 1.9e-4, 2e-4),
    }
    sampled = cj.Sampled(scatter, 6, seed=3)
    axes = {"part": sampled, "friction": cj.Choice({"usual": MECHANISM, "rough": rough})}
    found = cj.sweep(
        MECHANISM, axes, {"x": "piston.position.x", "lost": cj.metrics.EnergyLost()}, 5e-4, times=3, rtol=1e-6
    )
    assert found["x"].dims == ("part", "friction", "time")
    assert found["lost"].attrs["units"] == "J"
    np.testing.assert_array_equal(found["slider.mass"], sampled.draw()["slider.mass"])
    assert "'seed': 3" in found.attrs["sampling.part"]
    assert np.all(found["lost"].sel(friction="rough") > found["lost"].sel(friction="usual"))
    # The energy balance is integrated where an output asks for them.
    assert np.all(found["energy_residual"] < 1e-4)
    np.testing.assert_allclose(found["time"], [0, 2.5e-4, 5e-4])
    np.testing.assert_allclose(found["x"].isel(time=0), 0.17)


@pytest.mark.slow
def test_derivatives_are_in_the_order_asked():
    names = ["wrist.radial_clearance", "slider.mass"]
    axes = {"drive.main.speed": cj.Zipped({"drive.main.speed": [400.0, 500.0], "t1": [6e-4, 5e-4]})}
    outputs = {"peak": PEAK, "impacts": cj.metrics.Impacts("wrist")}
    found = cj.sweep(MECHANISM, axes, outputs, wrt=names, derivatives_of=["peak"], rtol=1e-6)
    assert found["peak_derivative"].dims == ("drive.main.speed", "parameter")
    assert list(found["parameter"].values) == names
    assert "impacts_derivative" not in found
    expected = cj.sensitivities(cj.replace(MECHANISM, {"drive.main.speed": 500.0}), PEAK, names, 5e-4, rtol=1e-6)
    np.testing.assert_allclose(found["peak_derivative"][1], [expected.jacobian[name] for name in names], rtol=1e-3)


def test_one_program_for_all_lanes(whole):
    """Another grid of the same question traces and compiles nothing: heard where JAX does either."""
    assert whole.sizes["drive.main.speed"] == 16
    seen = []

    def hear(name, *_, **__):
        seen.append(name)

    jax.monitoring.register_event_duration_secs_listener(hear)
    try:
        swept(clearances=np.linspace(2e-4, 4e-4, 50), speeds=np.linspace(300.0, 350.0, 7))
        heard = [name for name in seen if "/compile/" in name]
        jax.jit(lambda x: x + 3)(1.0)
    finally:
        jax.monitoring.unregister_event_duration_listener(hear)
    assert heard == []
    assert {"trace", "compile"} <= {word for word in ("trace", "compile") if any(word in name for name in seen)}


def test_failed_lanes_of_a_store_are_run_again_once(tmp_path, limited):
    run = functools.partial(limited, store=tmp_path / "a.zarr")
    assert run().attrs["failed"] == 2
    found = run(resume=True, again={"max_steps": 77})
    assert found.attrs["failed"] == 1
    np.testing.assert_array_equal(found["again"], [1, 1, 0, 0])
    np.testing.assert_array_equal(run(resume=True, again={"max_steps": 77})["again"], [1, 1, 0, 0])
    assert run(resume=True, again={"max_steps": 10_000}).attrs["failed"] == 0


def test_a_region_in_which_every_lane_fails_is_kept(tmp_path, limited):
    """Its values are all missing, so that its chunks are as if nothing had been written."""
    run = functools.partial(limited, store=tmp_path / "a.zarr", max_steps=5, resume=True)
    assert run().attrs["failed"] == 4
    plans = []
    assert run(plan=plans.append).attrs["failed"] == 4
    assert plans[0].known == 4
    assert run(again={"max_steps": 10_000}).attrs["failed"] == 0


def test_a_region_whose_lanes_are_run_again_is_kept_meanwhile(tmp_path, limited, monkeypatch):
    """Stopped between its first chunk and its last: as if that had not begun."""
    path = tmp_path / "a.zarr"
    run = functools.partial(limited, store=path)
    run()

    def torn(root, cut, region, values):
        root["again"][cut.slices(region)] = values["again"]
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(importlib.import_module("clearance_jax.sweep.store"), "put", torn)
        with pytest.raises(KeyboardInterrupt):
            run(resume=True, again={"max_steps": 77})
    seen = []
    with pytest.warns(UserWarning, match="1 of its regions are damaged"):
        found = run(resume=True, again={"max_steps": 77}, progress=seen.append)
    assert [p.new for p in seen] == [0.0]
    assert found.attrs["failed"] == 1
    np.testing.assert_array_equal(found["again"], [1, 1, 0, 0])
    assert not (path / "partial").exists()


# What is refused -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("axes", "options", "about"),
    [
        ({}, {}, ("axes",)),
        ({"wrist.radial_clearance": []}, {}, ("wrist.radial_clearance", None)),
        ({"wrist.radius": [1.0]}, {}, ("wrist.radius", "wrist.radius", "wrist.radial_clearance")),
        ({"wrist.radial_clearance": [1e-4, -1e-4]}, {}, ("wrist.radial_clearance", -1e-4, "greater than 0 m")),
        ({"slider.mass": [0.1, np.nan]}, {}, ("slider.mass", None, "finite")),
        ({"a": cj.Zipped({"slider.mass": [0.1], "conrod.mass": [0.1, 0.2]})}, {}, ("a", None)),
        (
            {"slider.mass": [0.1], "a": cj.Zipped({"slider.mass": [0.1]})},
            {},
            ("slider.mass", None, None),
        ),
        ({"a": cj.Choice({"b": 3})}, {}, ("b",)),
        ({"a": cj.Sampled({"slider.mass": 0.1}, 4)}, {}, ("slider.mass", 0.1)),
        ({"t1": [1e-3]}, {}, ("t1",)),
        (
            {"slider.mass": np.linspace(0.1, 0.2, 100_000), "conrod.mass": np.linspace(0.1, 0.2, 100_000)},
            {},
            ("store",),
        ),
        ({"slider.mass": [0.1]}, {"outputs": {"code": PEAK}}, ("code",)),
        (
            {"slider.mass": [0.1]},
            {"outputs": {"x": "piston.place"}},
            ("piston.place", "piston.place", "piston.position"),
        ),
        ({"slider.mass": [0.1]}, {"wrt": ["slider.weight"]}, ("slider.weight", "slider.weight", "slider.mass")),
        ({"slider.mass": [0.1]}, {"save_at": 5}, ("save_at",)),
    ],
)
def test_refusals(axes, options, about):
    with refused(*about):
        cj.sweep(MECHANISM, axes, **{"outputs": {"peak": PEAK}, "t1": 1e-3, **options})


def test_a_grid_larger_than_the_disk_is_refused(tmp_path):
    axes = {name: np.linspace(0.1, 0.2, 10_000) for name in ("slider.mass", "conrod.mass", "crank.mass")}
    with refused(tmp_path / "a.zarr"):
        cj.sweep(MECHANISM, axes, {"peak": PEAK}, 1e-3, store=tmp_path / "a.zarr")


# Parts ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shape", "apart", "least"), [((100, 7, 30), (0, 0, 0), 64), ((5, 3, 900), (0, 1, 0), 400), ((3, 4), (0, 0), 100)]
)
def test_regions_are_every_lane_once(shape, apart, least):
    cut = partition(shape, [bool(flag) for flag in apart], least)
    lanes = [cut.lanes(region) for region in range(cut.count)]
    assert sorted(np.concatenate(lanes).tolist()) == list(range(np.prod(shape)))
    assert np.prod(cut.chunk) >= min(least, np.prod([n for n, flag in zip(shape, apart, strict=True) if not flag]))
    for region, own in enumerate(lanes):
        assert len(own) == cut.size(region)
        regions, here = cut.of(own)
        assert set(regions.tolist()) == {region}
        np.testing.assert_array_equal(here, np.arange(len(own)))


def test_large_regions_whatever_the_chunks():
    assert partition((100, 100, 100), [False] * 3).chunk == (1, 50, 100)
    assert partition((200, 4, 6), [False, True, False]) == Partition((200, 4, 6), (200, 1, 6))


@pytest.mark.parametrize("method", ["sobol", "latin-hypercube", "random"])
def test_samples_have_their_distributions(method):
    laws = {"a": cj.scatter(3.0, 0.5), "b": stats.uniform(-1.0, 5.0), "c": cj.scatter(0.0, 1.0, -0.5, 2.0)}
    laws["d"] = cj.scatter(2.0, 1.0, distribution="log-normal")
    drawn = cj.Sampled(laws, 1024, method=method, seed=2).draw()
    cdfs = scipy.stats.norm(3.0, 0.5), scipy.stats.uniform(-1.0, 5.0), scipy.stats.truncnorm(-0.5, 2.0)
    # Of log-normal numbers the logarithms scatter by ln(1 + (deviation / mean)^2), about a mean of that much less.
    wide = np.sqrt(np.log(1.25))
    cdfs = *cdfs, scipy.stats.lognorm(wide, scale=2.0 / np.sqrt(1.25))
    for values, law in zip(drawn.values(), cdfs, strict=True):
        assert scipy.stats.kstest(values, law.cdf).pvalue > 1e-3
    again = cj.Sampled(laws, 1024, method=method, seed=2).draw()
    other = cj.Sampled(laws, 1024, method=method, seed=3).draw()
    np.testing.assert_array_equal(drawn["a"], again["a"])
    assert not np.array_equal(drawn["a"], other["a"])


def test_a_longer_sobol_sequence_begins_with_the_shorter():
    short, long = (cj.Sampled({"a": stats.uniform(0.0, 1.0), "b": cj.scatter(0.0, 1.0)}, n).draw() for n in (100, 300))
    np.testing.assert_array_equal(short["b"], long["b"][:100])


def test_correlation_of_normal_numbers_is_theirs():
    laws = {"a": cj.scatter(1.0, 2.0), "b": cj.scatter(0.0, 1e-3), "c": cj.scatter(0.0, 1.0)}
    drawn = cj.Sampled(laws, 4096, correlation={("a", "b"): 0.8, ("b", "c"): -0.4}).draw()
    found = np.corrcoef(list(drawn.values()))
    np.testing.assert_allclose(found, [[1, 0.8, 0], [0.8, 1, -0.4], [0, -0.4, 1]], atol=0.02)
    with refused("correlation"):
        cj.Sampled(laws, 8, correlation={("a", "b"): 0.9, ("b", "c"): 0.9, ("a", "c"): -0.9}).draw()
