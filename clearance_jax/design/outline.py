"""A mechanism at one instant, as it is drawn: bodies, joints by name, springs, and the paths of its named points."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from clearance_jax.design.places import Places, grounded
from clearance_jax.mechanism.mechanism import Mechanism


class Outline(NamedTuple):
    """Places [m] at `time` [s] as they are seen, the two axes of the plane, or of a mechanism in space without the one
    that it is `seen` along (x, y or z): what each body carries (k, 2), joints and points by name (2,), springs (2, 2);
    `slides`: direction of each sliding joint; `grounded` and `loose` (with clearance) joints; `paths` of the points.
    """

    time: float
    seen: str
    bodies: Mapping[str, np.ndarray]
    joints: Mapping[str, np.ndarray]
    slides: Mapping[str, np.ndarray]
    points: Mapping[str, np.ndarray]
    springs: Mapping[str, np.ndarray]
    paths: Mapping[str, np.ndarray]
    grounded: frozenset[str]
    loose: frozenset[str]


def outline(mechanism: Mechanism, times: np.ndarray, places: Places) -> Outline:
    """At the instant at which the mechanism is stretched out least: joints in a line hide each other. Seen along the
    axis along which it is thinnest.
    """
    every = np.concatenate([*places.bodies.values(), *(p[:, None] for p in places.joints.values())], axis=1)
    axes, seen = [0, 1], ""
    if every.shape[-1] == 3:
        along = int(np.argmin(np.ptp(every, axis=(0, 1))))
        axes, seen = [k for k in range(3) if k != along], "xyz"[along]
    k = int(np.argmax(_thickness(every[..., axes])))

    def now(parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {name: where[k][..., axes] for name, where in parts.items()}

    return Outline(
        float(times[k]),
        seen,
        now(places.bodies),
        now(places.joints),
        now(places.slides),
        now(places.points),
        now(places.springs),
        {name: where[..., axes] for name, where in places.points.items()},
        grounded(mechanism),
        frozenset(joint.name for joint in mechanism.clearance_joints()),
    )


def _thickness(points: np.ndarray) -> np.ndarray:
    """Of sets of points (n, k, 2): the smaller root of mean squares about the mean along any two normal axes."""
    away = points - points.mean(axis=1, keepdims=True)
    return np.linalg.svd(away, compute_uv=False)[:, -1]
