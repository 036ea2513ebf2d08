"""Datasets: blocks against the whole, episodes against loops that say what they mean, peaks against closed forms."""

from typing import Any

import catalogue
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax._compile.runtime import RUNTIME
from clearance_jax.dynamics.quantities import observe
from clearance_jax.mechanism.state import layout
from clearance_jax.metrics.observed import FirstFall
from clearance_jax.results import blocks, episodes
from clearance_jax.results.blocks import in_blocks
from clearance_jax.results.first_fall import first_fall_ends, loads, peak_words
from clearance_jax.results.peaks import cubic_top, peaks

MASS, SPEED, CLEARANCE, GAP = 0.14, 0.5, 1e-3, 1e-5


# Blocks ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 24, 30])
def test_blocks_are_the_whole_and_are_traced_once(count):
    traced, mechanism = [], thrown(laws.Hertz(1e9))

    @jax.jit
    def program(mechanism, x):
        traced.append(x.shape)
        mass = mechanism.bodies[0].mass
        return {"times": mass * x, "sum": jnp.sum(x, axis=1)}

    x = np.arange(3.0 * count).reshape(count, 3)
    for part in (x, x[:1], x[: count // 2]):
        out = in_blocks(program, mechanism, part, size=8)
        np.testing.assert_array_equal(out["times"], MASS * part)
        np.testing.assert_array_equal(out["sum"], part.sum(axis=1))
    assert traced == [(8, 3)]


@pytest.fixture(scope="module")
def crank():
    mechanism = catalogue.slider_crank()
    return mechanism, cj.trace(mechanism, 4e-3, save_at=21)


def compiled(block: Any) -> int:
    """How many programs of a block's function there are."""
    return block.plain.alone._cached._cache_size()


def test_a_dataset_of_any_length_runs_the_same_programs(crank):
    mechanism, trace = crank
    samples: Any = blocks.observed
    before = compiled(samples)
    cj.to_dataset(mechanism, trace)
    # Few samples are observed by the program of the step ends.
    assert compiled(samples) == before
    programs: list[Any] = [blocks.observed, blocks.observed_with_rates, blocks.inside]
    before = [compiled(program) for program in programs]
    other = cj.replace(mechanism, {"conrod.mass": 0.2})
    for steps, samples in ((100, 5), (trace.time.size // 2, 11)):
        numbers = trace.time[:steps], trace.y[:steps], trace.solution.time[:samples], trace.solution.y[:samples]
        part = eqx.tree_at(lambda t: (t.time, t.y, t.solution.time, t.solution.y), trace, numbers)
        assert cj.to_dataset(other, part).sizes["step"] == steps
    assert [compiled(program) for program in programs] == before


def test_many_samples_are_observed_by_a_program_of_their_own(crank, monkeypatch):
    mechanism, trace = crank
    few = cj.to_dataset(mechanism, trace)
    monkeypatch.setattr(blocks, "SHARED", 0)
    monkeypatch.setattr(RUNTIME, "folder", None)  # a kept program is not counted
    samples: Any = blocks.observed
    before = compiled(samples)
    many = cj.to_dataset(mechanism, trace)
    assert compiled(samples) == before + 1
    for name, values in few.items():
        np.testing.assert_allclose(many[name], values, rtol=1e-12, atol=1e-15, err_msg=name)


def test_a_dataset_is_what_is_observed(crank):
    mechanism, trace = crank
    dataset = cj.to_dataset(mechanism, trace)
    ready = mechanism.prepare()
    for i in (0, 7, 20):
        seen = observe(trace.solution.time[i], trace.solution.y[i], ready)
        assert set(seen) <= set(dataset)
        for name, value in seen.items():
            np.testing.assert_allclose(dataset[name].values[i], value, rtol=1e-10, atol=1e-12, err_msg=name)
    touch = trace.time.size // 2
    seen = observe(jnp.asarray(trace.time[touch]), jnp.asarray(trace.y[touch]), ready)
    for name, other in (("step_eccentricity", "eccentricity"), ("step_force", "contact_force")):
        np.testing.assert_allclose(dataset[name].values[touch], seen[other], rtol=1e-10, atol=1e-12)


def test_a_peak_of_the_first_fall_is_named_as_such(crank):
    """A pin in the middle of its sleeve falls, strikes once, and leaves: that peak is not the machine's."""
    dataset = cj.to_dataset(*crank)
    found, first = loads(dataset), dataset.isel(episode=0)
    assert found is not None
    assert found.falling
    assert found.centred
    assert first_fall_ends(dataset) == pytest.approx(float(first.episode_end), abs=1e-8)  # the step ends just past it
    assert found.largest.force == pytest.approx(float(first.peak_force))
    assert found.after is not None
    assert found.after.force == pytest.approx(float(dataset.peak_force[1:].max()))
    ms = float(first.peak_time) * 1e3
    assert f"N at {ms:.4g} ms, the first fall from the sleeve's centre; after it" in str(found)


def test_an_acceleration_of_the_first_fall_is_named_as_such():
    """The pin strikes at 2 ms and leaves at 3 ms; what shakes the machine at 5 ms is its own."""
    time, states = np.linspace(0.0, 6e-3, 7), np.array([0, 0, 2, 0, 1, 1, 1])
    dataset = xr.Dataset(
        {
            "acceleration": (("time", "point", "axis"), np.zeros((7, 1, 2)), {"units": "m/s^2"}),
            "largest_acceleration": (("after", "point"), [[9.0], [4.0]]),
            "largest_acceleration_time": (("after", "point"), [[2e-3], [5e-3]]),
            "step_state": (("step", "joint"), states[:, None]),
            "step_time": ("step", time),
        },
        {"time": time, "point": ["tip"], "after": [0.0, 3e-3]},
    )
    assert peak_words(dataset, "acceleration", "tip") == (
        "9 m/s^2 at 2 ms, as pins first fall; after it 4 m/s^2 at 5 ms"
    )
    settled = dataset.assign(step_state=dataset.step_state.clip(min=1)).isel(after=[0])
    assert peak_words(settled, "acceleration", "tip") == "9 m/s^2 at 2 ms"
    ideal = dataset.drop_vars(["step_state", "step_time"]).isel(after=[0])
    assert peak_words(ideal, "acceleration", "tip") == "9 m/s^2 at 2 ms"


def test_a_peak_in_space_counts_every_axis():
    values = np.zeros((3, 1, 3))
    values[1, 0] = 3.0, 4.0, 12.0
    velocity = xr.DataArray(values, dims=("time", "point", "axis"), attrs={"units": "m/s"})
    dataset = xr.Dataset({"velocity": velocity}, {"time": [0.0, 1e-3, 2e-3], "point": ["tip"]})
    assert peak_words(dataset, "speed", "tip") == "13 m/s at 1 ms, of 3 samples"


def test_a_pin_that_starts_at_its_wall_does_not_fall(crank):
    dataset = cj.to_dataset(*crank)
    begun = dataset.isel(step=dataset.step_state.values[:, 0].argmax() + np.arange(20))
    found = loads(begun.isel(episode=slice(0, 1)))
    assert found is not None
    assert not found.falling
    assert "fall" not in str(found)
    assert loads(dataset.isel(step=slice(0, 5), episode=slice(0, 0))) is None


def test_progress_rises_to_one_and_may_interrupt(crank):
    done = []
    cj.to_dataset(*crank, progress=done.append)
    assert done == sorted(done)
    assert 0 < done[0] < 1
    assert done[-1] == 1
    done.clear()
    cj.to_dataset(crank[0], crank[1].solution, progress=done.append)
    assert done == [1]

    def interrupt(fraction):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cj.to_dataset(*crank, progress=interrupt)


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
    motion = cj.Motion(cj.drives.Harmonic(0.1, 10.0))
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


# Episodes ----------------------------------------------------------------------------------------------------------


def random_contacts(seed, size=400):
    """Step ends at which a joint touches and lets go, for a while, for one step end, or for a round-off of time."""
    key = np.random.default_rng(seed)
    time = np.cumsum(key.choice([1e-14, 1e-4, 1e-3, 1e-2], size, p=[0.1, 0.3, 0.3, 0.3]))
    walk = np.sin(np.cumsum(key.normal(0, 0.4, size))) + 0.3 * key.normal(size=size)
    decay = np.exp(-np.abs(key.normal(0, 3, size)))
    return time, walk, key.normal(size=size) * decay


def spans_by_loop(time, penetration):
    """Begin, end (may be one past the last step end) of every contact; those a round-off apart are one."""
    found, start = [], None
    for i, depth in enumerate([*penetration, -1.0]):
        if depth > 0 and start is None:
            start = i
        if depth <= 0 and start is not None:
            if found and time[start] - time[found[-1][1]] < episodes.SHORTEST:
                found[-1][1] = i
            else:
                found.append([start, i])
            start = None
    return [(b, e) for b, e in found if e >= time.size or time[e] - time[b] > episodes.SHORTEST]


def impact_end_by_loop(t, rate, lasting):
    end = t[-1]
    turns = [i + 1 for i in range(len(t) - 1) if np.sign(rate[i + 1]) != np.sign(rate[i])]
    if len(turns) >= 2:
        end = min(end, t[turns[1]])
    last = 0
    for i in range(1, len(t)):
        if abs(rate[i]) < episodes.LIVELY * abs(rate[0]):
            continue
        if i - last > 1 and t[i - 1] - t[last + 1] >= t[last] - t[0]:
            return min(end, t[last])
        last = i
    return min(end, t[last]) if lasting else end


@pytest.mark.parametrize("seed", range(20))
def test_episodes_are_those_of_a_loop(seed):
    time, penetration, rate = random_contacts(seed)
    if seed == 0:
        penetration = -np.abs(penetration)
    found, expected = episodes.spans(time, penetration), spans_by_loop(time, penetration)
    np.testing.assert_array_equal(found.first, [b for b, _ in expected])
    np.testing.assert_array_equal(found.last, [min(e, time.size - 1) for _, e in expected])
    np.testing.assert_array_equal(found.lasting, [e >= time.size for _, e in expected])
    ends = episodes.impact_ends(time, rate, found)
    parts = [slice(b, e + 1) for b, e in zip(found.first, found.last, strict=True)]
    by_loop = [impact_end_by_loop(time[p], rate[p], more) for p, more in zip(parts, found.lasting, strict=True)]
    np.testing.assert_array_equal(ends, by_loop)
    begins = time[found.first]
    states = episodes.contact_states(time, penetration, begins, ends)
    for t, depth, state in zip(time, penetration, states, strict=True):
        impact = any(b <= t <= e for b, e in zip(begins, ends, strict=True))
        assert state == (0 if depth <= 0 else 2 if impact else 1)


# Peaks -------------------------------------------------------------------------------------------------------------


def test_the_top_of_a_cubic():
    one = np.ones(2)
    x, top = cubic_top(one, 2 * one, one, np.asarray([-2.0, 1.0]))
    np.testing.assert_allclose(x, [0.5, np.nan])
    np.testing.assert_allclose(top, [1.5, np.nan])


def seen_force(time, force):
    """Step ends of one contact with the given force (a function that also gives its rate)."""
    value, rate = force(time)
    nothing = np.zeros_like(time)
    return episodes.StepEnds(time, np.ones_like(time), nothing, value, rate, nothing, nothing)


def looked_into(time, force):
    def inside(step, s):
        value, rate = force(time[step] + s * (time[step + 1] - time[step]))
        return value, rate * (time[step + 1] - time[step])

    return inside


def two_lobes(t):
    """The higher lobe is narrow: at the step ends it is the lower one."""
    value = np.exp(-((t - 1.0) ** 2)) + 1.1 * np.exp(-200 * (t - 2.65) ** 2)
    return value, -2 * (t - 1.0) * np.exp(-((t - 1.0) ** 2)) - 440 * (t - 2.65) * np.exp(-200 * (t - 2.65) ** 2)


def higher_first(t):
    value, rate = two_lobes(4 - t)
    return value, -rate


def hidden_valley(t):
    """A step that rises at both ends and ends lower than it starts."""
    return -0.4 * t + np.sin(2 * np.pi * (t + 0.1)), -0.4 + 2 * np.pi * np.cos(2 * np.pi * (t + 0.1))


def jump(t):
    """Largest at the touch."""
    return np.exp(-t), -np.exp(-t)


CASES = [
    (two_lobes, np.linspace(0, 4, 33), 1e-8),
    (two_lobes, np.linspace(0.1, 3.7, 25), 1e-8),
    (higher_first, np.linspace(0.05, 3.9, 27), 1e-8),
    (hidden_valley, np.linspace(0, 1, 2), 1e-4),  # four looks from the middle, without a cubic to start with
    (hidden_valley, np.linspace(0, 1, 6), 1e-8),
    (jump, np.linspace(0, 3, 8), 1e-15),
]


@pytest.mark.parametrize(("force", "time", "accuracy"), CASES)
def test_peaks_are_the_largest_force(force, time, accuracy):
    seen = seen_force(time, force)
    found = peaks(seen, episodes.spans(time, seen.penetration), looked_into(time, force))
    dense = np.linspace(time[0], time[-1], 2_000_001)
    top = int(np.argmax(force(dense)[0]))
    np.testing.assert_allclose(found.value, [force(dense)[0][top]], rtol=accuracy)
    # The force misses its top by the square of how far off the place is.
    np.testing.assert_allclose(found.time, [dense[top]], atol=2 * np.sqrt(accuracy))


def test_few_steps_are_looked_into():
    """A contact at rest that trembles in its last digits, and one impact in it."""
    time = np.linspace(0, 1, 20_001)
    tremble = 1e-9 * np.sin(8000 * time), 8e-6 * np.cos(8000 * time)

    def force(t):
        bump = np.exp(-1e6 * (t - 0.500013) ** 2)
        return 1 + bump, -2e6 * (t - 0.500013) * bump

    value, rate = force(time)
    seen = seen_force(time, lambda t: (value + tremble[0], rate + tremble[1]))
    asked = []

    def inside(step, s):
        asked.extend(step)
        return looked_into(time, force)(step, s)

    found = peaks(seen, episodes.spans(time, seen.penetration), inside)
    assert len(set(asked)) <= 2
    np.testing.assert_allclose(found.value, [2.0], rtol=1e-8)


def thrown(law) -> cj.Mechanism:
    """A pin on a guide through its sleeve's centre, `GAP` before the wall and flying at it."""
    return cj.Mechanism(
        bodies=(cj.Body("pin", MASS),),
        joints=(cj.Prismatic("guide", "ground", "pin", motion=cj.Motion(position=CLEARANCE - GAP, velocity=SPEED)),),
        loops=(cj.Revolute("j", "ground", "pin", clearance=cj.RevoluteClearance(CLEARANCE, 0.01, law)),),
        gravity=cj.Gravity(x=0.0),
        assemble=False,
    )


@pytest.mark.parametrize(("exponent", "stiffness"), [(1.1, 1e9), (1.5, 6.61e10), (2.0, 1e13)])
@pytest.mark.parametrize("solver", ["tsit5", "dopri8"])
def test_largest_force_of_a_hertz_impact(exponent, stiffness, solver):
    depth = ((exponent + 1) * MASS * SPEED**2 / (2 * stiffness)) ** (1 / (exponent + 1))
    mechanism = thrown(laws.Hertz(stiffness, exponent))
    trace = cj.trace(mechanism, (GAP + 8 * depth) / SPEED, save_at=2, rtol=1e-8, solver=solver)
    dataset = cj.to_dataset(mechanism, trace)
    assert dataset.sizes["episode"] == 1
    assert float(dataset.peak_force[0]) == pytest.approx(stiffness * depth**exponent, rel=3e-8)
    middle = 0.5 * (dataset.episode_start + dataset.episode_end)
    assert float((dataset.peak_time - middle)[0]) == pytest.approx(0, abs=1e-4 * depth / SPEED)


def flores_on_a_drive() -> cj.Mechanism:
    """A law that remembers its impact speed, and a drive whose acceleration jumps."""
    play = cj.RevoluteClearance(1e-4, 0.01, laws.flores(1e9, 0.6), laws.TanhCoulomb(0.1, 1e-2))
    drive = cj.drives.StepSum([0.0, 0.013], [0.013, 0.031], [0.4, -0.3])
    return cj.Mechanism(
        bodies=(cj.Body("arm", 1.0, 0.01, cj.Position(0.1)),),
        joints=(cj.Revolute("hip", "ground", "arm", motion=cj.Motion(drive), clearance=play),),
        gravity=cj.Gravity(y=-9.81),
    )


@pytest.fixture(scope="module")
def long_steps():
    mechanism = flores_on_a_drive()
    return mechanism, cj.trace(mechanism, 0.04, save_at=2, rtol=1e-9, solver="dopri8")


@pytest.mark.slow
def test_largest_forces_agree_between_short_and_long_steps(long_steps):
    mechanism, trace = long_steps
    short = cj.to_dataset(mechanism, cj.trace(mechanism, 0.04, save_at=2, rtol=1e-10, solver="tsit5"))
    long = cj.to_dataset(mechanism, trace)
    assert short.sizes["episode"] == long.sizes["episode"] > 2
    np.testing.assert_allclose(long.peak_force, short.peak_force, rtol=1e-6)


def test_the_force_inside_a_step_ends_as_the_step(long_steps):
    """Also up to a break of the drive and past it, and where the laws' memory is latched as the step begins."""
    mechanism, trace = long_steps
    t, y = trace.time, trace.y
    seen = in_blocks(blocks.observed_with_rates, mechanism, t, y)
    arrays = t[:-1], y[:-1], np.diff(t), np.ones(t.size - 1)
    force, slope, *_ = in_blocks(blocks.inside, mechanism, *arrays, size=blocks.FEW)["contact"]
    expected = seen["contact_force"][1:]
    np.testing.assert_allclose(force, expected, rtol=1e-7, atol=1e-9 * expected.max())
    # At a break the rate is that after it, but the step ends before it.
    smooth = np.abs(t[1:, None] - np.asarray([0.013, 0.031])).min(axis=1) > 1e-12
    assert np.sum(~smooth) == 2
    expected, found = seen["force_rate"][1:][smooth], (slope / np.diff(t)[:, None])[smooth]
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())
    assert layout(mechanism).remembered == 2


def test_the_largest_speed_and_acceleration_are_those_of_the_motion(crank):
    """Whatever the samples, and nothing that many samples see is larger. (In the longer steps of `rtol` 1e-8 the curve
    through their ends errs by 2e-7 of an acceleration.)
    """
    mechanism, _ = crank
    trace = cj.trace(mechanism, 4e-3, save_at=21, rtol=1e-10)
    found = cj.to_dataset(mechanism, trace)
    dense = cj.to_dataset(mechanism, cj.trace(mechanism, 4e-3, save_at=20001, rtol=1e-10))
    over = first_fall_ends(found).max()
    assert 0 < over < 4e-3
    assert found["after"].values[0] == 0.0
    assert found["after"].values[1] > over
    for name, vector in (("speed", "velocity"), ("acceleration", "acceleration")):
        sizes = np.linalg.norm(dense[vector].values[:, 0], axis=-1)
        for window, begin in enumerate(found["after"].values):
            largest, time = (float(found[f"largest_{name}{end}"][window, 0]) for end in ("", "_time"))
            seen = sizes[dense.time.values >= begin].max()
            assert seen * (1 - 1e-9) <= largest <= seen * (1 + 1e-4), (name, window)
            beside = np.interp(time, dense.time.values, sizes)
            np.testing.assert_allclose(beside, largest, rtol=1e-3)
            np.testing.assert_allclose(dense[f"largest_{name}"][window, 0], largest, rtol=1e-9)
    assert sizes[:: 20000 // 20].max() < 0.9 * sizes.max()  # what 21 samples see of the acceleration
    words = peak_words(found, "acceleration", str(found["point"].values[0]))
    assert ", as pins first fall; after it " in words
    few = cj.to_dataset(mechanism, trace.solution)
    assert peak_words(few, "speed", str(few["point"].values[0])).endswith(", of 21 samples")


def test_the_largest_speed_of_a_motion_without_play_is_that_of_its_steps():
    """A pendulum from the horizontal: at the bottom w^2 = 2 m g d / J, v = w d and a = w^2 d."""
    rod = cj.Body("rod", mass=1.0, inertia=0.02)
    tip = cj.Point("tip", "rod", cj.Position(0.0, 0.0))
    pivot = cj.Revolute("pivot", "ground", "rod", motion=cj.Motion(position=0.0), at_child=cj.Position(-0.5, 0.0))
    pendulum = cj.Mechanism((rod,), (pivot,), points=(tip,), gravity=cj.Gravity(0.0, -9.81))
    found = cj.to_dataset(pendulum, cj.trace(pendulum, 0.8, save_at=3, rtol=1e-10))
    turn2 = 2 * 9.81 * 0.5 / (0.02 + 0.25)
    np.testing.assert_allclose(found["largest_speed"], [[0.5 * np.sqrt(turn2)]], rtol=1e-9)
    np.testing.assert_allclose(found["largest_acceleration"], [[0.5 * turn2]], rtol=1e-9)
    assert found.sizes["after"] == 1


@pytest.mark.slow
def test_the_first_fall_of_a_solve_ends_where_that_of_its_trace_does(crank):
    """The metric of designs' reports, and the rule of datasets, that share nothing."""
    mechanism, trace = crank
    over = first_fall_ends(cj.to_dataset(mechanism, trace))
    found = [FirstFall(joint.name)(mechanism, 4e-3) for joint in mechanism.clearance_joints()]
    np.testing.assert_allclose(found, over, rtol=1e-9)
    resting = cj.trace(mechanism, 1e-4, save_at=2, start="settled")
    assert [first_fall_ends(cj.to_dataset(mechanism, resting))] == [[-np.inf]]
    assert float(FirstFall(mechanism.clearance_joints()[0].name)(mechanism, 1e-4, start="settled")) == -np.inf
