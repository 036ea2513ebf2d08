"""The wear model of a joint, whose numbers have names: what a cycle wears off, with derivatives by these numbers.

Derivatives go to the joint as `Modes`: changes of the profile with each number asked for. So a solve carries one
derivative per number, not one per sector.

The nodes of the quadrature in time are fixed while numbers vary. This gives the whole derivative: forces and sliding
speeds are continuous, so a touch or a change of a slip's sign that moves adds nothing to an integral over time.
"""

import dataclasses
import warnings
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax.analysis.rubbing import CHUNK, contacts, look, pin_of, sections_of
from clearance_jax.errors import ClearanceError, WearFailure, WornThrough
from clearance_jax.joints import AbstractPin, Modes
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import flatten, physical, replace, values_of
from clearance_jax.solve.drivers.trace import trace
from clearance_jax.solve.settings import Settings, settings_of
from clearance_jax.solve.simulate import run
from clearance_jax.units import format_quantity
from clearance_jax.wear.laws import AbstractWearLaw
from clearance_jax.wear.pressure import AbstractPressure
from clearance_jax.wear.worn import USUAL, SectorsWarning, accumulate, doubt, fewest, surely_fine, wear_of, wear_round

# Options of a trace that the solve with derivatives does not take.
OF_TRACES = ("save_at", "energy_balance", "derivatives")
# A sector that stands higher than its neighbours by u wears more than they by `relief` times u in a cycle. With a
# relief of two it is lower by u afterwards. With more, the differences alternate and grow from cycle to cycle.
MOST_RELIEF = 2.0


class WearModel(Module):
    """How a revolute joint in the plane wears, cycle by cycle. A cycle is the motion from t0 to `cycle`.

    **Arguments:** `mechanism`; `joint`: its name; `wear`: the law of wear; `pressure`: how a force spreads (a
    `Foundation`, if it must depend on the worn profile); `cycle` [s].

    Its numbers have the names of the mechanism. Those of the law begin with `wear.`, those of the pressure with
    `pressure.`: "crank.radial_clearance", "wear.coefficient", "pressure.stiffness".

    **Raises:** `ClearanceError` for a joint of another kind.
    """

    mechanism: Mechanism = flatten()
    joint: str = eqx.field(static=True)  # pyright: ignore[reportGeneralTypeIssues]
    wear: AbstractWearLaw  # pyright: ignore[reportGeneralTypeIssues]
    pressure: AbstractPressure  # pyright: ignore[reportGeneralTypeIssues]
    cycle: Scalar = physical("s", above=0.0)

    def __check_init__(self):
        if self.clearance.section_count > 1:
            text = f"`{self.joint}` is no revolute joint with clearance in a plane: its life is not known."
            raise ClearanceError(text)

    @property
    def clearance(self) -> AbstractPin:
        """The joint's clearance."""
        return pin_of(self.mechanism, self.joint)

    def begin(self, sectors: int) -> np.ndarray:
        """The profile of the joint at first [m], shape (sectors,): its own, or zeros."""
        profile = self.clearance.profile
        return np.zeros(sectors) if profile is None else np.asarray(profile)

    def at(self, depth: Any) -> Mechanism:
        """The mechanism with its joint worn by a depth [m], shape (sectors,)."""
        return self.mechanism.with_clearance(self.joint, self.clearance.worn(depth))

    def cycle_wears(self, stack: np.ndarray, names: Sequence[str], after: int, options: dict[str, Any]) -> np.ndarray:
        """What one cycle wears off [m] after so many cycles, and the derivatives of that by the named numbers. `stack`,
        shape (1 + names, sectors): the profile, and below it its derivatives.

        **Raises:** `WornThrough` where the motion stops, and where a cycle wears off more than the clearance;
        `WearFailure` where it wears off so much of a foundation that depths run away (`MOST_RELIEF`); `ClearanceError`
        for the name "cycle".
        """
        if "cycle" in names:
            raise ClearanceError("There is no derivative by `cycle`, which moves the end of the motion: leave it out.")
        now = self.at(stack[0])
        motion = trace(now, float(self.cycle), **{"save_at": None, **options})
        if motion.message:
            raise WornThrough(f"After {after} cycles the motion stopped: {motion.message}")
        before = jnp.asarray(after * (self.cycle - motion.time[0]), float)
        sleeve, seen = sections_of(now, self.joint), contacts(motion, self.joint)
        profile = jnp.asarray(stack[0])
        round_sleeve, count = sections_of(self.mechanism, self.joint), stack.shape[-1]
        if after == 0 and not surely_fine(seen, round_sleeve, self.pressure, count):
            too_few = doubt(wear_round(seen, round_sleeve, self.wear, self.pressure), count, self.joint)
            if too_few:
                warnings.warn(too_few, SectorsWarning, stacklevel=3)
        worn = wear_of(seen, sleeve, self.wear, self.pressure, depth=profile, before=before)
        off = np.asarray(worn.depth)
        self._check(off.max(), float(worn.relief), after)
        if not names:
            return off
        # Padded, so that motions of about as many steps share a program.
        ends = np.pad(motion.time, (0, -motion.time.size % CHUNK), mode="edge")
        solve = settings_of(now, float(self.cycle), {k: v for k, v in options.items() if k not in OF_TRACES})
        slopes = _cycle_slopes(self, tuple(names), jnp.asarray(stack), jnp.asarray(ends), before, solve)
        return np.concatenate([off, np.asarray(slopes)])

    def sectors(self, options: dict[str, Any]) -> int:
        """The number of sectors that its sleeve needs for the motion of its first cycle; of a worn one its own."""
        if self.clearance.depth is not None:
            return self.begin(USUAL).size
        motion = trace(self.at(self.begin(USUAL)), float(self.cycle), **{"save_at": None, **options})
        if motion.message:
            return USUAL  # `cycle_wears` raises the message
        seen, sleeve = contacts(motion, self.joint), sections_of(self.mechanism, self.joint)
        return fewest(wear_round(seen, sleeve, self.wear, self.pressure))

    def _check(self, deepest: float, relief: float, after: int) -> None:
        """Raise where a cycle wears off too much to be taken at one profile."""
        wears, play = f"After {after} cycles one cycle wears off", self.clearance.radial_clearance
        check = "Check the unit of the law's coefficient, or take a shorter cycle"
        fix = f"but within a cycle the profile is taken as it is. {check}"
        if not deepest <= play:
            depth, most = (format_quantity(float(length), "m") for length in (deepest, play))
            raise WornThrough(f"{wears} {depth}, more than the radial clearance of `{self.joint}`, {most}; {fix}.")
        if not relief <= MOST_RELIEF:
            raise WearFailure(
                f"{wears} {relief:.3g} times what the pin stands in the foundation of `{self.joint}`: beyond "
                f"{MOST_RELIEF:g} depths run away from one sector to the next, cycle by cycle; {fix}, or a softer "
                "foundation."
            )

    def shift(self, names: tuple[str, ...], stack: Array, shares: Array) -> "WearModel":
        """The same with named numbers changed by shares of their `sizes`, and the profile along with them. `stack`,
        shape (1 + shares, sectors): the profile and its derivatives by these numbers; further rows change it alone.
        """
        sizes, old = self.sizes(names), values_of(self, names).items()
        new = {name: value + size * x for (name, value), size, x in zip(old, sizes, shares, strict=False)}
        scales = jnp.concatenate([sizes, jnp.ones(stack.shape[0] - 1 - len(names))])
        return replace(self, new).wear_by(stack[0], stack[1:] * scales[:, None], shares)

    def wear_by(self, depth: Array, rows: Array, shares: Array) -> "WearModel":
        """The same worn by `depth` + `shares` @ `rows` [m], (sectors,); `rows` have the shape (shares, sectors)."""
        # A solve resolves effects of a number relative to its size: an amount of 1 is one clearance deep.
        size = jnp.max(jnp.abs(rows), axis=1) / jax.lax.stop_gradient(self.clearance.radial_clearance)
        size = jnp.where(size > 0, size, 1.0)
        worn = dataclasses.replace(self.clearance.worn(depth), modes=Modes(rows / size[:, None], size * shares))
        return dataclasses.replace(self, mechanism=self.mechanism.with_clearance(self.joint, worn))

    def sizes(self, names: tuple[str, ...]) -> Array:
        """The scales of the named numbers: their magnitudes, or 1 where they are 0."""
        sizes = jnp.asarray([jnp.abs(value) for value in values_of(self, names).values()], float)
        return jnp.where(sizes == 0, 1.0, sizes)


@eqx.filter_jit
def _cycle_slopes(
    model: WearModel, names: tuple[str, ...], stack: Array, ends: Array, before: Array, solve: Settings
) -> Float[Array, "names sectors"]:
    """Derivatives of what a cycle wears off by the named numbers, for a motion with these step ends [s]."""

    def of(shares):
        now = model.shift(names, stack, shares)
        solution = run(now.mechanism, now.cycle, solve._replace(save_at=ends))
        seen = look(now.mechanism, now.joint, ends, solution.y)
        depth = now.clearance.profile
        sleeve = sections_of(now.mechanism, now.joint)
        return accumulate(seen, sleeve, now.wear, now.pressure, "sleeve", depth[None], before)[0].depth[0]

    slopes = jax.jacfwd(of)(jnp.zeros(len(names)))
    return slopes.T / model.sizes(names)[:, None]
