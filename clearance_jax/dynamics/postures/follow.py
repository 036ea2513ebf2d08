"""Drives that lead a point of the ideal mechanism along a path.

At the knots the joints' values and first two rates are exact. Between knots are quintics, whose error falls with the
sixth power of the knots' distance; knots are added where the point leaves the path by more than the tolerance. One
program follows a fixed number of intervals of any path, and is called block by block.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax.dynamics.postures.chain import Aim, Chain, PreparedChain, chain_of, look_at
from clearance_jax.dynamics.postures.inverse import (
    Posture,
    begin_of,
    best,
    is_met,
    off,
    posture_of,
    shown_length,
    why_unreached,
)
from clearance_jax.dynamics.postures.posture import PostureSolution, aim_at, change, find, rates, sought_values
from clearance_jax.errors import ClearanceError, wrong_value
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.motion.drives import Quintic
from clearance_jax.mechanism.motion.paths import CartesianPath, PreparedPath
from clearance_jax.mechanism.motion.pieces import HERMITE

# Intervals that one call of the program follows; intervals of every smooth part of a path at first.
BLOCK, FIRST = 32, 4
# Places between two knots at which the point is compared with the path; a quintic's error is largest in the middle.
INSIDE = np.array([0.15, 0.35, 0.5, 0.65, 0.85])
# How often the joints at a knot are corrected in the directions that the path leaves free (redundant joints). The first
# guess errs by the third power of the distance of the knots, the last by the fifth.
CORRECTIONS = 3
# An interval of less than this part of the path is a place where no posture follows; knots at most, and passes.
SHORTEST, MOST_KNOTS, PASSES = 1e-6, 20_000, 30
# Second rates that differ by less than this part of the largest are equal.
JUMP = 1e-9


class PathDrives(dict[str, Quintic]):
    """The `drives` that move a point along a path, by the names of their coordinates, as `mechanism.driven` takes them.

    - `deviation` [m], `angle` [rad]: the largest distance of the point from the path, and the largest angle of its
      orientation from that of the path, as measured between the knots.
    - `start`: the posture at which the path begins.
    """

    def __init__(self, drives: Mapping[str, Quintic], deviation: float, angle: float, start: Posture):
        super().__init__(drives)
        self.deviation, self.angle, self.start = deviation, angle, start


class PathBlock(NamedTuple):
    """By interval: the solution at its end, and the sought values at both ends with the rates inside the interval; by
    place inside, how far the point is from the path [m], and by what angle [rad].
    """

    solution: PostureSolution
    values: Float[Array, "intervals 2 sought"]
    speeds: Float[Array, "intervals 2 sought"]
    accelerations: Float[Array, "intervals 2 sought"]
    deviation: Float[Array, "intervals inside"]
    angle: Float[Array, "intervals inside"]


@eqx.filter_jit
def follow_edges(given: Chain, path: PreparedPath, edges: Float[Array, " edges"], start: Array) -> PathBlock:
    """Follow a path from edge to edge, from a posture at the first edge."""
    chain = given.prepare()

    def interval(q, ends):
        begin, end = ends
        beside, h = (begin + end) / 2, end - begin
        none = jnp.zeros(len(chain.sought))

        def once(k, carry):
            # First the rates where the interval begins, then at its end, from a guess that its rates make better.
            solution, left, right = carry
            first = k == 0
            time = jnp.where(first, begin, end)
            trapezoid = h / 2 * (left[0] + right[0]) + h**2 / 12 * (left[1] - right[1])
            taylor = h * left[0] + h**2 / 2 * left[1]
            step = jnp.clip(jnp.where(k == 1, taylor, trapezoid), -chain.units, chain.units)
            guess = change(chain, q, jnp.where(first, 0.0, step))
            solution = find(chain, aim_at(path, time, beside), time, guess)
            now = rates(chain, path, time, beside, solution.q)
            left = jax.tree.map(lambda a, b: jnp.where(first, a, b), now, left)
            return solution, left, now

        rows = jax.eval_shape(lambda q: find(chain, aim_at(path, begin, beside), begin, q), q)
        empty = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), rows)
        solution, left, right = jax.lax.fori_loop(0, 1 + CORRECTIONS, once, (empty, (none, none), (none, none)))
        pairs = [jnp.stack([a, b]) for a, b in zip(left, right, strict=True)]
        values = jnp.stack([sought_values(chain, q), sought_values(chain, solution.q)])
        return solution.q, (solution, values, *pairs, q)

    _, (solution, values, speeds, accelerations, before) = jax.lax.scan(interval, start, (edges[:-1], edges[1:]))

    driven = [chain.coordinates[i].name in chain.joints for i in chain.sought]
    passive = tuple(i for i, joint in zip(chain.sought, driven, strict=True) if not joint)
    followers = PreparedChain(chain.mechanism, chain.point, chain.joints, passive)

    def inside(begin, end, q, values, speeds, accelerations, part):
        time, h = begin + part * (end - begin), end - begin
        # The quintic between the knots.
        v, a = h * speeds, h**2 * accelerations
        higher = jnp.stack([v[0], a[0], v[1], a[1], values[1] - values[0]], axis=-1) @ HERMITE.T
        powers = jnp.concatenate([jnp.stack([values[0], v[0], a[0] / 2], axis=-1), higher], axis=-1)
        at = powers @ part ** jnp.arange(6)
        # The joints' motion is known; passive coordinates of loops follow.
        q = change(chain, q, jnp.where(np.array(driven), at - values[0], 0.0))
        aim = aim_at(path, time, time)
        if chain.mechanism.closures():
            q = find(followers, None, time, q).q
        return off(chain, aim, look_at(chain, aim, time, q).gap)

    args = edges[:-1], edges[1:], before, values, speeds, accelerations
    apart = jax.lax.map(lambda knots: jax.vmap(partial(inside, *knots))(jnp.asarray(INSIDE)), args)
    return PathBlock(solution, values, speeds, accelerations, *apart)


def follow(
    mechanism: Mechanism,
    point: str,
    path: CartesianPath,
    *,
    joints: Sequence[str] | None = None,
    tolerance: float = 1e-6,
    start: Mapping[str, Any] | Posture | None = None,
) -> PathDrives:
    """Drives of the joints that move a point of the ideal mechanism along a path. Give them to `mechanism.driven`.

    If there are more joints than needed, their rates are the smallest possible ones (those of slides divided by the
    size of the chain). The numbers of the drives are numbers of the mechanism, but no derivative goes through them to
    the path.

    **Arguments:**

    - `mechanism`: what moves.
    - `point`: the name of a `cj.Point`; if the path has orientations, its frame follows them.
    - `path`: a `cj.paths.CartesianPath`.
    - `joints`: as for `inverse_kinematics`. Other coordinates move as their drives say, or stay where they are.
    - `tolerance` [m]: largest distance of the point from the path between knots; for angles the tolerance divided by
      the size of the chain [rad].
    - `start`: values of coordinates, by name, or a posture, near which the path begins.

    **Raises:** `ClearanceError` if the path begins out of reach or leaves it, if a limit of a coordinate (value or
    rate, `cj.Limits`) is in the way, and if the path passes a singular posture. The message says which, when, and how
    far off.
    """
    chain, ready = chain_of(mechanism, point, joints), path.prepare()
    if chain.mechanism.is_plane and not _is_plane(ready):
        raise ClearanceError("The mechanism is in the plane: a path of it must have no z, and turns about z only.")
    if not tolerance > 0:
        raise wrong_value("`tolerance`", "a length greater than zero", tolerance, shown=repr(tolerance))
    edges = _edges(np.asarray(ready.breaks()))
    first = jnp.asarray(edges[0])
    aim = aim_at(ready, first, jnp.asarray(edges[:2].mean()))
    begin = begin_of(mechanism, chain, start)
    solution = best(chain, aim, first, begin, start is None, tolerance / 10)
    if not is_met(chain, solution, tolerance / 10):
        raise ClearanceError(why_unreached(chain, aim, solution, ", where the path begins"))
    knots, blocks = _refine(chain, ready, edges, solution.q, tolerance)
    _check_speeds(chain, knots, blocks)
    names = [chain.coordinates[i].name for i in chain.sought]
    drives = {name: _drive(knots, blocks, k) for k, name in enumerate(names) if name in chain.joints}
    deviation, angle = float(np.max(blocks.deviation)), float(np.max(blocks.angle))
    return PathDrives(drives, deviation, angle, posture_of(chain, aim, solution))


def _edges(breaks: np.ndarray) -> np.ndarray:
    """The first knots: some in every smooth part of the path."""
    span = breaks[-1] - breaks[0]
    distinct = breaks[np.concatenate([[True], np.diff(breaks) > SHORTEST * span])]
    distinct[-1] = breaks[-1]
    parts = np.linspace(0, 1, FIRST, endpoint=False)
    return np.append((distinct[:-1, None] + np.diff(distinct)[:, None] * parts).ravel(), distinct[-1])


def _refine(chain: Chain, path: PreparedPath, edges: np.ndarray, q: Array, tolerance: float):
    """Knots that are dense enough, and the solution between them."""
    span, size = edges[-1] - edges[0], float(chain.size)
    for _ in range(PASSES):
        blocks = _run(chain, path, edges, q)
        ends = blocks.solution
        reached = np.asarray(ends.closed) & (size * np.linalg.norm(ends.gap, axis=1) < tolerance / 10)
        error = np.max(np.maximum(blocks.deviation, size * blocks.angle), axis=1)
        error = np.where(np.isfinite(error), error, np.inf)
        bad = ~(error < tolerance) | ~reached
        if not bad.any():
            return edges, blocks
        # Nothing counts beyond a place that is not reached, until it is known whether it is out of reach.
        lost = int(np.argmin(reached)) if not reached.all() else len(reached)
        bad[lost + 1 :] = False
        halvings = np.ones(len(bad), int)
        smooth = np.isfinite(error) & (error > 0) & reached
        halvings[smooth] = np.clip(np.ceil(np.log2(error[smooth] / tolerance) / 6), 1, 4)
        parts = np.where(bad, 2**halvings, 1)
        if np.any(np.diff(edges)[bad] < SHORTEST * span) or parts.sum() > MOST_KNOTS:
            raise ClearanceError(_stop_reason(chain, path, edges, blocks, int(np.argmax(bad)), lost))
        halved = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(edges, edges[1:], parts, strict=False)]
        edges = np.concatenate([*halved, edges[-1:]])
    raise ClearanceError(f"The path cannot be followed within {shown_length(tolerance)}: ask for less.")


def _run(chain: Chain, path: PreparedPath, edges: np.ndarray, q: Array) -> PathBlock:
    """Follow the whole path block by block. Intervals of no length fill the last block."""
    count, out = len(edges) - 1, []
    padded = np.append(edges, np.full(-count % BLOCK, edges[-1]))
    for k in range(0, len(padded) - 1, BLOCK):
        block = follow_edges(chain, path, jnp.asarray(padded[k : k + BLOCK + 1]), q)
        q = block.solution.q[-1]
        out.append(jax.tree.map(np.asarray, block))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *out)


def _drive(knots: np.ndarray, blocks: PathBlock, k: int) -> Quintic:
    """The drive of one coordinate."""
    values = np.append(blocks.values[:, 0, k], blocks.values[-1, 1, k])
    speeds = np.append(blocks.speeds[:, 0, k], blocks.speeds[-1, 1, k])
    after = np.append(blocks.accelerations[:, 0, k], 0.0)
    before = np.insert(blocks.accelerations[:, 1, k], 0, 0.0)
    # Outside it goes on with its speed.
    jumps = after - before
    some = np.max(np.abs(jumps)) > JUMP * max(np.max(np.abs(after)), np.max(np.abs(before)), 1e-300)
    return Quintic(knots, values, speeds, after, jumps) if some else Quintic(knots, values, speeds, after)


def _is_plane(path: PreparedPath) -> bool:
    """Whether a path stays in the plane z = 0."""
    s = path.stretches
    flat = np.concatenate([np.ravel(x) for x in (s.place[..., 2], s.arm[..., 2], s.turn[..., :2])])
    swung = np.where(np.any(np.asarray(s.arm) != 0, axis=1)[:, None], np.asarray(s.axis)[:, :2], 0.0)
    return bool(np.all(flat == 0) and np.all(swung == 0) and np.all(np.asarray(s.quaternion)[..., 1:3] == 0))


# In words -------------------------------------------------------------------------------------------------------------


def _when(edges: np.ndarray, time: float) -> str:
    part = (time - edges[0]) / (edges[-1] - edges[0])
    return f" at {time:.6g} s ({100 * part:.1f} % of the path's time)"


def _stop_reason(chain: Chain, path: PreparedPath, edges, blocks: PathBlock, bad: int, lost: int) -> str:
    """Why a path cannot be followed beyond an interval, in words."""
    if bad == lost:
        solution = jax.tree.map(lambda leaf: jnp.asarray(leaf[bad]), blocks.solution)
        time = float(edges[bad + 1])
        aim = aim_at(path, jnp.asarray(time), jnp.asarray(edges[bad : bad + 2].mean()))
        reason = why_unreached(chain, aim, solution, _when(edges, time))
        # Knots behind are as near as the chain comes.
        gaps = [off(chain, Aim(aim.place, aim.rotation), jnp.asarray(gap)) for gap in blocks.solution.gap]
        most = max(float(distance) for distance, _ in gaps)
        return f"The path leaves the reach. {reason} Further on it is up to {shown_length(most)} off."
    name, speed, unit = _fastest(chain, blocks, slice(bad, bad + 1))
    return (
        f"The path passes a singular posture{_when(edges, float(edges[bad]))}: there `{name}` would have to move at "
        f"{speed:.3g} {unit} and more. Lead the path around it, or begin from another `start`."
    )


def _fastest(chain: Chain, blocks: PathBlock, where: slice) -> tuple[str, float, str]:
    """The coordinate that is fastest in some intervals, its speed and unit."""
    speeds = np.max(np.abs(np.nan_to_num(blocks.speeds[where])), axis=(0, 1)) / np.asarray(chain.units)
    k = int(np.argmax(speeds))
    coordinate = chain.coordinates[chain.sought[k]]
    unit = "rad/s" if coordinate.slides is None else "m/s"
    return coordinate.name, float(speeds[k] * np.asarray(chain.units)[k]), unit


def _check_speeds(chain: Chain, knots: np.ndarray, blocks: PathBlock) -> None:
    """Raise for a joint that must be faster than its limit."""
    for k, limits in enumerate(chain.limits):
        speeds = np.max(np.abs(blocks.speeds[:, :, k]), axis=1)
        if limits.velocity is None or np.max(speeds) <= limits.velocity * (1 + 1e-9):
            continue
        first, most = int(np.argmax(speeds > limits.velocity)), int(np.argmax(speeds))
        coordinate = chain.coordinates[chain.sought[k]]
        unit = "rad/s" if coordinate.slides is None else "m/s"
        raise ClearanceError(
            f"`{coordinate.name}` would have to move at {speeds[most]:.4g} {unit}{_when(knots, float(knots[most]))}, "
            f"but its limit is {limits.velocity:.4g} {unit}, which it passes at {knots[first]:.6g} s. Give the path "
            "more time, or lead it further from singular postures."
        ).about(coordinate.name, float(speeds[most]), float(limits.velocity))
