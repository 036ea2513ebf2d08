"""A design search on a cheap model of the motion, corrected and judged by the expensive ("dear") one.

Model management (Alexandrov, Lewis, Gumbert, Green and Newman 2001): at the last design the limits of the cheap model
are corrected to the values and slopes of the dear model. The best design of the corrected limits in a trust region is
the next one. It is accepted if it is better by the dear limits; the region grows and shrinks as the models agree. So
the end of the iteration satisfies the conditions of optimality of the dear model. From the second design on, the
differences of slopes add a curvature (Eldred, Giunta and Collis 2004), by the symmetric rank-one update.

All numbers are logarithms, so that corrections are ratios. Limits of the two models correspond by `Program.leaders`.
"""

from contextlib import suppress
from typing import NamedTuple

import numpy as np
import scipy.optimize

from clearance_jax.design.search import scaling
from clearance_jax.design.search.methods import Method, slsqp
from clearance_jax.design.search.program import Program
from clearance_jax.design.search.scaling import ScaledProgram

# The first trust region in logarithms, and the one below which the models do not agree at all.
RADIUS, LEAST_RADIUS = 0.7, 1e-7
# Agreement below which the region shrinks, and above which it grows.
POOR, GOOD = 0.25, 0.75
# The residual of the conditions of optimality that ends the search.
OPTIMAL = 1e-6
# Failed steps in a row after which slopes count as useless.
PATIENCE = 4
# The price of a violation, over the change of the objective that avoids it.
PRICE = 10.0
STEPS = 100
# The step below which the search ends.
LEAST_STEP = 1e-7
# A step that is near to the optimum, and the difference for curvatures there, in logarithms.
NEAR = 0.05
# By values alone: designs to try, how far below its bound the deciding limit may stay, accuracy of the objective.
TRIED, SLACK, ENOUGH = 8, 0.05, 1e-5
# The change of all variables by which slopes are tried: with slopes that say something, limits change by little more.
ASIDE = 1e-5


class ModelPoint(NamedTuple):
    """A point `z` (n,) by one model: objective, limits (m,), and their slopes (n,), (m, n); all in logarithms."""

    z: np.ndarray
    objective: float
    limits: np.ndarray
    gradient: np.ndarray
    jacobian: np.ndarray

    def merit(self, price: float) -> float:
        """The objective plus `price` times the largest violation."""
        return self.objective + price * max(float(self.limits.max(initial=0.0)), 0.0)


class Corrected(NamedTuple):
    """The cheap model with corrections of its limits about `z` (n,): `shift` (m,), `tilt` (m, n), `bend` (m, n, n).
    Near the optimum the cheap limits are replaced by a `series` about z (values, slopes, curvatures), as the residual
    of the iterations for poses would stop a search before the optimum.
    """

    cheap: ScaledProgram
    leaders: np.ndarray
    z: np.ndarray
    shift: np.ndarray
    tilt: np.ndarray
    bend: np.ndarray
    series: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def at(self, z: np.ndarray) -> ModelPoint:
        """The point at `z` (n,) by the corrected model."""
        seen, d = _cheap_point(self.cheap, z, self.leaders), z - self.z
        if self.series is not None:
            limits, jacobian, curvature = self.series
            turned = curvature @ d
            seen = seen._replace(limits=limits + jacobian @ d + 0.5 * turned @ d, jacobian=jacobian + turned)
        curved = self.bend @ d
        limits = seen.limits + self.shift + self.tilt @ d + 0.5 * curved @ d
        return seen._replace(limits=limits, jacobian=seen.jacobian + self.tilt + curved)

    def best(self, radius: float, price: float, margin: float, accuracy: float = 1e-13) -> ModelPoint:
        """The best point in a trust region, to an `accuracy` of the objective; a violation has a `price`."""
        low, high = np.maximum(self.cheap.bounds[0], self.z - radius), np.minimum(self.cheap.bounds[1], self.z + radius)
        first = self.at(np.clip(self.z, low, high))

        def at(v):
            return self.at(np.clip(v[:-1], low, high))

        def objective(v):
            seen = at(v)
            return seen.objective + price * v[-1], np.append(seen.gradient, price)

        def slack_slopes(v):
            jacobian = at(v).jacobian
            return np.column_stack([-jacobian, np.ones(len(jacobian))])

        solution = scipy.optimize.minimize(
            objective,
            np.append(first.z, max(float(first.limits.max()) + margin, 0.0)),
            jac=True,
            method="SLSQP",
            bounds=scipy.optimize.Bounds(np.append(low, 0.0), np.append(high, np.inf)),
            constraints=[{"type": "ineq", "fun": lambda v: v[-1] - margin - at(v).limits, "jac": slack_slopes}],
            options={"ftol": accuracy, "maxiter": STEPS},
        )
        return at(solution.x)


def model_management(program: Program, start: np.ndarray, tolerance: float = 1e-7) -> str:
    """Search by values and slopes; `tolerance` of the objective: the accuracy of the dear solves. **Raises**
    `UselessSlopes` if the slopes of the dear model are useless.
    """
    cheap, x = _begin(program, start, tolerance)
    _try_aside(program, np.exp(cheap.start), tolerance)
    dear = ScaledProgram(program, x)
    here, radius, bend, failed, step = _dear_point(program, dear, dear.start), RADIUS, 0.0, 0, np.inf
    while radius > LEAST_RADIUS:
        at = program.at(np.exp(here.z), True)
        if at.feasible and scaling.optimality(program, at)[0] <= OPTIMAL:
            return ""
        model, deciding = _matched(program, cheap, here, bend, near=step < NEAR), here.jacobian[np.argmax(here.limits)]
        # A penalty is exact above the multiplier of the limit, which is about the ratio of the two slopes.
        price = PRICE * (1 + float(np.linalg.norm(here.gradient)) / max(float(np.linalg.norm(deciding)), 1e-2))
        aim = model.best(radius, price, 0.1 * tolerance)
        promised = here.merit(price) - aim.merit(price)
        step = float(np.abs(aim.z - here.z).max())
        if step <= LEAST_STEP:
            return ""
        there = _dear_point(program, dear, aim.z)
        bend = _bent(bend, model, here, there)
        ratio = (here.merit(price) - there.merit(price)) / promised
        failed = 0 if ratio > 0 or promised <= tolerance else failed + 1
        if failed >= PATIENCE:
            raise scaling.UselessSlopes(f"{failed} steps in a row gained nothing of what the slopes promised")
        if ratio < POOR and promised > tolerance:
            radius = 0.5 * min(radius, step)
        elif ratio > GOOD and step > 0.99 * radius:
            radius *= 2
        here = there if ratio > 0 or promised <= tolerance else here
    return "stopped: the models do not agree on any step, however small"


def value_matching(program: Program, start: np.ndarray, tolerance: float = 1e-7) -> str:
    """Search by values alone. The cheap limits are shifted by the median of the differences that were seen (each is
    partly luck where motions are chaotic), to meet the bounds in the middle of what is allowed.
    """
    cheap, x = _begin(program, start, tolerance)
    dear = ScaledProgram(program, x, gradient=False)
    z = dear.start
    differences: list[np.ndarray] = []
    for _ in range(TRIED):
        point = program.at(np.exp(z))
        if not np.isfinite(point.worst):  # a motion that does not reach its end says nothing but that
            z = np.maximum(z - RADIUS, cheap.bounds[0])
            continue
        limits = dear.values_of(point)[1]
        differences.append(limits - _cheap_point(cheap, z, program.leaders).limits)
        if -SLACK < limits.max() <= 0 or (limits.max() <= 0 and np.allclose(z, cheap.bounds[1])):
            return ""
        shift = np.median(differences, axis=0) + 0.5 * SLACK
        flat = np.zeros((len(shift), len(z), len(z)))
        aim = Corrected(cheap, program.leaders, z, shift, flat[..., 0], flat).best(np.inf, PRICE, 0.0, ENOUGH)
        if np.abs(aim.z - z).max() < tolerance:
            return "" if limits.max() <= 0 else "stopped: the smallest values of the variables do not hold every limit"
        z = aim.z
    return "" if program.best is not None else f"stopped: no design of {TRIED} that were tried holds every limit"


MATCHED = Method("model management", model_management)
MATCHED_VALUES = Method("model management by values", value_matching, gradients=False, slack=SLACK)


def _begin(program: Program, start: np.ndarray, tolerance: float) -> tuple[ScaledProgram, np.ndarray]:
    """The cheap model in logarithms, and its optimum (n,), at which the search of the dear one starts."""
    cheap = program.cheap
    assert cheap is not None
    begin = cheap.at(start, True)
    if not np.isfinite(begin.worst):
        begin = scaling.feasible_neighbour(cheap, start, True) or begin
    with suppress(scaling.StandsStill):
        slsqp(cheap, begin.x, tolerance)
    best = scaling.nearly_best(cheap)
    assert best is not None
    return ScaledProgram(cheap, best.x), best.x


def _try_aside(program: Program, x: np.ndarray, tolerance: float) -> None:
    """Raise `UselessSlopes` if a design hardly beside `x` (n,) has other limits, by more than the `tolerance` of the
    solves. Two values without slopes show it, and their program is compiled in less than half the time.
    """
    side = np.where(x * (1 + ASIDE) <= program.upper, 1.0, -1.0)
    here, aside = program.at(x), program.at(x * (1 + side * ASIDE))
    if not (np.isfinite(here.worst) and np.isfinite(aside.worst)):  # no motion, or no limit
        return
    k = int(np.argmax(here.limits))
    change = abs(aside.limits[k] - here.limits[k]) / (1 + abs(here.limits[k]))
    if here.limits[k] > scaling.NEAR - 1 and change > scaling.STEEPEST * ASIDE + tolerance:
        raise scaling.UselessSlopes(
            f"slopes are useless here: {program.limit_names[k]} changes by {change:.1%} of itself where the variables "
            f"change by {ASIDE:.3%}. Neighbouring motions move apart (chaos, ringing)"
        )


def _cheap_point(scaled: ScaledProgram, z: np.ndarray, leaders: np.ndarray) -> ModelPoint:
    objective, limits, gradient, jacobian = scaled.slopes_of(scaled.program.at(np.exp(z), True))
    return ModelPoint(z, objective, limits[leaders], gradient, jacobian[leaders])


def _dear_point(program: Program, dear: ScaledProgram, z: np.ndarray) -> ModelPoint:
    return ModelPoint(z, *dear.slopes_of(scaling.followed(program, program.at(np.exp(z), True))))


def _matched(program: Program, cheap: ScaledProgram, here: ModelPoint, bend, near: bool) -> Corrected:
    """The cheap model corrected to the values and slopes of the dear one at a point."""
    seen, n = _cheap_point(cheap, here.z, program.leaders), len(here.z)
    bend = np.broadcast_to(bend, (len(seen.limits), n, n))
    series = _series(cheap, seen, program.leaders) if near else None
    shift, tilt = here.limits - seen.limits, here.jacobian - seen.jacobian
    return Corrected(cheap, program.leaders, here.z, shift, tilt, bend, series)


def _series(cheap: ScaledProgram, seen: ModelPoint, leaders: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values (m,), slopes (m, n) and curvatures (m, n, n) of the cheap limits at a point, by differences of slopes."""
    high, rows = cheap.bounds[1], []
    for i in range(len(seen.z)):
        h = NEAR if seen.z[i] + NEAR <= high[i] else -NEAR
        moved = _cheap_point(cheap, seen.z + h * np.eye(len(seen.z))[i], leaders)
        rows.append((moved.jacobian - seen.jacobian) / h)
    curvature = np.stack(rows, axis=1)
    return seen.limits, seen.jacobian, 0.5 * (curvature + curvature.swapaxes(1, 2))


def _bent(bend, model: Corrected, here: ModelPoint, there: ModelPoint) -> np.ndarray:
    """The curvature (m, n, n) of the difference of the models after a step, by a rank-one update for each limit."""
    seen = _cheap_point(model.cheap, there.z, model.leaders)
    d = there.z - here.z
    missed = there.jacobian - seen.jacobian - model.tilt - model.bend @ d
    along = missed @ d
    # Updates that would divide by nearly zero are left out.
    sound = np.abs(along) > 1e-8 * np.linalg.norm(d) * np.linalg.norm(missed, axis=1)
    update = missed[:, :, None] * missed[:, None, :] / np.where(sound, along, 1.0)[:, None, None]
    return model.bend + np.where(sound[:, None, None], update, 0.0)
