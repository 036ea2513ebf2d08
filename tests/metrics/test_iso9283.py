"""Figures of ISO 9283 against their definitions, by sums that are written out, of clouds and paths made by hand."""

import math

import numpy as np
import pytest
from places import refused

from clearance_jax import metrics
from clearance_jax.errors import ClearanceError
from clearance_jax.metrics.iso9283 import crossings


def radius(cloud):
    """Mean distance from the barycentre and three standard deviations of the distances, in plain Python."""
    n, axes = len(cloud), len(cloud[0])
    centre = [sum(row[k] for row in cloud) / n for k in range(axes)]
    distances = [math.sqrt(sum((row[k] - centre[k]) ** 2 for k in range(axes))) for row in cloud]
    mean = sum(distances) / n
    return mean + 3 * math.sqrt(sum((d - mean) ** 2 for d in distances) / (n - 1))


def test_a_cloud_whose_figures_are_known_by_heart():
    """Four places on a circle of 2 mm about (1, 0, 0): every distance is 2 mm, so nothing scatters."""
    cloud = np.array([1.0, 0, 0]) + 2e-3 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    assert float(metrics.pose_repeatability(cloud)) == pytest.approx(2e-3, rel=1e-9)
    accuracy = metrics.pose_accuracy(cloud, [1.0, 3e-3, -4e-3])
    assert float(accuracy.total) == pytest.approx(5e-3, rel=1e-9)
    np.testing.assert_allclose(accuracy.by_axis, [0, -3e-3, 4e-3], atol=1e-15)
    # Distances 1, 1 and 2 from the barycentre zero: mean 4/3, deviation sqrt(1/3).
    line = np.array([[1.0, 0.0], [1.0, 0.0], [-2.0, 0.0]])
    assert float(metrics.pose_repeatability(line)) == pytest.approx(4 / 3 + 3 * math.sqrt(1 / 3), rel=1e-12)


def test_a_cloud_and_its_angles_by_sums_written_out():
    rng = np.random.default_rng(5)
    cloud, angles = rng.normal(0.3, 1e-4, (30, 3)), rng.normal(0.0, 1e-3, (30, 3))
    assert float(metrics.pose_repeatability(cloud)) == pytest.approx(radius(cloud.tolist()), rel=1e-9)
    for axis, found in enumerate(metrics.orientation_repeatability(angles)):
        column = angles[:, axis].tolist()
        mean = sum(column) / 30
        assert float(found) == pytest.approx(3 * math.sqrt(sum((a - mean) ** 2 for a in column) / 29), rel=1e-9)


def test_paths_beside_a_straight_line():
    """Paths parallel to the commanded one, sampled elsewhere and moved along it, which does not count."""
    places = np.stack([np.linspace(0, 1, 11), np.zeros(11), np.zeros(11)], axis=1)
    offsets = np.array([[0, 1e-3, 0], [0, 3e-3, 0], [0, 2e-3, 3e-3]])
    shifted = np.linspace(-0.1, 1.1, 30)
    paths = np.stack([np.stack([shifted, np.full(30, y), np.full(30, z)], axis=1) for _, y, z in offsets])
    assert float(metrics.path_accuracy(paths, places)) == pytest.approx(math.hypot(2e-3, 1e-3), rel=1e-9)
    assert float(metrics.path_repeatability(paths, places)) == pytest.approx(radius(offsets.tolist()), rel=1e-9)


def test_paths_across_a_circle_are_met_in_its_planes():
    """Circles about the commanded one's centre, with samples at other angles: their chords leave little."""
    angles = np.linspace(0, np.pi / 2, 21)
    command = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    fine, radii = np.linspace(-0.1, np.pi / 2 + 0.1, 4001), np.array([1.001, 1.002, 1.006])
    paths = radii[:, None, None] * np.stack([np.cos(fine), np.sin(fine)], axis=1)
    found = crossings(paths, command)
    inner = slice(1, -1)  # where the plane across is the radial one
    np.testing.assert_allclose(found[:, inner], radii[:, None, None] * command[None, inner], atol=1e-6)
    apart = [[r, 0.0] for r in radii]
    assert float(metrics.path_repeatability(paths, command)) == pytest.approx(radius(apart), rel=2e-3)
    assert float(metrics.path_accuracy(paths, command)) == pytest.approx(3e-3, rel=2e-2)
    # A path that ends early: its end stands for it.
    early = crossings(np.array([[[0.0, 0.0], [0.4, 0.1]]]), [[0.0, 0.0], [1.0, 0.0]])
    np.testing.assert_allclose(early[0], [[0.0, 0.0], [0.4, 0.1]], atol=1e-12)


def test_what_is_no_cloud_and_no_path_is_refused():
    with refused("attained", "(1, 3)"):
        metrics.pose_repeatability(np.zeros((1, 3)))
    with refused("attained", "(3,)"):
        metrics.pose_accuracy(np.zeros(3), np.zeros(3))
    with pytest.raises(ClearanceError, match="no two equal"):
        metrics.path_accuracy(np.zeros((3, 5, 2)), np.zeros((4, 2)))
    with refused("commanded", "(4, 3)"):
        metrics.path_repeatability(np.zeros((3, 5, 2)), np.zeros((4, 3)))
    with pytest.raises(ClearanceError, match="straight back"):
        metrics.path_accuracy(np.zeros((3, 5, 2)), np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]]))
