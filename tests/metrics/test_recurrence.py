"""Poincare sections and Lyapunov exponents: against plain solves, closed forms, Floquet multipliers, neighbours."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax.errors import ClearanceError
from clearance_jax.metrics.recurrence import LyapunovExponent, PoincareSection, uncertainty
from experiments.common import CRANK_SPEED, slider_crank

CLEARANCE, SPEED = "wrist.radial_clearance", "drive.main.speed"
REVOLUTION = 2 * np.pi / CRANK_SPEED
NAMES = ("crankpin", "guide.velocity", "wrist.eccentricity.x")
PERIODS = 60
CHAOTIC, REGULAR = 2.5e-4, 5e-5


@pytest.fixture(scope="module")
def crank():
    return slider_crank()


def oscillator(stiffness: float, damping: float) -> cj.Mechanism:
    """A mass of 2 kg on a spring and damper, in a shaken frame."""
    slide = cj.Motion(None, 0.3, -0.5, (cj.actuators.JointSpring(stiffness, damping),))
    return cj.Mechanism(
        bodies=(cj.Body("frame", mass=1.0), cj.Body("body", mass=2.0)),
        joints=(
            cj.Prismatic("shaker", "ground", "frame", motion=cj.Motion(cj.drives.Harmonic(0.1, 4.0))),
            cj.Prismatic("slide", "frame", "body", motion=slide),
        ),
    )


@pytest.mark.slow
def test_a_sweep_tells_sections_and_exponents_by_their_parts():
    """A period that is a turn of a speed follows it from lane to lane."""
    rates = np.array([4.0, 5.0, 8.0])
    turns = 2 * np.pi / rates
    name = "drive.shaker.angular_frequency"
    asked = {
        "section": PoincareSection(("slide", "slide.velocity"), name, count=3, phase=0.1),
        "other": PoincareSection("slide.velocity", name, count=2),
        "exponent": LyapunovExponent(name, count=8, uncertainty=True),
    }
    swept = cj.sweep(oscillator(50.0, 30.0), {"rate": cj.Zipped({name: rates, "t1": 8 * turns})}, asked, rtol=1e-9)
    assert {key: one.attrs["metric"] for key, one in swept.data_vars.items() if "metric" in one.attrs} == {
        "section": "PoincareSection",
        "other": "PoincareSection",
        "exponent": "LyapunovExponent",
    }
    assert swept["section"].attrs["units"] == "m, m/s"
    assert swept["section"].dims == ("rate", "instant", "quantity")
    assert swept["other"].dims == ("rate", "other_instant")
    assert swept["quantity"].values.tolist() == ["slide", "slide.velocity"]
    for k in range(3):
        alone = cj.replace(oscillator(50.0, 30.0), {name: rates[k]})
        plain = cj.simulate(alone, 8 * turns[k], save_at=0.1 + turns[k] * np.array([5, 6, 7]), rtol=1e-9)
        expected = np.stack([plain["slide"], plain["slide.velocity"]], axis=1)
        np.testing.assert_allclose(swept["section"][k], expected, rtol=1e-6, atol=1e-9)
    value, error = swept["exponent"].values.T
    decay = np.max(np.roots([2.0, 30.0, 50.0]))
    assert np.all(np.abs(value - decay) < 2 * error)
    assert np.all(value + 2 * error < 0)


def test_uncertainties_of_exponents():
    """Independent growths have the standard error of their mean; parting in proportion to time is no chaos."""
    random = 3.0 + np.random.default_rng(0).normal(size=(400, 300))
    found = np.asarray(uncertainty(jnp.asarray(random), 0.5))
    assert found.shape == (300,)
    expected = np.hypot(1 / 20, np.log(400) / 400) / 0.5
    np.testing.assert_allclose(found.mean(), expected, rtol=0.03)
    apart = np.log((np.arange(100) + 2) / (np.arange(100) + 1))
    assert 0 < apart.mean() < 2 * uncertainty(jnp.asarray(apart), 1.0)


@pytest.mark.slow
def test_a_section_is_the_states_of_a_plain_solve(crank):
    phase = 0.3 * REVOLUTION
    metric = PoincareSection(NAMES, REVOLUTION, count=3, phase=phase)
    end = 5.5 * REVOLUTION
    # Both are solves, with steps of their own: their impacts amplify what these err.
    found = metric(crank, end, rtol=1e-10)
    times = phase + REVOLUTION * np.array([3, 4, 5])
    np.testing.assert_allclose(metric.times(end), times, rtol=1e-12)
    plain = cj.simulate(crank, end, save_at=times, rtol=1e-10)
    expected = np.stack([plain[name] for name in NAMES], axis=1)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-12)
    # An instant at the very end of the motion is one; round-off of the period does not lose it.
    np.testing.assert_allclose(
        PoincareSection("crankpin", REVOLUTION, count=2).times(4 * REVOLUTION)[-1], 4 * REVOLUTION
    )


def test_exponents_of_a_linear_oscillator_are_its_decay_rates():
    """Overdamped, so that the two differ; the first periods, in which the directions settle, are left aside."""
    mechanism, period, settled = oscillator(50.0, 30.0), 0.25, 12
    metric = LyapunovExponent(period, count=40, exponents=2, running=True)
    running = np.asarray(metric(mechanism, 50 * period, rtol=1e-10))
    total = running * np.arange(1, 41)[:, None]
    rates = (total[-1] - total[settled - 1]) / (40 - settled)
    expected = np.sort(np.roots([2.0, 30.0, 50.0]))[::-1]
    np.testing.assert_allclose(rates, expected, rtol=1e-7)
    # Volume in phase space shrinks by c / m at all times, in whatever direction.
    np.testing.assert_allclose(total.sum(axis=1), -15.0 * np.arange(1, 41), rtol=1e-7)


@pytest.fixture(scope="module")
def growths(crank):
    """Of a chaotic, a regular and a failing lane how fast the largest axis grows in each of the last periods [1/s], the
    exponents, and sections.
    """
    metrics = {
        "running": LyapunovExponent(REVOLUTION, count=PERIODS, running=True),
        "section": PoincareSection(NAMES[:2], REVOLUTION, count=PERIODS),
    }

    def lane(clearance):
        return cj.measure(cj.replace(crank, {CLEARANCE: clearance}), metrics, 2 * PERIODS * REVOLUTION, rtol=1e-7)

    found = cj.batch(lane, np.array([CHAOTIC, REGULAR, -1.0]))
    steps = np.diff(found["running"] * np.arange(1, PERIODS + 1), axis=1, prepend=0)
    return steps, found["running"][:, -1], found["section"]


def scatter(steps: np.ndarray) -> float:
    return float(steps.std(ddof=1) / np.sqrt(steps.size))


@pytest.mark.slow
@pytest.mark.optimised
def test_a_chaotic_exponent_is_how_two_trajectories_part(crank, growths):
    mechanism = cj.replace(crank, {CLEARANCE: CHAOTIC})
    apart = 1e-7 * jnp.array([1.0, 0.1, CRANK_SPEED, 0.1 * CRANK_SPEED])

    def size(difference):
        return jnp.linalg.norm(difference / apart)

    @jax.jit
    def parting(y, difference):
        def period(carry, k):
            ours, difference = carry
            begin = k * REVOLUTION
            both = jnp.stack([ours, ours + difference])
            solved = jax.vmap(lambda y: cj.simulate(mechanism, begin + REVOLUTION, t0=begin, y0=y, rtol=1e-9).final[:4])
            one, other = solved(both)
            grown = size(other - one)
            return (one, (other - one) / grown), jnp.log(grown)

        return jax.lax.scan(period, (y, difference), PERIODS + jnp.arange(PERIODS))[1]

    begin = cj.simulate(mechanism, PERIODS * REVOLUTION, rtol=1e-7, energy_balance=False).final
    steps = np.asarray(parting(begin, apart * jnp.array([0.5, -0.5, 0.5, 0.5]))) / REVOLUTION
    ours, exponent = growths[0][0], growths[1][0]
    assert exponent > 2 * uncertainty(jnp.asarray(REVOLUTION * ours), REVOLUTION)
    assert abs(exponent - steps.mean()) < 3 * np.hypot(scatter(ours), scatter(steps))


@pytest.mark.slow
def test_a_regular_exponent_is_the_largest_floquet_multipliers(crank, growths):
    cycle = cj.periodic_motion(cj.replace(crank, {CLEARANCE: REGULAR}), REVOLUTION)
    assert bool(cycle.converged)
    expected = np.log(np.abs(cycle.multipliers[0])) / REVOLUTION
    settled = growths[0][1][10:]
    np.testing.assert_allclose(settled.mean(), expected, rtol=1e-4)
    # A motion of one period has one point.
    points = growths[2][1][:, 1]
    np.testing.assert_allclose(points, np.full(PERIODS, cycle.y[3]), atol=1e-6 * 0.05 * CRANK_SPEED)


def test_a_lane_that_fails_has_neither(growths):
    assert np.all(np.isfinite(growths[2][:2]))
    assert np.isnan(growths[1][2])
    assert np.all(np.isnan(growths[2][2]))


@pytest.mark.slow
def test_what_cannot_be_had_is_said(crank):
    with pytest.raises(ClearanceError, match="too short for 9 points"):
        PoincareSection("guide", REVOLUTION, count=9)(crank, 8 * REVOLUTION - 1e-6)
    with pytest.raises(ClearanceError, match="too short for 9 periods"):
        LyapunovExponent(REVOLUTION, count=9)(crank, 8.9 * REVOLUTION)
    with refused("exponents", 5, 4):
        LyapunovExponent(REVOLUTION, exponents=5)(crank, 1.0)
    with refused("piston.velocity", allowed="piston.velocity.x"):
        PoincareSection("piston.velocity", REVOLUTION, count=1)(crank, REVOLUTION)
    with refused("period", CLEARANCE):
        PoincareSection("guide", CLEARANCE, count=1)(crank, REVOLUTION)
    with refused("uncertainty"):
        LyapunovExponent(REVOLUTION, count=3, uncertainty=True)
    with refused("wrist.eccentrcity", allowed="wrist.eccentricity"):
        PoincareSection("wrist.eccentrcity", REVOLUTION, count=1)(crank, REVOLUTION)
