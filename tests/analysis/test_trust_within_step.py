"""The gradient report within its step, on worn and on spatial scenes, and the labels of the experiment."""

import numpy as np
import pytest

import clearance_jax as cj
from clearance_jax.analysis.scatter import MetricSamples, SamplingPlan, statistics
from experiments.trust.scenes import FAMILIES, Numbers
from experiments.trust.verdicts import contradiction

PROBES = 12
PLAN = SamplingPlan(("a", "b"), np.array([2.0, 0.0]), 0.02, PROBES, 0.01, 16, 1e-8, 0)


def within() -> np.ndarray:
    """The changes of PLAN within the step, between its ends and the scatter."""
    return PLAN.moves()[6:-16]


def test_the_probes_of_every_parameter_are_evenly_spaced_within_the_step():
    probes = within()
    assert probes.shape == (PROBES, 2)
    for column, step in zip(probes.T, (0.04, 0.02), strict=True):
        ordered = np.sort(column)
        np.testing.assert_allclose(np.diff(ordered), 2 * step / PROBES)
        np.testing.assert_allclose(ordered, -ordered[::-1])
        np.testing.assert_allclose(ordered[-1], step * (1 - 1 / PROBES))
    # All parameters change together, but not along one line.
    assert abs(np.corrcoef(probes.T)[0, 1]) < 0.9


@pytest.mark.parametrize("height", [0.0, 0.3])
def test_one_probe_in_an_island_is_the_departure(height):
    gradient, moves = np.array([3.0, -1.0]), PLAN.moves()
    draws = moves[-16:]
    changes = within() @ gradient
    changes[4] += height
    step = PLAN.step * PLAN.unit * gradient
    seen = MetricSamples(
        np.float64(7.0), gradient, gradient, step, -step, within(), changes, draws, 7 + draws @ gradient,
        np.tile(gradient, (16, 1)), True, None,
    )  # fmt: skip
    found = statistics(PLAN, seen)
    np.testing.assert_allclose(found.departure, height / (0.04 * 3.0 + 0.02 * 1.0), atol=1e-12)
    np.testing.assert_allclose(found.departed, height, atol=1e-12)
    np.testing.assert_allclose(found.linearity, 0.0, atol=1e-12)


def test_labels():
    moves = np.linspace(-0.02, 0.02, 101)
    assert contradiction(2.0, moves, 5 + 2.1 * moves).good
    assert contradiction(2.0, moves, 5 + 2.7 * moves).good is None
    assert contradiction(2.0, moves, 5 + 4.0 * moves).good is False
    # A jump at one end, and an island of one point that turns nothing but departs.
    assert contradiction(2.0, moves, 5 + 2.0 * moves + np.where(moves > 0.015, 1.0, 0.0)).good is False
    island = contradiction(2.0, moves, 5 + 2.0 * moves + np.where(np.arange(101) == 60, 0.04, 0.0))
    np.testing.assert_allclose(island.departure, 1.0)
    assert island.off < 0.1
    assert island.good is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("family", "calm", "wild", "ends"),
    [
        ("worn", Numbers(5e-4, 5e-4, 20, 100, 9.81, 1.0, 2.0), 0.02, (0.02, 0.3)),
        ("sleeve", Numbers(5e-4, 5e-4, 20, 100, 9.81, 1.0, 0.03), 0.05, (0.02, 0.2)),
    ],
)
def test_worn_and_spatial_scenes(family, calm, wild, ends):
    known = FAMILIES[family]
    metric, name = known.asked[-1]

    def report(numbers, end):
        made = known.scene(numbers), known.metrics[metric], [name], end
        return cj.gradient_report(*made, on_untrusted="ignore")

    good = report(calm, ends[0])
    assert good.trusted
    assert good.impacts[0] >= 1
    # Against a difference of two values, which knows nothing of derivatives.
    change = 1e-3 * calm.extra
    low, high = (calm._replace(extra=calm.extra + s * change) for s in (-1, 1))
    values = [float(known.metrics[metric](cj.simulate(known.scene(n), ends[0], rtol=1e-10))) for n in (low, high)]
    np.testing.assert_allclose(good.gradient[0], (values[1] - values[0]) / (2 * change), rtol=2e-3)
    bad = report(calm._replace(damping=wild), ends[1])
    assert not bad.trusted
    assert bad.horizon < ends[1]
