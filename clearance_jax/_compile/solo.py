"""Programs of one motion that compile in half the time; functions that are one program where they are called alone."""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
from jax.core import eval_context
from jax.extend import core as jax_core
from jax.extend.core import get_opaque_trace_state

# Up to JAX 0.10 XLA has two ways to make machine code of a fused kernel on the CPU. The newer one ("fusion emitters",
# on by default) takes half of all compiling. It makes kernels over many lanes faster, but not those of one motion. JAX
# 0.12 has only the newer one.
SOLO: dict[str, Any] = {"xla_cpu_use_fusion_emitters": False} if jax.__version_info__ < (0, 11) else {}

_core: Any = jax_core  # whose last function a type checker does not count as exported


class solo_jit:
    """A function as `eqx.filter_jit` makes it, for one motion: called alone it compiles quickly. Inside another program
    or a batch it is compiled with that, as usual.
    """

    def __init__(self, function: Callable):
        self.within, self.alone = (eqx.filter_jit(function, **how) for how in ({}, {"compiler_options": SOLO}))
        functools.update_wrapper(self, function)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        program = self.alone if _is_alone() else self.within
        return program(*arguments, **named)


def _is_alone() -> bool:
    """Whether a call is inside of no program, batch or derivative."""
    now = get_opaque_trace_state()
    with eval_context():
        return now == get_opaque_trace_state()


def is_traced() -> bool:
    """Whether a call is inside a program that is being traced, even if it is mapped or differentiated there."""
    # JAX discourages functions that differ there, because their values might. Here the values do not.
    return _core.unsafe_am_i_under_a_jit_DO_NOT_USE()


def whole(function: Callable) -> Callable:
    """A function that is compiled as one program where it is called alone; operation by operation JAX would compile
    dozens. Inside another program it is part of that one.
    """
    program = eqx.filter_jit(function)

    @functools.wraps(function)
    def call(*arguments, **named):
        return (function if is_traced() else program)(*arguments, **named)

    return call
