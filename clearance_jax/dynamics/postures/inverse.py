"""Inverse kinematics: the posture of the ideal mechanism with a point in a given pose, or why there is none."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.postures.chain import AbstractChain, Aim, Chain, chain_of, start_of
from clearance_jax.dynamics.postures.posture import PostureSolution, bounds, solve, sought_values
from clearance_jax.errors import ClearanceError, unknown_name
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.motion.segments import Pose
from clearance_jax.mechanism.state import parts
from clearance_jax.spatial import matrix

# Starts that are tried if the default one fails and the user named none.
STARTS = 32
# Below this singular value, messages call a posture singular.
SINGULAR = 1e-3


class Posture(Module):
    """Values of all coordinates with which a point has a given pose.

    - `coordinates`: values [rad or m] of the coordinates that were sought, by name. Give them to `mechanism.driven` as
      `cj.drives.Constant`, or as the `start` of another search.
    - `distance` [m], `angle` [rad]: how far the place and the orientation of the point are from the pose: round-off
      only.
    - `iterations`: of Newton's method.
    - `positions` (positions,): all positions of the mechanism with these coordinates free, those of balls too.
    """

    coordinates: dict[str, Scalar]
    distance: Scalar
    angle: Scalar
    iterations: Array
    positions: Float[Array, " positions"]


def inverse_kinematics(
    mechanism: Mechanism,
    point: str,
    pose: Pose,
    *,
    start: Mapping[str, Any] | Posture | None = None,
    joints: Sequence[str] | None = None,
    tolerance: float = 1e-9,
) -> Posture:
    """The posture of the ideal mechanism in which a point (with its `orientation`, a frame) has a given pose.

    Of all such postures, the result is the one that Newton's method finds from the start by steps of least change. The
    limits of the coordinates (`cj.Limits`) are kept. It works under jit and vmap, where nothing is raised. Derivatives
    by numbers of the mechanism and of the pose are those of the implicit function.

    **Arguments:**

    - `mechanism`: what moves.
    - `point`: the name of a `cj.Point`; `pose`: where it should be, in the ground's axes.
    - `start`: values of coordinates, by name, or another posture, from which to search; by default the mechanism's
      start, and if the search fails there, other ones.
    - `joints`: the coordinates that may move. By default these are all between the ground and the point that a drive
      may prescribe; in a mechanism with closed loops, those that have a drive. Passive coordinates of loops follow. All
      others stay at their start.
    - `tolerance` [m]: largest distance of the point from the pose; for angles the tolerance divided by the size of the
      chain [rad].

    **Raises:** `ClearanceError` for a pose that is not reached, with the reason, and for unknown names.
    """
    chain = chain_of(mechanism, point, joints)
    _check_plane(chain, pose)
    begin = begin_of(mechanism, chain, start)
    aim = Aim(pose.place, pose.orientation and matrix(pose.orientation.rotation.rows))
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((chain, aim, begin))):
        return posture_of(chain, aim, search(chain, aim, jnp.zeros(()), begin))
    solution = best(chain, aim, jnp.zeros(()), begin, start is None, tolerance)
    if not is_met(chain, solution, tolerance):
        raise ClearanceError(why_unreached(chain, aim, solution))
    return posture_of(chain, aim, solution)


def begin_of(mechanism: Mechanism, chain: Chain, start: Mapping[str, Any] | Posture | None) -> Array:
    """The positions at which a search begins."""
    begin = start_of(mechanism, chain, jnp.zeros(()))
    if isinstance(start, Posture):
        if start.positions.shape == begin.shape:
            return start.positions
        start = start.coordinates
    known = [part.coordinate.name for part in parts(chain.mechanism) if not part.coordinate.is_ball]
    for name, value in (start or {}).items():
        if name not in known:
            raise unknown_name(f"There is no coordinate `{name}` to start from.", name, known)
        begin = begin.at[chain.places([name])[0]].set(value)
    return begin


@eqx.filter_jit
def search(chain: Chain, aim: Aim, time: Scalar, start: Array) -> PostureSolution:
    """`solve` of a chain that is not prepared. Turns without limits end within half a turn of the start."""
    solution = solve(chain.prepare(), aim, time, start)
    lower, upper = bounds(chain)
    q = solution.q
    for k, i in enumerate(chain.sought):
        coordinate = chain.coordinates[i]
        if coordinate.turns is not None and math.isinf(lower[k]) and math.isinf(upper[k]):
            place = chain.places([coordinate.name])[0]
            q = q.at[place].add(-2 * jnp.pi * jnp.round((q[place] - start[place]) / (2 * jnp.pi)))
    return solution._replace(q=q)


_searches = eqx.filter_jit(lambda chain, aim, time, starts: jax.vmap(lambda q: search(chain, aim, time, q))(starts))


def best(chain: Chain, aim: Aim, time: Scalar, begin: Array, anywhere: bool, tolerance: float) -> PostureSolution:
    """The solution from a start; if that fails and the search may begin `anywhere`, the best one of many starts."""
    solution = search(chain, aim, time, begin)
    if is_met(chain, solution, tolerance) or not anywhere:
        return solution
    every = _searches(chain, aim, time, other_starts(chain, begin))
    each = [jax.tree.map(lambda leaf, k=k: leaf[k], every) for k in range(STARTS)]
    good = [posture for posture in each if is_met(chain, posture, tolerance)]
    if not good:
        return min([solution, *each], key=lambda posture: float(posture.left))
    units = np.asarray(chain.units)
    home = np.asarray(sought_values(chain, begin))
    return min(good, key=lambda posture: np.linalg.norm((np.asarray(sought_values(chain, posture.q)) - home) / units))


def other_starts(chain: Chain, begin: Array) -> Array:
    """Starts all over the limits of the joints, (starts, positions); always the same ones."""
    rng, starts = np.random.default_rng(0), np.tile(np.asarray(begin), (STARTS, 1))
    lower, upper = bounds(chain)
    for k, i in enumerate(chain.sought):
        coordinate = chain.coordinates[i]
        if coordinate.name not in chain.joints:
            continue
        place = chain.places([coordinate.name])[0]
        reach = np.pi if coordinate.slides is None else float(chain.size)
        low = lower[k] if np.isfinite(lower[k]) else (min(starts[0, place], upper[k]) - reach)
        high = upper[k] if np.isfinite(upper[k]) else (max(starts[0, place], lower[k]) + reach)
        starts[:, place] = rng.uniform(low, high, STARTS)
    return jnp.asarray(starts)


def off(chain: AbstractChain, aim: Aim, gap: Array) -> tuple[Array, Array]:
    """The distance [m] and the angle [rad] of the frame from its aim."""
    flat = chain.mechanism.is_plane
    places, turns = (2, 1) if flat else (3, 3)
    angle = gap[places : places + turns] if aim.rotation is not None else jnp.zeros(1)
    return jnp.linalg.norm(gap[:places]) * chain.size, jnp.linalg.norm(angle)


def is_met(chain: Chain, solution: PostureSolution, tolerance: float) -> bool:
    """Whether a solution is within the tolerance."""
    size = float(chain.size)
    return bool(solution.closed) and float(jnp.linalg.norm(solution.gap)) * size <= tolerance


def posture_of(chain: Chain, aim: Aim, solution: PostureSolution) -> Posture:
    """The posture at the end of a search."""
    places = zip(chain.joints, chain.places(chain.joints), strict=True)
    coordinates = {name: solution.q[place] for name, place in places}
    return Posture(coordinates, *off(chain, aim, solution.gap), solution.iterations, solution.q)


def _check_plane(chain: Chain, pose: Pose) -> None:
    """Raise for a pose out of the plane, of what moves in the plane."""
    if not chain.mechanism.is_plane or any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(pose)):
        return
    tilted = pose.orientation is not None and float(pose.orientation.rotation.rows[2][2]) < 1 - 1e-12
    if tilted or float(pose.place[2]) != 0:
        raise ClearanceError("The mechanism is in the plane: a pose of it must have no z, and no roll and pitch.")


# In words -------------------------------------------------------------------------------------------------------------


def why_unreached(chain: Chain, aim: Aim, solution: PostureSolution, when: str = "") -> str:
    """Why a point does not reach its pose, in words."""
    distance, angle = (float(x) for x in off(chain, aim, solution.gap))
    place = np.asarray(aim.place)[: 2 if chain.mechanism.is_plane else 3]
    message = f"Point `{chain.point}` cannot be brought to ({', '.join(f'{x:.6g}' for x in place)}) m{when}: "
    message += f"the closest posture found is {shown_length(distance)} off"
    message += f" and turned by {np.degrees(angle):.3g} deg. " if aim.rotation is not None else ". "
    rest = float(jnp.linalg.norm(solution.gap)) ** 2 - (distance / float(chain.size)) ** 2 - angle**2
    if chain.mechanism.closures() and (rest > 1e-12 or not bool(solution.closed)):
        message += "Its loops do not close there. "
    return message + in_the_way(chain, aim, solution)


def shown_length(length: float) -> str:
    """A length as a message shows it."""
    return f"{1e3 * length:.4g} mm"


def in_the_way(chain: Chain, aim: Aim, solution: PostureSolution) -> str:
    """What keeps a posture from coming closer, in words."""
    lower, upper = bounds(chain)
    values, limited = np.asarray(sought_values(chain, solution.q)), []
    for k, i in enumerate(chain.sought):
        limit = {"lower": lower[k], "upper": upper[k]}
        at = next((side for side, bound in limit.items() if abs(values[k] - bound) < 1e-9), None)
        if at and np.asarray(solution.at_limit)[k]:
            unit = "rad" if chain.coordinates[i].slides is None else "m"
            limited.append(f"`{chain.coordinates[i].name}` is at its {at} limit, {limit[at]:.6g} {unit}")
    if limited:
        return f"There {', '.join(limited[:4])}{' and others' if len(limited) > 4 else ''}."
    asked, count = solution.jacobian.shape
    if count < asked and not chain.mechanism.closures():
        return (
            f"A chain of {count} coordinates is asked for {asked} numbers of a pose: ask for the place only (a pose "
            "without orientation), or give it more joints."
        )
    left, sizes, _ = np.linalg.svd(np.asarray(solution.jacobian))
    # The part of the residual along which no joint moves the point.
    beyond = left[:, np.append(sizes, np.zeros(asked - len(sizes))) < SINGULAR]
    direction = beyond @ (beyond.T @ np.asarray(solution.gap))
    if np.linalg.norm(direction) < SINGULAR * float(solution.left):
        return "Give another `start`."
    along, turning = np.split(-direction, [2 if chain.mechanism.is_plane else 3])
    unit, what = along, "moves it along"
    if np.linalg.norm(along) < np.linalg.norm(turning) and aim.rotation is not None:
        unit, what = turning[:3], "turns it about"
    unit = unit / max(np.linalg.norm(unit), 1e-300) + 0.0
    shown = ", ".join(f"{x:.3f}" for x in unit)
    return f"The posture is singular, stretched or folded: no joint {what} ({shown})."
