"""Result codes of a solve, and their meaning in words."""

import enum

import diffrax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Code


class Result(enum.IntEnum):
    """Why a solve ended."""

    REACHED_END = 0
    IMPOSSIBLE = 1
    STEP_COLLAPSED = 2
    MAX_STEPS = 3
    INTERRUPTED = 4
    NO_POSE = 5
    SAMPLE_TIMES = 6
    TOLERANCE = 7
    LEFT = 8


WORDS = {
    Result.REACHED_END: "",
    Result.IMPOSSIBLE: "a number is out of its bounds, or the mechanism cannot be assembled or settled",
    Result.STEP_COLLAPSED: "the step size collapsed: not finite, a force that jumps, or a derivative lost in round-off",
    Result.MAX_STEPS: "the largest number of steps was reached",
    Result.INTERRUPTED: "interrupted",
    Result.NO_POSE: "at some instant a pin finds no rest under its load, or a loop cannot be closed",
    Result.SAMPLE_TIMES: "a sample time in `save_at` is not between `t0` and `t1`",
    Result.TOLERANCE: "`rtol` or `atol` is smaller than 64-bit numbers resolve, or `rtol` is not below 1",
    Result.LEFT: "a block has slid out of its guide (`guide_length`)",
}


def words(code: int | Array) -> str:
    """A code in words; empty where the solve reached its end."""
    return WORDS[Result(int(code))]


def code_of(result: diffrax.RESULTS) -> Code:
    """Diffrax's result as a `Result`."""
    known = ((diffrax.RESULTS.successful, Result.REACHED_END), (diffrax.RESULTS.max_steps_reached, Result.MAX_STEPS))
    code = jnp.asarray(int(Result.STEP_COLLAPSED))
    for theirs, ours in known:
        code = jnp.where(result == theirs, int(ours), code)
    return code
