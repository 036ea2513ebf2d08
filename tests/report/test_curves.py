"""Curves of the figures: thinned ones hold every extreme, flights are parabolas, axes of time have few ticks."""

import numpy as np
import pytest

from clearance_jax.report.panels import extremes, flights, smooth

pytestmark = pytest.mark.quick


def test_a_thinned_curve_holds_every_extreme_and_little_more():
    time = np.sort(np.random.default_rng(0).uniform(0, 1, 20_000))
    values = np.sin(2000 * time)
    chosen = extremes(time, values, 100)
    assert 199 <= len(chosen) <= 202
    assert np.all(np.diff(chosen) > 0)
    assert (chosen[0], chosen[-1]) == (0, 19_999)
    for part in np.array_split(np.arange(1, 100), 9):
        inside = (time >= part[0] / 100) & (time < part[-1] / 100)
        shown = values[chosen[inside[chosen]]]
        assert shown.min() < -0.99 < 0.99 < shown.max()
    assert {int(values.argmin()), int(values.argmax())} <= set(chosen)
    # A gap has no columns; a slow curve is its own thinned one, to its change within a column.
    gap = np.flatnonzero((time < 0.3) | (time > 0.6))
    slow = time[gap]
    chosen = extremes(slow, slow, 100)
    assert not np.any((slow[chosen] > 0.3) & (slow[chosen] < 0.6))
    np.testing.assert_allclose(np.interp(slow, slow[chosen], slow[chosen]), slow, atol=1e-12)


def parabola(time):
    return np.stack([time, time * (1 - time)], axis=-1)


@pytest.mark.parametrize("count", [4, 7])
def test_a_flight_of_few_steps_is_the_parabola_that_it_was(count):
    time = np.linspace(0, 1, count) ** 2
    # As a solve leaves it: a touch is a step's end, and a sample may lie a round-off beside it.
    time = np.sort(np.append(time, [time[1] + 1e-13, 1 - 1e-13]))
    path = smooth(time, parabola(time))
    assert len(path) > 5 * count
    np.testing.assert_allclose(path[:, 1], path[:, 0] * (1 - path[:, 0]), atol=1e-9)
    np.testing.assert_allclose(path[[0, -1]], parabola(time[[0, -1]]), atol=1e-15)


def test_flights_go_from_contact_to_contact():
    time = np.linspace(0, 1, 11)
    free = np.array([0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1], bool)
    path = flights(time, parabola(time), free)
    ends = np.flatnonzero(np.isnan(path[:, 0]))
    assert len(ends) == 2
    first, second = path[: ends[0]], path[ends[0] + 1 : ends[1]]
    np.testing.assert_allclose(first[[0, -1], 0], [0.1, 0.5])
    np.testing.assert_allclose(second[[0, -1], 0], [0.7, 1.0])
    assert flights(time, parabola(time), np.zeros(11, bool)).shape == (0, 2)
