"""A choice between two programs by the platform for which they are lowered.

`jax.lax.platform_dependent` traces both, which doubles the tracing of a batch on a CPU. `jax.default_backend()` does
not know the platform of a lowering by `jax.export` or for another device than the first. So this is a primitive of its
own with two lowering rules; only the rule for GPUs traces their program.
"""

from collections.abc import Callable
from typing import Any

import jax
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun
from jax.interpreters import mlir


def by_platform(plain: Callable, on_gpu: Callable, *arguments: Any) -> Any:
    """`plain` of trees of arrays; in a program for a GPU `on_gpu`, which returns a tree of the same shapes.

    Neither may close over traced values. It has no rules of batching and differentiation.
    """
    program, shapes = jax.make_jaxpr(plain, return_shape=True)(*arguments)
    leaves, structure = jax.tree.flatten(arguments)
    answers = jax.tree.structure(shapes)

    def other(*leaves):
        out = on_gpu(*jax.tree.unflatten(structure, leaves))
        assert jax.tree.structure(out) == answers
        return jax.tree.leaves(out)

    return jax.tree.unflatten(answers, _by_platform.bind(*leaves, program=program, on_gpu=other))


_by_platform = Primitive("by_platform")
_by_platform.multiple_results = True


def _plain(*leaves: Any, program: ClosedJaxpr, on_gpu: Callable) -> list:
    return jaxpr_as_fun(program)(*leaves)


_by_platform.def_impl(_plain)
_by_platform.def_abstract_eval(lambda *_, program, on_gpu: program.out_avals)
mlir.register_lowering(_by_platform, mlir.lower_fun(_plain))
mlir.register_lowering(_by_platform, mlir.lower_fun(lambda *leaves, on_gpu, **_: on_gpu(*leaves)), platform="gpu")
