"""Input and output of a driver, the same for diffrax's loop and for lanes."""

from typing import Any, NamedTuple

from jaxtyping import Array

from clearance_jax._basis.types import Code, Each
from clearance_jax.dynamics.seated import Seated
from clearance_jax.solve.problem import Problem
from clearance_jax.solve.tolerances import Tolerances


class SolveTask(NamedTuple):
    """A motion (or lanes of motions) to be integrated from `t0` to `t1`, from a state (or stack) `start`; `save_at`:
    sample times; `seated`: how pins of a settled start begin. A `refused` one (a `codes.Result` as a number; 0: not
    refused) ends where it begins.
    """

    problem: Problem
    t0: Each
    t1: Each
    start: Array
    save_at: Array | None
    allowed: Tolerances
    refused: Code
    seated: Seated | None = None


class Outcome(NamedTuple):
    """The last state and its time; sample times and states; the observers' records; a `codes.Result` as a number; steps
    kept and rejected.
    """

    final: Array
    end_time: Each
    samples: tuple[Array, Array] | None
    record: Any
    code: Array
    accepted: Array
    rejected: Array
