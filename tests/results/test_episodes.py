"""Contact episodes from step ends: when a penetration passes zero inside a step, and how fast."""

import numpy as np
import pytest

from clearance_jax.results.episodes import StepEnds, spans, table

pytestmark = pytest.mark.quick


def ends(time, penetration, rate):
    nothing = np.zeros_like(time)
    return StepEnds(time, penetration, rate, nothing, nothing, nothing, nothing)


def test_episodes_begin_and_end_where_the_penetration_passes_zero():
    """Of a cubic exactly, however late the steps end: as (t - 1) (3 - t) (t + 2), or the other way round."""
    time = np.array([0.0, 0.5, 1.2, 2.0, 2.9, 3.3, 4.0])
    product = np.polynomial.Polynomial.fromroots([1.0, 3.0, -2.0]) * -1.0
    seen = ends(time, product(time), product.deriv()(time))
    found = table(seen, spans(time, seen.penetration))
    assert found["episode_start"] == pytest.approx([1.0], abs=1e-15)
    assert found["episode_end"] == pytest.approx([3.0], abs=1e-14)
    assert found["impact_speed"] == pytest.approx([product.deriv()(1.0)], rel=1e-14)
    assert found["separation_speed"] == pytest.approx([-product.deriv()(3.0)], rel=1e-13)


def test_what_is_no_passage_stays_at_the_step_end():
    """A contact from the start, one that goes on, a touch at a step end, and one that only grazes."""
    time = np.arange(5.0)
    seen = ends(time, np.array([1e-6, -1e-6, -1e-6, 1e-6, 2e-6]), np.array([-1e-6, -1e-6, 1e-6, 2e-6, 1e-6]))
    found = table(seen, spans(time, seen.penetration))
    assert found["episode_start"][0] == 0.0
    assert np.isnan(found["impact_speed"][0])
    assert 0.0 < found["episode_end"][0] < 1.0
    assert 2.0 < found["episode_start"][1] < 3.0
    assert np.isnan(found["episode_end"][1])
    touched = ends(time[:3], np.array([-1e-6, 0.0, 1e-6]), np.full(3, 1e-6))
    assert table(touched, spans(time[:3], touched.penetration))["episode_start"] == pytest.approx([2.0])


def test_over_a_step_of_femtoseconds_the_rates_tell_the_speed():
    """Places of a joint far from the origin are known to 1e-17 m, which such a step at 12 mm/s does not move by."""
    time = np.array([0.0, 1e-3, 2e-3, 2e-3 + 2.4e-15, 2.1e-3])
    penetration = np.array([-2.2e-5, -1.2e-5, -2.8e-17, 1.3e-17, 9e-7])
    rate = np.array([0.0, 0.011, 0.01233408, 0.01233408, 0.009])
    found = table(ends(time, penetration, rate), spans(time, penetration))
    assert found["impact_speed"] == pytest.approx([0.01233408], rel=1e-12)
