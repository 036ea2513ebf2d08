"""Programs in which every value is computed once, however many others use it.

XLA on the CPU fuses elementwise work into one kernel for each result, and computes shared values anew in each. In a
chain of bodies this work doubles with every link. So a program is read before it is compiled: a value that several
others use, and that costs more than a load from memory, gets a barrier (`barriers`) across which XLA does not fuse.
Derivatives are part of the program by then, and are read as well. A program that is called over and over, each time on
its own result, becomes a loop: diffrax finds the time 100 round-offs before the end so, a third of a small program.
"""

import functools
import itertools
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import ShapedArray
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, Literal, Var, jaxpr_as_fun, new_jaxpr_eqn

from clearance_jax._compile.barriers import barrier

# Operations that may be repeated: LLVM finds most of them again in a program that is one function, and a barrier costs
# the compiler some ten. (An arm with six sleeves compiles in 35 s with 2, in 29 s with 16 or more, and runs faster.)
REPEATED = 16
# Operations that cost almost nothing in a kernel.
_FREE = {"broadcast_in_dim", "reshape", "squeeze", "slice", "convert_element_type", "copy", "stop_gradient", "iota"}
# Operations that XLA itself does not compute twice: it takes them for expensive, or they have their own kernels.
_ONCE = {"sqrt", "rsqrt", "exp", "exp2", "expm1", "log", "log1p", "logistic", "pow", "tanh", "sin", "cos", "tan"}
_ONCE |= {"atan2", "rem", "cbrt", "erf", "while", "scan", "cond", "dot_general", "sort", "cholesky", "eigh", "gather"}
_ONCE.add(barrier.name)
# Loops within a kernel. After such a loop XLA computes anew what the kernel has computed before it, and so the loop
# itself: five sums among three thousand operations became 800 000. So they end their kernel.
_SUMS = {"reduce_sum", "reduce_prod", "reduce_max", "reduce_min", "reduce_and", "reduce_or", "argmax", "argmin"}
# Programs that are called, and become a part of their caller.
_CALLS = {"jit": "jaxpr", "pjit": "jaxpr", "closed_call": "call_jaxpr", "custom_jvp_call": "call_jaxpr"}
_CALLS |= {"custom_vjp_call": "call_jaxpr"}
# Calls in a row, each on the result of the one before, that become a loop.
ROLLED = 8
_LOOPS = {"while": ("cond_jaxpr", "body_jaxpr"), "scan": ("jaxpr",), "cond": ("branches",)}


def compute_once(function: Callable) -> Callable:
    """The same function with a program that computes shared values once. Its arguments and results are trees of arrays
    and anything else.
    """

    @functools.wraps(function)
    def once(*arguments):
        program, out, rest = eqx.filter_make_jaxpr(function)(*arguments)
        numbers = jax.tree.leaves(eqx.filter(arguments, eqx.is_array))
        values = jaxpr_as_fun(_Writer().close(program))(*numbers)
        return eqx.combine(jax.tree.unflatten(jax.tree.structure(out), values), rest)

    return once


class _Writer:
    """Rewrites programs; one that is called in several places stays one program."""

    def __init__(self):
        # By id, together with the program, so that no other object gets that id.
        self._known: dict[int, tuple[Any, Any]] = {}
        self._uses: dict[int, tuple[Any, list[int]]] = {}
        self._prices: dict[int, tuple[Any, int]] = {}

    def close(self, program: ClosedJaxpr) -> ClosedJaxpr:
        """The rewritten program, with the results of the old one."""
        if id(program) not in self._known:
            large = self._price(program) > REPEATED
            anew = ClosedJaxpr(self._anew(program.jaxpr), program.consts) if large else program
            self._known[id(program)] = program, anew
        return self._known[id(program)][1]

    def _anew(self, program: Jaxpr) -> Jaxpr:
        program = _rolled(_without_barriers(program))
        shared = self._shared(program)
        renamed: dict[Var, Var] = {}
        equations: list[JaxprEqn] = []
        for old in program.eqns:
            invars = [v if isinstance(v, Literal) else renamed.get(v, v) for v in old.invars]
            equations.append(old.replace(invars=invars, params=self._params(old)))
            for v in shared.intersection(old.outvars):
                renamed[v] = Var(v.aval)
                equations.append(new_jaxpr_eqn([v], [renamed[v]], barrier, {}, set(), old.source_info, old.ctx))
        outvars = [v if isinstance(v, Literal) else renamed.get(v, v) for v in program.outvars]
        return program.replace(eqns=equations, outvars=outvars)

    def _shared(self, program: Jaxpr) -> set[Var]:
        """The values that get a barrier: several kernels would compute them, of many operations.

        The program is read backwards, because the barriers behind a value say how many kernels use it. What it costs in
        each follows forwards (`_costs`), as if all that is used twice had barriers.
        """
        uses = self._count_uses(program)
        costs, kernels, shared = self._costs(program, uses), Counter(), set()
        # By value, the kernels that compute it, each a bit.
        new = (1 << place for place in itertools.count())
        for v in _variables(program.outvars):
            kernels[v] |= next(new)
        for equation in reversed(program.eqns):
            inside = 0
            loops = equation.primitive.name in _SUMS
            for v in equation.outvars:
                if (loops or costs[v] * (kernels[v].bit_count() - 1) > REPEATED) and _is_number(v):
                    shared.add(v)
                    inside |= next(new)
                else:
                    inside |= next(new) if _apart(equation) and uses[v] > 1 else kernels[v]
            called = _callee(equation)
            if called is None and equation.primitive.name not in _LOOPS and not _stacks(equation):
                for v in _variables(equation.invars):
                    kernels[v] |= inside
                continue
            times = [1] * len(equation.invars) if called is None else self._inputs(called)
            for v, often in zip(equation.invars, times, strict=True):
                # More kernels than decide need not be counted: in calls within calls their number doubles.
                for _ in range(0 if isinstance(v, Literal) else min(often, REPEATED + 2)):
                    kernels[v] |= next(new)
        return shared

    def _costs(self, program: Jaxpr, uses: Counter) -> Counter:
        """The operations that a kernel makes for each value, from what needs no barrier or has one."""
        costs, within = Counter(), Counter()
        for equation in program.eqns:
            apart = _apart(equation)
            cost = 0 if apart else self._own(equation) + sum(within[v] for v in {*_variables(equation.invars)})
            for v in equation.outvars:
                costs[v] = cost
                within[v] = 0 if cost * (uses[v] - 1) > REPEATED and _is_number(v) else cost
        return costs

    def _params(self, equation: JaxprEqn) -> dict[str, Any]:
        """The parameters of an equation, with the programs inside rewritten."""
        name, params = equation.primitive.name, dict(equation.params)
        for key in (_CALLS[name],) if name in _CALLS else _LOOPS.get(name, ()):
            within = params[key]
            params[key] = tuple(map(self.close, within)) if isinstance(within, tuple) else self.close(within)
        return params

    def _own(self, equation: JaxprEqn) -> int:
        """The number of operations in an equation itself; loops and branches count as many."""
        if equation.primitive.name in _FREE:
            return 0
        if equation.primitive.name in _LOOPS:
            return REPEATED + 1
        called = _callee(equation)
        return 1 if called is None else self._price(called)

    def _price(self, program: ClosedJaxpr) -> int:
        if id(program) not in self._prices:
            self._prices[id(program)] = program, sum(map(self._own, program.jaxpr.eqns))
        return self._prices[id(program)][1]

    def _count_uses(self, program: Jaxpr) -> Counter:
        """How often every value of a program is used; a called program counts as often as it uses it."""
        uses: Counter = Counter(_variables(program.outvars))
        for equation in program.eqns:
            called = _callee(equation)
            times = [1] * len(equation.invars) if called is None else self._inputs(called)
            for v, count in zip(equation.invars, times, strict=True):
                if not isinstance(v, Literal):
                    uses[v] += count
        return uses

    def _inputs(self, program: ClosedJaxpr) -> list[int]:
        """How often a called program uses each of its arguments."""
        if id(program) not in self._uses:
            uses = self._count_uses(_without_barriers(program.jaxpr))
            self._uses[id(program)] = program, [uses[v] for v in program.jaxpr.invars]
        return self._uses[id(program)][1]


def _without_barriers(program: Jaxpr) -> Jaxpr:
    """The program without the barriers that were set by hand."""
    behind: dict[Var, Any] = {}

    def before(v: Any) -> Any:
        return v if isinstance(v, Literal) else behind.get(v, v)

    equations = []
    for old in program.eqns:
        if old.primitive is barrier:
            behind[old.outvars[0]] = before(old.invars[0])
        else:
            equations.append(old.replace(invars=[*map(before, old.invars)]))
    return program.replace(eqns=equations, outvars=[*map(before, program.outvars)]) if behind else program


def _rolled(program: Jaxpr) -> Jaxpr:
    """The program with calls in a row, each of the same on the result of the one before, as loops."""
    uses = Counter([*_variables(program.outvars), *(v for e in program.eqns for v in _variables(e.invars))])
    equations: list[JaxprEqn] = []
    row: list[JaxprEqn] = []

    def end_row() -> None:
        equations.extend(row if len(row) < ROLLED else [_loop(program, row)])
        row.clear()

    for equation in program.eqns:
        goes_on = row and equation.invars == row[-1].outvars and uses[row[-1].outvars[0]] == 1
        if not (goes_on and _same(equation, row[-1])):
            end_row()
        called, given = _callee(equation), [*_variables(equation.invars)]
        if called is not None and len(equation.invars) == len(given) == len(equation.outvars) == 1:
            row.append(equation)
        else:
            equations.append(equation)
    end_row()
    return program.replace(eqns=equations)


def _same(a: JaxprEqn, b: JaxprEqn) -> bool:
    """Whether calls compute the same (their rules of derivatives may differ). A text does not show everything."""
    first, second = _callee(a), _callee(b)
    if first is None or second is None or a.primitive is not b.primitive:
        return False
    if first is second:
        return True
    return str(first) == str(second) and not a.effects and _is_plain(first) and _is_plain(second)


def _is_plain(program: ClosedJaxpr) -> bool:
    """Whether the text of a program shows all that it does: it has no constant arrays, and calls no Python."""
    params = [value for equation in program.eqns for key, value in equation.params.items() if key != "ctx_mesh"]
    inner = jax.tree.leaves(params)
    functions = any(callable(x) and not isinstance(x, ClosedJaxpr) for x in inner)
    within = all(_is_plain(x) for x in inner if isinstance(x, ClosedJaxpr))
    return not program.consts and not functions and within


def _loop(program: Jaxpr, row: list[JaxprEqn]) -> JaxprEqn:
    """One call that does what calls in a row do. Calls of several programs may have several rules of derivatives: the
    loop has none then.
    """
    first, last = row[0], row[-1]
    alone = program.replace(constvars=[], invars=first.invars, outvars=first.outvars, eqns=[first])
    step = jaxpr_as_fun(ClosedJaxpr(alone, []))
    whole = jax.jit(lambda x: jax.lax.fori_loop(0, len(row), lambda _, x: step(x)[0], x))
    if any(_callee(call) is not _callee(first) for call in row):
        whole = jax.custom_jvp(whole)
        whole.defjvp(_refuse)
    (call,) = jax.make_jaxpr(whole)(first.invars[0].aval).jaxpr.eqns
    return call.replace(invars=first.invars, outvars=last.outvars)


def _refuse(*_: Any) -> Any:
    raise TypeError("A program that has been read for its calls in a row has no derivatives; take them within it.")


def _callee(equation: JaxprEqn) -> ClosedJaxpr | None:
    """The program that an equation calls, if any."""
    key = _CALLS.get(equation.primitive.name)
    return None if key is None else equation.params[key]


def _apart(equation: JaxprEqn) -> bool:
    """Whether XLA itself computes an equation's values once. (It makes a product of a division by a constant.)"""
    name = equation.primitive.name
    return name in _ONCE or (name == "div" and not isinstance(equation.invars[1], Literal))


def _stacks(equation: JaxprEqn) -> bool:
    """Whether an equation puts arrays side by side: XLA gives each of them a kernel. (Numbers share one.)"""
    arrays = any(getattr(v.aval, "size", 1) > 1 for v in equation.invars)
    return arrays and equation.primitive.name in ("concatenate", "stack")


def _variables(atoms: Any) -> Iterator[Var]:
    return (v for v in atoms if not isinstance(v, Literal))


def _is_number(v: Var) -> bool:
    if type(v.aval) is not ShapedArray:  # a reference, say
        return False
    return any(jnp.issubdtype(v.aval.dtype, kind) for kind in (jnp.bool_, jnp.floating))
