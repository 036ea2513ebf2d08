"""Ways to solve a `Program`: gradient-based (scipy's SLSQP and trust-constr, optax) and gradient-free (COBYQA, CMA-ES).

All work in the logarithm of the variables, with the objective over its size at the start. None returns anything: the
program remembers every point, and its best feasible one is the answer, also of a run that was interrupted.
"""

import functools
import tempfile
import warnings
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import optax
import scipy.optimize

from clearance_jax.design.program import Enough, Point, Program
from clearance_jax.errors import ClearanceError, suggest

# Where an active limit is aimed at, in shares of its bound: inside, by less than anything else in the answer counts.
INSIDE = 1e-10
# Share of its bound below which a limit is as good as zero.
SMALLEST = 1e-3
# A point with no larger violation may be pulled inside; what a violation is worth, over the objective.
NEARLY, PRICE = 1e-3, 3.0
LBFGS = optax.scale_by_lbfgs(memory_size=20)


class _Scaled:
    """A program in logarithms: of its variables, of its objective where that is positive (else over its size at the
    start), and of value over bound of its limits. Costs and errors are nearly powers of the clearances: so scaled they
    are nearly linear.
    """

    def __init__(self, program: Program, start: np.ndarray, gradient: bool = True):
        self.program = program
        self.bounds = np.log(program.lower), np.log(program.upper)
        self.start = np.clip(np.log(start), *self.bounds)
        first = program.at(np.exp(self.start), gradient)
        self.positive = first.objective > 0
        self.size = max(abs(first.objective), 1e-300)

    def value(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        point = self.program.at(np.exp(z))
        return self._objective(point), self._limits(point)

    def slopes(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        x = np.exp(z)
        point = self.program.at(x, True)
        assert point.gradient is not None
        assert point.jacobian is not None
        over = max(point.objective, 1e-12 * self.size) if self.positive else self.size
        ratio = np.maximum(1 + point.limits, SMALLEST)
        gradient, jacobian = point.gradient * x / over, point.jacobian * x / ratio[:, None]
        return self._objective(point), self._limits(point), np.nan_to_num(gradient), np.nan_to_num(jacobian)

    # A design that cannot be simulated is a bad one, not the end.

    def _objective(self, point: Point) -> float:
        share = point.objective / self.size
        return float(np.nan_to_num(np.log(max(share, 1e-12)) if self.positive else share, nan=1e2))

    def _limits(self, point: Point) -> np.ndarray:
        return np.nan_to_num(np.log(np.maximum(1 + point.limits, SMALLEST)), nan=1e1) + INSIDE


def slsqp(program: Program, start: np.ndarray, tolerance: float = 1e-10) -> str:
    """Sequential quadratic programming (Kraft 1988), scipy's."""
    return _scipy(program, start, "SLSQP", {"ftol": tolerance, "maxiter": 200})


def trust_constr(program: Program, start: np.ndarray, tolerance: float = 1e-10) -> str:
    """Trust-region interior point, scipy's: slower and more patient, a second opinion."""
    return _scipy(program, start, "trust-constr", {"gtol": tolerance, "xtol": 1e-12, "maxiter": 500})


def cobyqa(program: Program, start: np.ndarray, tolerance: float = 1e-6) -> str:
    """Quadratic models without gradients (Ragonneau 2022), scipy's."""
    return _scipy(program, start, "COBYQA", {"final_tr_radius": tolerance, "maxfev": 5000})


def _scipy(program: Program, start, method: str, options: dict) -> str:
    exact = method != "COBYQA"
    scaled = _Scaled(program, start, exact)
    limits = {"fun": lambda z: -scaled.value(z)[1]}
    if exact:
        limits["jac"] = lambda z: -scaled.slopes(z)[3]

    def objective(z):
        if not exact:
            return scaled.value(z)[0]
        # Value and slopes in one solve: SLSQP asks for both almost everywhere.
        value, _, gradient, _ = scaled.slopes(z)
        return value, gradient

    if method == "SLSQP":
        constraints = [{"type": "ineq", **limits}]
    else:
        jacobian = {"jac": limits["jac"]} if exact else {}
        constraints = [scipy.optimize.NonlinearConstraint(limits["fun"], 0.0, np.inf, **jacobian)]
    if not program.limit_names:
        constraints = []
    found = scipy.optimize.minimize(
        objective,
        scaled.start,
        jac=exact or None,
        method=method,
        bounds=scipy.optimize.Bounds(*scaled.bounds, keep_feasible=method != "COBYQA"),
        constraints=constraints,
        options=options,
    )
    return "" if found.success else f"{method} ended with: {found.message}"


def augmented_lagrangian(program: Program, start: np.ndarray, tolerance: float = 1e-9, most: int = 250) -> None:
    """Augmented Lagrangian (Rockafellar 1974): optax's L-BFGS, backtracking; at most so many evaluations."""
    scaled = _Scaled(program, start)
    multipliers, weight, z, spent = np.zeros(len(program.limit_names)), 10.0, scaled.start, 0
    violation, wanted = np.inf, 1e-2
    while spent < most:

        def merit(z, multipliers=multipliers, weight=weight):
            value, limits, gradient, jacobian = scaled.slopes(z)
            pressed = np.maximum(0.0, multipliers + weight * limits)
            return value + float(pressed @ pressed - multipliers @ multipliers) / (2 * weight), (
                gradient + pressed @ jacobian
            )

        z, used = _descend(merit, z, scaled.bounds, most - spent, wanted)
        spent += used
        _, limits = scaled.value(z)
        # Of a violated limit the violation; of one with slack, how far its multiplier is from zero.
        now = float(np.max(np.abs(np.maximum(limits, -multipliers / weight)), initial=0.0))
        multipliers = np.maximum(0.0, multipliers + weight * limits)
        if now <= tolerance and wanted <= 1e2 * tolerance:
            return
        # Early multipliers are rough, and so may their minimum be.
        wanted = max(0.1 * wanted, tolerance)
        if now > 0.25 * violation:
            weight *= 4
        violation = now


def _descend(merit: Callable, z: np.ndarray, bounds, most: int, tolerance: float) -> tuple[np.ndarray, int]:
    """Projected L-BFGS; returns the last point and the number of evaluations."""
    method = LBFGS
    state, improve = method.init(jnp.asarray(z)), _jitted(method)
    value, gradient = merit(z)
    spent = 1
    while spent < most:
        fixed = ((z <= bounds[0]) & (gradient > 0)) | ((z >= bounds[1]) & (gradient < 0))
        free = np.where(fixed, 0.0, gradient)
        if np.linalg.norm(free) <= tolerance:
            break
        update, state = improve(jnp.asarray(free), state, jnp.asarray(z))
        direction = np.where(fixed, 0.0, -np.asarray(update))
        if direction @ free >= 0:
            direction = -free
        length = 1.0 if spent > 1 else min(1.0, 0.3 / np.linalg.norm(direction))
        better = None
        while spent < most and better is None:
            moved = np.clip(z + length * direction, *bounds)
            there, slope = merit(moved)
            spent += 1
            length *= 0.3
            if there <= value + 1e-4 * gradient @ (moved - z):
                better = moved, there, slope
        if better is None or np.all(better[0] == z):
            break
        z, value, gradient = better
    return z, spent


@functools.cache
def _jitted(method: optax.GradientTransformation) -> Callable:
    return jax.jit(method.update)


def projected_adam(program: Program, start: np.ndarray, rate: float = 0.05, most: int = 250) -> None:
    """Adam (optax's) on objective and exact penalty, clipped to the bounds, with a rate that falls to nothing: robust,
    and coarse.
    """
    scaled = _Scaled(program, start)
    method = optax.adam(optax.cosine_decay_schedule(rate, most))
    z = scaled.start
    state, improve = method.init(jnp.asarray(z)), _jitted(method)
    for _ in range(most):
        _, limits, gradient, jacobian = scaled.slopes(z)
        if limits.size and limits.max() > 0:
            # A violated limit outweighs whatever the objective could gain by violating it.
            k = int(np.argmax(limits))
            steep = np.linalg.norm(gradient) / max(np.linalg.norm(jacobian[k]), 1e-12)
            gradient = gradient + 3 * steep * jacobian[k]
        update, state = improve(jnp.asarray(gradient), state, jnp.asarray(z))
        z = np.clip(z + np.asarray(update), *scaled.bounds)


def cma_es(program: Program, start: np.ndarray, tolerance: float = 1e-6, seed: int = 1) -> None:
    """Covariance matrix adaptation with an augmented Lagrangian (package `cma`): a baseline without gradients."""
    try:
        import cma
    except ImportError:
        raise ClearanceError("CMA-ES needs the package cma: pip install 'clearance-jax[cma]'.") from None
    scaled = _Scaled(program, start, False)
    options = {
        "bounds": [b.tolist() for b in scaled.bounds],
        "seed": seed,
        "verbose": -9,
        "tolx": tolerance,
        "tolfun": tolerance**2,
    }
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as scratch:
        options["verb_filenameprefix"] = scratch + "/"  # its logger makes a folder even where it logs nothing
        warnings.filterwarnings("ignore", message=".*moarchiving")  # an extra of cma's that is not used
        cma.fmin_con2(
            lambda z: scaled.value(np.asarray(z))[0],
            scaled.start.tolist(),
            0.2,
            constraints=lambda z: scaled.value(np.asarray(z))[1].tolist(),
            options=options,
        )


SOLVERS: dict[str, Callable[..., str | None]] = {
    "slsqp": slsqp,
    "trust-constr": trust_constr,
    "augmented-lagrangian": augmented_lagrangian,
    "projected-adam": projected_adam,
    "cobyqa": cobyqa,
    "cma-es": cma_es,
}
GRADIENT_FREE = ("cobyqa", "cma-es")
INTERRUPTED, SPENT = "interrupted", "stopped: as many evaluations as allowed"


def run(program: Program, method: str, start: np.ndarray, **options) -> str:
    """Run a solver by name, then pull its answer inside the limits; returns why it stopped early, or nothing."""
    if method not in SOLVERS:
        raise ClearanceError(f"There is no design solver {method!r}. " + suggest(method, SOLVERS))
    exact = method not in GRADIENT_FREE
    try:
        # Where a motion has no end there is no slope to follow: smaller clearances rattle less.
        if not np.isfinite(program.at(start, exact).worst):
            found = restored(program, start, exact)
            start = start if found is None else found.x
        said = SOLVERS[method](program, start, **options)
        _pull_inside(program, exact)
        return said or ""
    except Enough:
        return SPENT
    except KeyboardInterrupt:
        if not program.points:
            raise
        return INTERRUPTED


def _pull_inside(program: Program, gradient: bool) -> None:
    """Evaluate a feasible neighbour of the best point that all but holds its limits: solvers end on a limit from both
    sides, and the best point that holds may be an early and poor one.
    """
    near = [p for p in program.points if p.worst < NEARLY]
    if near:
        # A violation is worth some multiple of itself in objective: powers of clearances have small exponents.
        best = min(near, key=lambda p: p.objective + PRICE * abs(p.objective) * max(p.worst, 0.0))
        restored(program, best.x, gradient)
    elif program.nearest is not None:
        restored(program, program.nearest.x, gradient)


def restored(program: Program, x: np.ndarray, gradient: bool = False) -> Point | None:
    """A feasible point on the scaling line through `x`, towards smaller clearances and near; nothing where none is."""
    # One that has come to its bound stays there, and the others go on.
    point, shift, low = program.at(x, gradient), 0.0, float(np.min(np.log(program.lower / x)))
    # Errors grow about as clearances do: shrink by the violation, and on from there.
    for _ in range(12):
        if point.feasible:
            return point
        shift = max(low, shift - max(2 * point.worst, 1e-8) if np.isfinite(point.worst) else shift - 0.5)
        point = program.at(x * np.exp(shift), gradient)
        if shift == low:
            break
    return point if point.feasible else None
