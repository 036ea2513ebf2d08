"""Curves of the figures: envelopes hold every extreme, flights are parabolas, axes of time have few ticks."""

import numpy as np
import pytest

from clearance_jax.report.panels import envelope, flights, smooth

pytestmark = pytest.mark.quick


def test_an_envelope_holds_every_extreme_and_no_more():
    time = np.sort(np.random.default_rng(0).uniform(0, 1, 20_000))
    values = np.sin(2000 * time)
    middles, least, greatest = envelope(time, values, 100)
    assert len(middles) == 100
    assert np.all(np.diff(middles) > 0)
    assert (least.min(), greatest.max()) == (values.min(), values.max())
    assert np.all(greatest - least > 1.9)
    # A gap has no columns; and a slow curve is its own envelope, to its change within a column.
    gap = (time < 0.3) | (time > 0.6)
    middles, least, greatest = envelope(time[gap], time[gap], 100)
    assert len(middles) == 70 + 1  # the gap's two ends lie within columns
    np.testing.assert_allclose(middles, 0.5 * (least + greatest), atol=0.01)


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
