"""Functions that a program for a CPU runs as one compiled function, with all their loops.

XLA on the CPU runs the body of a loop operation by operation, which costs a motion several times its time. A call that
carries marks is compiled as one function instead. The marks travel with the program, through `jit`, `vmap` and
derivatives, whatever flags the process has.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.extend.mlir import ir
from jax.extend.mlir.dialects import stablehlo as hlo
from jax.interpreters import ad, batching, mlir

# XLA reads these on a call: whether it stays a call, and is compiled as one function.
_STAYS, _ONE = "inlineable", "xla_cpu_small_call"
_MARKS = "mhlo.frontend_attributes"
# What XLA cannot compile so (`small_while_loop_hoisting_pass.cc` of XLA lists it): work of other kernels and devices.
_APART = {"custom_call", "scatter", "sort", "fft", "infeed", "outfeed", "replica_id", "partition_id", "top_k"}
_APART |= {"all_gather", "all_reduce", "all_to_all", "collective_permute", "reduce_scatter"}
# XLA leaves long reductions and products of matrices to a library (`ynn_support.cc` of XLA): from so many numbers
# (measured), and from so many rows, columns or terms.
LONG, _WIDE = 4096, 8
# The reductions of which it has kernels, each as XLA does not recognise it, with the same bits.
_DISGUISED = {
    "stablehlo.add": lambda a, b: hlo.subtract(a, hlo.negate(b)),
    "stablehlo.maximum": lambda a, b: hlo.negate(hlo.minimum(hlo.negate(a), hlo.negate(b))),
    "stablehlo.minimum": lambda a, b: hlo.negate(hlo.maximum(hlo.negate(a), hlo.negate(b))),
}


def one_function(function: Callable) -> Callable:
    """The same function of trees of arrays and anything else. Programs for a CPU run it as one compiled function,
    unless it needs kernels of their own (LAPACK, sorting).
    """

    @functools.wraps(function)
    def call(*arguments):
        arrays, rest = eqx.partition(arguments, eqx.is_array)
        numbers, tree = jax.tree.flatten(arrays)
        others: list[Any] = []

        @jax.jit
        def program(packed):
            unpacked = jax.tree.unflatten(tree, _unpack(packed, numbers))
            results, other = eqx.partition(function(*eqx.combine(unpacked, rest)), eqx.is_array)
            others.append(other)
            return results

        # XLA aborts on an argument that nothing uses in the end. Of a single one something is always used.
        results = program(_pack(numbers))
        return eqx.combine(jax.tree.map(_result.bind, results), others[-1])

    return call


# A whole number as two floats that hold it exactly.
_HALF = 32


def _pack(numbers: list[Any]) -> jax.Array:
    """Arrays of numbers and flags as one vector of floats."""
    parts = []
    for x in numbers:
        flat = jnp.ravel(x)
        if jnp.issubdtype(flat.dtype, jnp.floating):
            parts.append(flat.astype(float))
        else:
            whole = flat.astype(jnp.int64)
            parts += [(whole >> _HALF).astype(float), (whole & (2**_HALF - 1)).astype(float)]
    return jnp.concatenate(parts)


def _unpack(packed: jax.Array, like: list[Any]) -> list[jax.Array]:
    """The arrays that `_pack` has packed."""
    out, place = [], 0

    def take(x):
        nonlocal place
        place += x.size
        return jax.lax.slice_in_dim(packed, place - x.size, place).reshape(x.shape)

    for x in like:
        part = take(x)
        if not jnp.issubdtype(x.dtype, jnp.floating):
            part = (part.astype(jnp.int64) << _HALF) | take(x).astype(jnp.int64)
        out.append(part.astype(x.dtype))
    return out


def _mark(context: Any, value: Any) -> list:
    """Mark the call whose result a value is."""
    call = value.owner
    # A result that is an argument passed on, or a constant, has no call. Another result may have marked it.
    if _is_call(call) and _MARKS not in call.attributes:
        can_be = _can_be_one(call, context.module_context.symbol_table, {})
        marks = {_STAYS: "false", _ONE: "true"} if can_be else {_ONE: "false"}
        call.attributes[_MARKS] = ir.DictAttr.get({name: ir.StringAttr.get(text) for name, text in marks.items()})
    return [value]


def _is_call(operation: Any) -> bool:
    return not isinstance(operation, ir.Block) and operation.operation.name == "func.call"


def _can_be_one(call: Any, functions: Any, known: dict[str, bool]) -> bool:
    """Whether all that a call runs can be compiled as one function. `known`: this of functions by their names."""
    name = ir.FlatSymbolRefAttr(call.attributes["callee"]).value
    if name not in known:
        inside = _operations(functions[name].operation)
        for operation in inside:
            if _is_long(operation):
                _disguise(operation)
        known[name] = not any(_is_apart(operation) for operation in inside)
        known[name] = known[name] and all(_can_be_one(each, functions, known) for each in inside if _is_call(each))
    return known[name]


def _is_apart(operation: Any) -> bool:
    """Whether XLA gives an operation to another kernel."""
    name = operation.name.split(".")[-1]
    if name != "dot_general":
        return name in _APART
    value = ir.RankedTensorType(operation.operands[0].type)
    numbers = hlo.DotDimensionNumbers(operation.attributes["dot_dimension_numbers"])
    others = ir.RankedTensorType(operation.operands[1].type).shape
    terms = math.prod(value.shape[i] for i in numbers.lhs_contracting_dimensions)
    each = terms * math.prod(value.shape[i] for i in numbers.lhs_batching_dimensions)
    rows, columns = math.prod(value.shape) // each, math.prod(others) // each
    # XLA writes outer products, and products with a vector, as sums of products.
    matrices = min(rows, columns, terms) > 1 and max(rows, columns, terms) >= _WIDE
    return matrices or each * rows * columns >= LONG


def _is_long(operation: Any) -> bool:
    """Whether it is a reduction that XLA would give to a library."""
    if operation.name != "stablehlo.reduce" or len(operation.results) > 1:
        return False
    value = ir.RankedTensorType(operation.operands[0].type)
    return isinstance(value.element_type, ir.FloatType) and math.prod(value.shape) >= LONG


def _disguise(reduction: Any) -> None:
    """Write what a reduction does with two numbers so that XLA does not recognise it."""
    *_, combine, end = reduction.regions[0].blocks[0].operations
    if combine.operation.name in _DISGUISED and end.operands[0].owner == combine.operation:
        with ir.InsertionPoint(end), end.location:
            end.operands[0] = _DISGUISED[combine.operation.name](*combine.operands)
        combine.operation.erase()


def _operations(whole: Any) -> list[Any]:
    """All operations within one."""
    out: list[Any] = []

    def keep(operation):
        out.append(operation)
        return ir.WalkResult.ADVANCE

    whole.walk(keep)
    return out


_result = Primitive("result_of_one_function")
_result.def_impl(lambda x: x)
_result.def_abstract_eval(lambda x: x)
ad.deflinear2(_result, lambda tangent, _: [tangent])
batching.defvectorized(_result)
# Not cached: in a cached rule a value would be an argument, no longer the result of its call.
mlir.register_lowering(_result, lambda context, value: [value], cacheable=False)
mlir.register_lowering(_result, _mark, platform="cpu", cacheable=False)
