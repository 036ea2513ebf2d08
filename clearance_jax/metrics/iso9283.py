"""Performance figures of manipulating robots as ISO 9283:1998 defines them, of poses and paths that were attained.

`attained` are samples: cycles of a motion, starts, or robots as they were made. Positions have shape (cycles, 3), or
(cycles, 2) in the plane; paths have a row for each place along them, (cycles, places, 3). All in metres, angles in rad.
Angles are those of three axes (or of one, in the plane), shape (cycles, 3): small deviations, or all about one value,
for the norm takes their mean.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax.errors import ClearanceError

Scalar = Float[Array, ""]
Axes = Float[Array, " axes"]


class Accuracy(NamedTuple):
    """How far the mean is from what was commanded: the distance `total`, and the difference by axes (`by_axis`, with
    its sign); of angles there is the difference only.
    """

    total: Scalar
    by_axis: Axes


def pose_accuracy(attained: Any, commanded: Any) -> Accuracy:
    """The pose accuracy AP of positions: from the commanded position to the barycentre of those attained:

        AP_P = |mean(x_j) - x_c|,   AP_x = mean(x_j) - x_c,

    in the unit of the positions. For angles `by_axis` is what the norm calls AP_a, AP_b, AP_c.

    **Arguments:** `attained`: positions, shape (cycles, axes); `commanded`: the position, shape (axes,).
    """
    cloud = _cloud(attained, least=1)
    off = jnp.mean(cloud, axis=0) - jnp.asarray(commanded, float)
    return Accuracy(jnp.linalg.norm(off), off)


def pose_repeatability(attained: Any) -> Scalar:
    """The pose repeatability RP_l of positions: the radius of a sphere about their barycentre:

        RP_l = mean(l_j) + 3 S_l,   l_j = |x_j - mean(x)|,   S_l^2 = sum (l_j - mean(l))^2 / (n - 1),

    in the unit of the positions.

    **Arguments:** `attained`: positions, shape (cycles, axes).
    """
    return _repeatability(_cloud(attained))


def orientation_repeatability(angles: Any) -> Axes:
    """The repeatability of orientation about each axis, RP_a = 3 S_a with S_a^2 = sum (a_j - mean(a))^2 / (n - 1); the
    norm writes it with both signs.

    **Arguments:** `angles`: shape (cycles, axes), in any unit.
    """
    return 3 * jnp.std(_cloud(angles), axis=0, ddof=1)


def path_accuracy(attained: Any, commanded: Any) -> Scalar:
    """The path accuracy AT_p: the largest distance of the mean path from the commanded one over all places i:

        AT_p = max_i |mean_j(x_ij) - x_ci|.

    Here x_ij is where the path j goes through the plane across the commanded path at its place i: `crossings` finds
    these points.

    **Arguments:** `attained`: paths, shape (cycles, samples, axes); `commanded`: the path, shape (places, axes).
    """
    off = jnp.mean(crossings(attained, commanded), axis=0) - jnp.asarray(commanded, float)
    return jnp.max(jnp.linalg.norm(off, axis=-1))


def path_repeatability(attained: Any, commanded: Any) -> Scalar:
    """The path repeatability RT_p: the largest over all places of the repeatability of the points where the paths go
    through the plane across the commanded path (see `path_accuracy`):

        RT_p = max_i (mean_j(l_ij) + 3 S_li),   l_ij = |x_ij - mean_j(x_ij)|.

    **Arguments:** `attained`: paths, shape (cycles, samples, axes); `commanded`: the path, shape (places, axes).
    """
    points = crossings(attained, commanded)
    _cloud(points[:, 0])
    return jnp.max(jnp.stack([_repeatability(points[:, i]) for i in range(points.shape[1])]))


def crossings(attained: Any, commanded: Any) -> Float[Array, "cycles places axes"]:
    """Where attained paths (cycles, samples, axes) go through the planes across a commanded path (places, axes) at its
    places, of several crossings the one next to the place. Straight lines join the samples of each path, of which there
    may be more than places. If a path ends before a plane, its end counts, as it is.

    **Raises:** `ClearanceError` for fewer than two places, and two equal ones that follow each other.
    """
    paths, command = jnp.asarray(attained, float), jnp.asarray(commanded, float)
    if paths.ndim != 3 or command.ndim != 2 or paths.shape[-1] != command.shape[-1] or paths.shape[1] < 2:
        raise ClearanceError(
            "Attained paths have shape (cycles, samples, axes), a commanded path (places, axes), with the same axes "
            f"and at least two of each, but their shapes are {paths.shape} and {command.shape}."
        ).about("commanded", command.shape)
    if len(command) < 2 or not bool(jnp.all(jnp.any(jnp.diff(command, axis=0) != 0, axis=1))):
        raise ClearanceError("A commanded path has at least two places, and no two equal ones that follow each other.")
    # Along the path by the places on both sides; at its ends by the one there is.
    along = jnp.concatenate([command[1:2] - command[:1], command[2:] - command[:-2], command[-1:] - command[-2:-1]])
    if not bool(jnp.all(jnp.any(along != 0, axis=1))):
        raise ClearanceError("A commanded path must not turn straight back: take its parts one by one.")
    along = along / jnp.linalg.norm(along, axis=1, keepdims=True)
    # Distance of each sample from each plane: (cycles, places, samples).
    off = jnp.einsum("jsa,ia->jis", paths, along) - jnp.sum(command * along, axis=1)[None, :, None]
    before, after = off[..., :-1], off[..., 1:]
    share = jnp.where(before == after, 0.0, before / jnp.where(before == after, 1.0, before - after))
    crosses = (before <= 0) & (after >= 0) | (before >= 0) & (after <= 0)
    share = jnp.clip(share, 0.0, 1.0)[..., None]
    points = paths[:, None, :-1] + share * (paths[:, None, 1:] - paths[:, None, :-1])
    apart = jnp.sum((points - command[None, :, None]) ** 2, axis=-1)
    # Where no part of a path crosses the plane, its nearest end stands for it.
    some = jnp.any(crosses, -1, keepdims=True)
    best = jnp.argmin(jnp.where(crosses, apart, jnp.where(some, jnp.inf, apart)), axis=-1)
    return jnp.take_along_axis(points, best[..., None, None], axis=2)[:, :, 0]


def _cloud(attained, least: int = 2) -> Float[Array, "cycles axes"]:
    """Poses as an array. **Raises** `ClearanceError` for another shape, and too few cycles."""
    cloud = jnp.asarray(attained, float)
    if cloud.ndim != 2 or len(cloud) < least:
        raise ClearanceError(
            f"Attained poses have shape (cycles, axes), of at least {least} cycles, but their shape is {cloud.shape}."
        ).about("attained", cloud.shape)
    return cloud


def _repeatability(cloud: Float[Array, "cycles axes"]) -> Scalar:
    distances = jnp.linalg.norm(cloud - jnp.mean(cloud, axis=0, keepdims=True), axis=1)
    return jnp.mean(distances) + 3 * jnp.std(distances, ddof=1)
