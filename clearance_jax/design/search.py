"""The search for a design: from what is asked to an answer that holds it."""

from collections.abc import Callable, Mapping
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.analysis.trust import gradient_report
from clearance_jax.ask.place import HERE, Place
from clearance_jax.design.answer import Design
from clearance_jax.design.evaluation import Evaluation
from clearance_jax.design.formulation import formulate
from clearance_jax.design.methods import AUTO, Method, method_of
from clearance_jax.design.run import INTERRUPTED, SPENT, run
from clearance_jax.design.specification import Specification
from clearance_jax.errors import ClearanceError
from clearance_jax.parameters import replace


def search(
    specification: Specification,
    method: str | Method = "slsqp",
    start: Mapping[str, float] | None = None,
    starts: int = 1,
    seed: int = 0,
    record: str | Path | None = None,
    most: int = 1_000_000,
    progress: Callable[[Evaluation], None] | None = None,
    place: Place = HERE,
) -> Design:
    """The best design found, many simulations solved at a `place`; other arguments as `ToleranceProblem.solve`'s."""
    if method != AUTO:
        method = method_of(method)
    program = formulate(specification, place=place, record=record, most=most, progress=progress)
    x = np.sqrt(program.lower * program.upper)
    if start is not None:
        given = np.array([float(start[name]) for name in specification.variables])
        x = given if len(specification.names) == len(given) else given.min(keepdims=True)
    if program.best is not None:
        x = program.best.x
    note = ""
    if method == AUTO:
        note = _distrust(specification, x)
        method = "cobyqa" if note else "slsqp"
    method = method_of(method)
    if method.gradients:
        _check_derivatives(specification, x)
    # Finer than the solves it cannot be.
    options = {"tolerance": 10 * specification.rtol} if method.name == "slsqp" else {}
    stop_reason, rng = run(program, method, x, **options), np.random.default_rng(seed)
    for _ in range(starts - 1):
        # A solver that gave up is one thing, an end to all of it another.
        if stop_reason not in (INTERRUPTED, SPENT):
            other = np.exp(rng.uniform(np.log(program.lower), np.log(program.upper)))
            stop_reason = run(program, method, other, **options)
    point = program.best or program.nearest
    if point is None:
        raise ClearanceError(f"`most` must be at least 1, but it is {most}: no design was evaluated.")
    return Design(specification, program, method, point, stop_reason, note)


def _check_derivatives(specification: Specification, x: np.ndarray) -> None:
    """Raise for a metric without derivatives, before anything is spent."""
    values = specification.clearances(x)
    for limit in specification.limits:

        def of(c, metric=limit.simulation_metric.base_metric):
            moved = replace(specification.mechanism, {name: c * v for name, v in values.items()})
            return metric(moved, jnp.asarray(specification.t1), **specification.options)

        try:
            jax.eval_shape(jax.jacfwd(of), jnp.ones(()))
        except ClearanceError as error:
            raise ClearanceError(f"Limit `{limit.title}`: {error} Or choose method='cobyqa'.") from None


def _distrust(specification: Specification, x: np.ndarray) -> str:
    """Why gradients are useless at a point, in words; empty where they are not."""
    names = tuple(specification.variables)
    for name, values in specification.conditions.items():
        moved = replace(specification.move(specification.mechanism, values), specification.clearances(x))
        for limit in specification.limits:
            try:
                report = gradient_report(
                    moved,
                    limit.metric.base_metric,
                    names,
                    specification.t1,
                    samples=max(16, len(names) + 3),
                    on_untrusted="ignore",
                    **specification.options,
                )
            except (ClearanceError, RuntimeError) as error:
                return f"There are no gradients to trust ({name}, {limit.title}): {error}"
            if not report.trusted:
                return f"Gradients are not to be trusted ({name}, {limit.title}): {report.reasons[0]}"
    return ""
