"""A solved motion: states, how the solve ended, and every quantity of the motion by name."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from clearance_jax._basis.module import Module
from clearance_jax._compile.solo import solo_jit
from clearance_jax.dynamics.field import BALANCE_TERMS
from clearance_jax.dynamics.quantities import QuantityEntry, evaluate, quantities
from clearance_jax.dynamics.seated import Seated
from clearance_jax.errors import ClearanceError, unknown_name
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.codes import Result, words
from clearance_jax.solve.start import rest_words
from clearance_jax.solve.steps.observers import Picked
from clearance_jax.solve.validity import WORDS as LEVELS
from clearance_jax.solve.validity import Validity
from clearance_jax.units import format_quantity


class Solution(Module):
    """A solved motion. It prints itself, and gives its quantities by name, in SI units:

        solution["piston.position"]      # a point's: position, velocity, acceleration; also `piston.position.x`
        solution["wrist.contact_force"]  # a clearance joint's: eccentricity, penetration, friction_force, ...
        solution["crank.velocity"]       # a joint coordinate's: position, velocity; `play` has coordinates of its own
        solution["friction_loss"]        # energies; of a driven joint `drive_force`; of any `joint_reaction`

    `solution.names` lists them. If samples were asked for (`save_at`), the first axis of a quantity is time; otherwise
    it is the value at the end. A solution works under jit, vmap (the axes of a batch come first) and differentiation.

    - `time`: times of the samples [s], shape (samples,); `y`: states `[q, v, memory, energy balance]` there, shape
      (samples, n).
    - `initial`: the state at the start, shape (n,); `final`: the state at the end, which was reached at `end_time` [s].
    - `code`: how the solve ended (`codes.Result`); `succeeded`: whether it reached t1; `message`: why not, in words.
      Inside jit, vmap or a derivative every other number of one that did not, but `end_time`, is NaN.
    - `steps`, `rejected`, `cuts`: how many steps were made, how many attempts were rejected, and how many of these
      were cut at a switch of a law (a touch, a separation, a change of formula); the others had too large an error.
    - `energy_balance`: whether the states have the energy balance's integrals.
    - `energy_residual`: |energy gained - work of drives + losses| / energy exchanged; its derivatives are zero.
    - `records`, `picked`: what the observers of metrics recorded, and the states that they picked.
    - `seated`: how the pins of a settled start begin; `rests`: in words, which begin at relative rest and why.
    - `mechanism`: what was solved. `numbers`, `structure` and `sampled` hold it and what was asked, for quantities that
      are computed later.
    - `frequencies`: of a quasi-static motion the lowest frequency about each pose of its grid [Hz]; `validity`: how far
      such a motion can be believed, a `Validity`.
    """

    time: Float[Array, " samples"]
    y: Float[Array, "samples *rows n"]
    initial: Float[Array, "*rows n"]
    final: Float[Array, "*rows n"]
    code: Int[Array, ""]
    steps: Int[Array, ""]
    rejected: Int[Array, ""]
    cuts: Int[Array, ""]
    energy_residual: Float[Array, ""]
    end_time: Float[Array, ""]
    records: tuple = ()
    picked: tuple[Picked | None, ...] = ()
    seated: Seated | None = None
    frequencies: Float[Array, " instants"] | None = None
    validity: Validity | None = None
    numbers: Any = None
    structure: Any = eqx.field(static=True, default=None)
    sampled: bool = eqx.field(static=True, default=True)
    energy_balance: bool = eqx.field(static=True, default=True)

    def of(self, mechanism: Mechanism) -> "Solution":
        """The same solution with its mechanism."""
        numbers, structure = mechanism, None
        # A leaf that is not a number (a law's own function) cannot leave a compiled program.
        if not all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(mechanism)):
            numbers, structure = eqx.partition(mechanism, eqx.is_array_like)
        return dataclasses.replace(self, numbers=numbers, structure=structure)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that was solved."""
        return _whole(self.numbers, self.structure)

    @property
    def succeeded(self) -> Array:
        """Whether the solve reached t1."""
        return self.code == int(Result.REACHED_END)

    @property
    def found(self) -> list[Picked]:
        """The states that observers picked, of those that pick any."""
        return [pick for pick in self.picked if pick is not None]

    @property
    def message(self) -> str:
        """Why a single solve stopped; empty where it reached t1."""
        return words(self.code)

    @property
    def rests(self) -> str:
        """Which joints of a single settled start begin at relative rest, and why; empty where none does."""
        return rest_words(self.mechanism, self.seated)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its quantities."""
        return tuple(quantities(self.mechanism, self.energy_balance))

    def __getitem__(self, name: str) -> Array:
        """A quantity by name [SI], shape (samples, ...); without samples its value at the end."""
        quantity = self._lookup(name, quantities(self.mechanism, self.energy_balance))
        if quantity.place is not None:
            return self._read(quantity)
        # Integrals that a metric asks for may follow the energy balance.
        width = layout(self.mechanism).size + (len(BALANCE_TERMS) if self.energy_balance else 0)
        values = _evaluate(self.numbers, self.structure, quantity.variable, self.time, self.y[..., :width])
        # The axes of `time` come before the entry that is meant.
        value = self._over_time(values[(slice(None),) * self.time.ndim + quantity.index])
        return _scale(value) if quantity.variable == "exchanged" else value

    def state(self, name: str) -> Array:
        """A state by name [SI]: a free coordinate (`wrist.play_x`), its rate (`wrist.play_x.velocity`), a law's memory
        (`wrist.impact_speed`). It is read from `y`; nothing is computed.
        """
        every = quantities(self.mechanism, self.energy_balance)
        if name in every and every[name].place is None:
            text = f'`{name}` is no state: it is driven, or follows from states. Use `solution["{name}"]`.'
            raise ClearanceError(text)
        return self._read(self._lookup(name, {k: q for k, q in every.items() if q.place is not None}, "state"))

    def _read(self, quantity: QuantityEntry) -> Array:
        return self._over_time(self.y[..., quantity.place])

    def _lookup(self, name: Any, known: Mapping[str, QuantityEntry], kind: str = "quantity") -> QuantityEntry:
        if not isinstance(name, str):
            raise ClearanceError(f'A solution is asked by name, `solution["piston.position"]`, not by {name!r}.')
        if name not in known:
            raise unknown_name(f"`{self.mechanism.name}` has no {kind} `{name}`.", name, known)
        return known[name]

    def _over_time(self, values: Array) -> Array:
        """Values over time; for a solve without samples, at its end."""
        return values if self.sampled else values[(slice(None),) * (self.time.ndim - 1) + (0,)]

    def __repr__(self) -> str:
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self)) or self.numbers is None:
            return eqx.tree_pformat(self)
        return summary(self) if np.ndim(self.code) == 0 else summary_of_batch(self)


def _whole(numbers: Any, structure: Any) -> Mechanism:
    return numbers if structure is None else eqx.combine(numbers, structure)


@jax.custom_jvp
def _scale(exchanged: Array) -> Array:
    return exchanged


@_scale.defjvp
def _scale_jvp(primals, tangents):
    raise ClearanceError(
        "`exchanged` is a scale by which residuals are judged, a sum of absolute powers, without accurate derivatives. "
        "Use `drive_work`, `friction_loss` or `damping_loss`."
    )


@solo_jit
def _evaluate(numbers: Any, structure: Any, variable: str, time: Array, y: Array) -> Array:
    """A variable of every state, over the axes of `time`; all but the last are batch axes."""

    def at(time, y, ready):
        # A quantity of a NaN state need not be NaN: a norm of NaN is 0.
        known = jnp.where(jnp.isfinite(time) & jnp.all(jnp.isfinite(y)), 1.0, jnp.nan)
        return known * evaluate(variable, time, y, ready)

    def along(numbers, time, y):
        ready = _whole(numbers, structure).prepare()
        return jax.vmap(lambda t, y: at(t, y, ready))(time, y)

    for _ in range(time.ndim - 1):
        along = jax.vmap(along)
    return along(numbers, time, y)


# In print ------------------------------------------------------------------------------------------------------------


def summary(solution: Solution) -> str:
    """A single solve in a few lines: how it ended, and its named states at the end."""
    mechanism = solution.mechanism
    known, plan = quantities(mechanism, solution.energy_balance), layout(mechanism)
    final = np.asarray(solution.final)

    def last(name: str) -> str:
        quantity = known[name]
        if quantity.place is not None:
            return format_quantity(float(final[quantity.place]), quantity.unit, 5)
        # An orientation is no state by its rotation vector.
        y = final[: plan.size + (len(BALANCE_TERMS) if solution.energy_balance else 0)]
        values = _evaluate(
            solution.numbers, solution.structure, quantity.variable, np.asarray(solution.end_time)[None], y[None]
        )
        return format_quantity(float(np.asarray(values)[0][quantity.index]), quantity.unit, 5)

    rows = [("at the end", "position", "velocity")] if plan.free else []
    rows += [(name, last(name), last(f"{name}.velocity")) for name in plan.velocities]
    remembered = (*plan.memories, *plan.integrals)
    rows += [(f"{holder}.{name}", last(f"{holder}.{name}"), "") for holder, names in remembered for name in names]
    widths = [max((len(row[k]) for row in rows), default=0) for k in range(3)]
    lines = ["  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    rests = [f"  {solution.rests}"] if solution.rests else []
    if solution.validity is not None:
        rests.append(f"  {solution.validity}")
    return "\n".join([_ending(solution), *rests, *(line.rstrip() for line in lines)])


def _ending(solution: Solution) -> str:
    ended = f"stopped ({solution.message})" if solution.message else "reached t1"
    if solution.validity is not None:
        return f"{solution.mechanism.name}: quasi-static, {ended} at t = {float(solution.end_time):.6g} s"
    line = f"{solution.mechanism.name}: {ended} at t = {float(solution.end_time):.6g} s, {attempts(solution)}"
    return line + (f", energy residual {float(solution.energy_residual):.1e}" if solution.energy_balance else "")


def attempts(solution: Solution) -> str:
    """The steps of one solve, and its rejected attempts by reason."""
    steps, rejected, cuts = (int(count) for count in (solution.steps, solution.rejected, solution.cuts))
    return f"{steps} steps ({rejected} attempts rejected: {cuts} across a switch, {rejected - cuts} for their error)"


def summary_of_batch(solution: Solution) -> str:
    """How the solves of a batch ended."""
    codes, counts = np.unique(np.asarray(solution.code), return_counts=True)
    ended = [f"{count} {words(int(code)) or 'reached t1'}" for code, count in zip(codes, counts, strict=True)]
    seated = solution.seated
    resting = 0 if seated is None else np.count_nonzero(np.any(np.asarray(seated.rest) > 0, axis=-1))
    rests = f" {resting} of them begin with pins at relative rest." if resting else ""
    if solution.validity is not None:
        levels = np.bincount(np.ravel(np.asarray(solution.validity.level)), minlength=len(LEVELS))
        named = zip(levels, LEVELS, strict=True)
        rests = f" Quasi-static: {', '.join(f'{count} {word}' for count, word in named)}."
    return (
        f"{solution.mechanism.name}, a batch of {' x '.join(map(str, np.shape(solution.code)))} solves: "
        f"{'; '.join(ended)}.{rests} One of them: jax.tree.map(lambda x: x[i], solution)"
    )
