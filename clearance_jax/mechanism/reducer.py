"""What a data sheet says of a reducer, in the numbers of a drive with play."""

import bisect
import dataclasses
import itertools
import math
import numbers
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import jax.numpy as jnp
from jax.core import Tracer

from clearance_jax.errors import ClearanceError, require_float64, wrong_value
from clearance_jax.joints.gears import ARC_MINUTE
from clearance_jax.laws.normal.flank import FlankCurve
from clearance_jax.mechanism.actuators import JointFriction
from clearance_jax.mechanism.imperfections import Compliance

Plain: TypeAlias = float | int
# Harmonic Drive LLC, catalogue of CSF and CSG, by size: the torques T1, T2 [N m] at which the stiffness changes; then
# the stiffnesses [1e4 N m/rad], of the ratio 30 K1, K2, K3, of 50 K1 and K2 (its K3 was not legible).
# fmt: off
HARMONIC = {
    8: ((0.29, 0.75), (0.034, 0.044, 0.054), (0.044, 0.067)), 11: ((0.80, 2.0), (0.084, 0.13, 0.16), (0.22, 0.30)),
    14: ((2.0, 6.9), (0.19, 0.24, 0.34), (0.34, 0.47)), 17: ((3.9, 12), (0.34, 0.44, 0.67), (0.81, 1.1)),
    20: ((7.0, 25), (0.57, 0.71, 1.1), (1.3, 1.8)), 25: ((14, 48), (1.0, 1.3, 2.1), (2.5, 3.4)),
    32: ((29, 108), (2.4, 3.0, 4.9), (5.4, 7.8)), 40: ((54, 196), (), (10, 14)), 45: ((76, 275), (), (15, 20)),
    50: ((108, 382), (), (20, 28)), 58: ((168, 598), (), (31, 44)), 65: ((235, 843), (), (44, 61)),
    80: ((430, 1570), (), (81, 115)), 90: ((618, 2260), (), (118, 162)), 100: ((843, 3040), (), (162, 222)),
}
# fmt: on


class StiffnessPieces(NamedTuple):
    """A stiffness in straight pieces: `stiffnesses` K1, K2, ... [N m/rad], each up to one of the rising `torques` T1,
    T2, ... [N m]. The last one goes on for ever if it has no torque; if it has one, nothing is known beyond.
    """

    torques: tuple[Any, ...]
    stiffnesses: tuple[Any, ...]

    @property
    def angles(self) -> tuple[Any, ...]:
        """The wind-up at each of the torques [rad]."""
        steps = zip(itertools.pairwise((0.0, *self.torques)), self.stiffnesses, strict=False)
        return tuple(itertools.accumulate((end - start) / k for (start, end), k in steps))


def piecewise_torque(x: Any, pieces: StiffnessPieces) -> Any:
    """The torque [N m] at a wind-up `x` [rad]. **Raises:** `ClearanceError` beyond what is known (if traced: NaN)."""
    require_float64()
    slopes, breaks = pieces.stiffnesses, pieces.angles
    y = FlankCurve(slopes, breaks[: len(slopes) - 1]).effort(x)
    if len(slopes) > len(breaks):
        return y
    beyond = jnp.abs(x) > breaks[-1] * (1 + 1e-12)
    if not isinstance(beyond, Tracer) and bool(jnp.any(beyond)):
        text = f"The stiffness is known up to {pieces.torques[-1]:.6g} N m only. Add the one beyond, from the sheet."
        raise ClearanceError(text).about("stiffness", None, pieces.torques[-1])
    return jnp.where(beyond, jnp.nan, y)


def piecewise_angle(torque: Any, pieces: StiffnessPieces) -> Any:
    """The wind-up [rad] under a `torque` [N m], within what is known: the inverse of `piecewise_torque`."""
    return piecewise_torque(torque, StiffnessPieces(pieces.angles, tuple(1 / k for k in pieces.stiffnesses)))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reducer:
    """What a data sheet says of a reducer. Torques and angles are those of its output, the link; `None`: not said.

    - `ratio`: turns of the motor in one of the link; below 0: against each other.
    - `stiffness` [N m/rad]: one number; in pieces ((T1, T2), (K1, K2, K3)), of which `pieces` tells; infinite: rigid.
    - `backlash`: the whole gap [rad]; `friction_torque`: Coulomb's [N m]; `rated_torque` [N m].
    - `rotor_inertia`: of the rotor itself [kg m^2] (`Motion` has it times `ratio`^2); `efficiency`: above 0, at most 1.
    - `transmission_error`: its amplitude [rad], about half of the positioning accuracy (greatest less least error).

    **Raises:** `ClearanceError` for numbers out of bounds.
    """

    ratio: Plain
    stiffness: Plain | tuple[Sequence[Plain], Sequence[Plain]] = math.inf
    backlash: Plain = 0.0
    friction_torque: Plain | None = None
    rated_torque: Plain | None = None
    rotor_inertia: Plain | None = None
    efficiency: Plain | None = None
    transmission_error: Plain | None = None

    def __post_init__(self):
        _check(**{name: value for name, value in vars(self).items() if name != "stiffness"})
        torques, stiffnesses = self.pieces
        plain = all(isinstance(number, numbers.Real) for number in (*torques, *stiffnesses))
        rising = plain and all(start < end for start, end in itertools.pairwise((0.0, *torques)))
        if not (rising and all(k > 0 for k in stiffnesses or (0,)) and len(stiffnesses) - len(torques) in (0, 1)):
            allowed = "one number above 0 N m/rad, or rising torques [N m] with as many stiffnesses or one more"
            raise wrong_value("`stiffness`", allowed, self.stiffness)

    @property
    def pieces(self) -> StiffnessPieces:
        """The stiffness in straight pieces, also of one number."""
        two = isinstance(self.stiffness, tuple) and [isinstance(x, Sequence) for x in self.stiffness] == [True, True]
        return StiffnessPieces(*map(tuple, self.stiffness if two else ((), (self.stiffness,))))

    @classmethod
    def from_datasheet(
        cls, *, ratio: Plain, stiffness: Any, rated_torque: Plain, lost_motion: Plain | None = None,
        backlash: Plain | None = None, hysteresis_loss: Plain | None = None, q: Plain = 0.03, **others: Any,
    ) -> "Reducer":  # fmt: skip
        """A reducer from the makers' test: its input is locked, and a slow torque goes to and fro on its output.

        A gap b, a spring k and Coulomb friction T_f make a loop of the width W = b + 2 T_f / k at zero torque. The
        middle of the loop turns by L = b + 2 q T_N / k from -q T_N to q T_N. So b and T_f follow from L and W, if T_f
        is below q T_N. Else L is 2 q T_N / k whatever the gap is.

        **Arguments:** `ratio`, `stiffness` k (the first of pieces), `rated_torque` T_N, and `others` of `Reducer`; one
        of `lost_motion` L and `backlash` b [rad]; `hysteresis_loss` W [rad], `None`: friction is not said; `q`: 0.03 by
        makers of cycloidal reducers, 0.04 by those of harmonic drives.

        **Raises:** `ClearanceError` for contradictions, and where friction hides the gap (then with the possible gaps).
        """
        known = {"ratio": ratio, "stiffness": stiffness, "rated_torque": rated_torque, **others}
        torques, (k, *_) = cls(**known).pieces
        _check(lost_motion=lost_motion, backlash=backlash, hysteresis_loss=hysteresis_loss, q=q, stiffness=k)
        test, wound = q * rated_torque, 2 * q * rated_torque / k
        if (backlash is None) == (lost_motion is None):
            raise ClearanceError("Give one of `lost_motion` and `backlash`.").about("lost_motion", lost_motion)
        if lost_motion is not None and lost_motion < wound * (1 - 1e-9):
            allowed, fix = f"at least the wind-up 2 q T_N / k, {_angle(wound)}", "Is k that of small torques?"
            raise wrong_value("`lost_motion`", allowed, lost_motion, _angle(lost_motion), fix)
        gap = max(lost_motion - wound, 0.0) if backlash is None else backlash
        loop = gap if hysteresis_loss is None else hysteresis_loss
        if lost_motion is not None and hysteresis_loss is not None and loop >= lost_motion:
            text = "Friction hides the gap, as `hysteresis_loss` is not below the lost motion: any gap from 0 to"
            text += f" {_angle(loop - wound)} agrees with the sheet. Give the `backlash` instead of the lost motion."
            raise ClearanceError(text).about("hysteresis_loss", loop, loop - wound)
        if loop < gap:
            raise wrong_value("`hysteresis_loss`", f"at least the gap, {_angle(gap)}", loop, _angle(loop))
        friction = (loop - gap) * k / 2
        if torques and test + friction > torques[0]:
            raise wrong_value("`stiffness`", "such that the test and friction stay in its first piece", stiffness)
        return cls(backlash=gap, friction_torque=None if hysteresis_loss is None else friction, **known)

    def compliance(self, damping: Plain, *, driven: bool = True, friction_speed: Plain = 0.01) -> Compliance:
        """The drive of a joint with this reducer, for `with_compliance`: stiffness, backlash, friction at the link, and
        an error once in a turn of the motor, and its loss: a motor that drives its load delivers the share `efficiency`
        of its power.

        **Arguments:** `damping` [N m s/rad] at the link, which no data sheet has; `driven`: whether a drive prescribes
        the motor, else the rotor's inertia is that of an actuated one; `friction_speed` [rad/s]: at which friction
        and the loss in the gear turn round.

        **Raises:** `ClearanceError` for a rigid reducer, one whose stiffness is not known under large torques, an
        actuated motor without a rotor, and an efficiency of at most 0.5.
        """
        torques, stiffnesses = self.pieces
        if math.isinf(stiffnesses[0]):
            raise ClearanceError("A rigid reducer does not give way. Give its `stiffness`.").about("stiffness")
        if len(torques) == len(stiffnesses):
            text = f"The stiffness is known up to {torques[-1]:.6g} N m only. Add the one beyond, from the sheet."
            raise ClearanceError(text).about("stiffness", None, torques[-1])
        if not driven and self.rotor_inertia is None:
            raise ClearanceError("The motor is moved by actuators: give `rotor_inertia`.").about("rotor_inertia")
        numbers: dict[str, Any] = {"stiffness": stiffnesses[0]}
        if torques:
            numbers = {"stiffness": jnp.asarray(stiffnesses, float), "efforts": jnp.asarray(torques, float)}
        if self.friction_torque:
            numbers["friction"] = JointFriction(self.friction_torque, friction_speed)
        if self.transmission_error:
            numbers |= {"error": self.transmission_error, "error_order": abs(self.ratio)}
        if self.efficiency is not None and self.efficiency < 1:
            # The loss of a drive is a share of the effort that it passes on, that of a sheet a share of what goes in.
            efficiency = 2 - 1 / self.efficiency
            if efficiency <= 0:
                fix = "A gear with more loss locks itself, which drives do not do here. Leave its `efficiency` out."
                raise wrong_value("`efficiency`", "above 0.5 for a drive", self.efficiency, fix=fix)
            numbers |= {"efficiency": efficiency, "efficiency_speed": friction_speed}
        if not driven and self.rotor_inertia is not None:
            numbers["rotor_inertia"] = self.ratio**2 * self.rotor_inertia
        return Compliance(damping=damping, backlash=self.backlash or None, **numbers)

    @classmethod
    def harmonic(cls, size: int, ratio: int) -> "Reducer":
        """A harmonic drive CSF or CSG by its catalogue: its stiffness, no backlash, and half of its positioning
        accuracy as transmission error. Of the ratio 50 nothing is known beyond the torque T2.

        **Arguments:** `size` (8, 11, 14, ...); `ratio`: 30 (up to the size 32) or 50 (up to 100). **Raises:**
        `ClearanceError` for others: their tables are not known here.
        """
        known = {(s, r): (row[0], row[column]) for s, row in HARMONIC.items() for r, column in ((30, 1), (50, 2))}
        torques, stiffnesses = known.get((size, ratio), ((), ()))
        if not stiffnesses:
            text = f"`size` {size} with the ratio {ratio} is in no table here: known are the ratios 30 (sizes 8 to 32)"
            raise ClearanceError(f"{text} and 50 (8 to 100). Give the numbers of its sheet.").about("size", size)
        accuracy = (2.0, 1.5)[size > 14] if ratio == 30 else (2.0, 1.5, 1.0)[(size > 8) + (size > 17)]  # [arcmin]
        stiffness = torques, tuple(1e4 * k for k in stiffnesses)
        return cls(ratio=ratio, stiffness=stiffness, transmission_error=accuracy / 2 * ARC_MINUTE)

    @classmethod
    def series(cls, stages: Sequence["Reducer"]) -> "Reducer":
        """One reducer for `stages` in a row, from the motor to the link, without the effect of losses.

        With n_i, the speed of the output of stage i over that of the link, b = sum b_i / |n_i| and 1 / K = sum 1 / (k_i
        n_i^2): the last stage matters most. Friction adds up, and so do errors, at worst. The weakest rated torque
        counts. The rotor is that of the first stage. What one stage does not say is not said of all.
        """
        if not stages:
            raise ClearanceError("A reducer has at least one of `stages`.")
        turns = [abs(math.prod((s.ratio for s in stages[i + 1 :]), start=1.0)) for i in range(len(stages))]

        def total(combine: Any, name: str, power: int) -> Any:
            values = [getattr(stage, name) for stage in stages]
            return None if None in values else combine(v * n**power for v, n in zip(values, turns, strict=True))

        return cls(
            ratio=math.prod(stage.ratio for stage in stages), rotor_inertia=stages[0].rotor_inertia,
            stiffness=_in_series([stage.pieces for stage in stages], turns), backlash=total(sum, "backlash", -1),
            friction_torque=total(sum, "friction_torque", 1), rated_torque=total(min, "rated_torque", 1),
            efficiency=total(math.prod, "efficiency", 0), transmission_error=total(sum, "transmission_error", -1),
        )  # fmt: skip


def _in_series(pieces: Sequence[StiffnessPieces], turns: Sequence[float]) -> Any:
    """The stiffness of springs in a row, each behind a gear that makes so many turns in one of the link."""
    seen = [([t * n for t in p.torques], [k * n**2 for k in p.stiffnesses]) for p, n in zip(pieces, turns, strict=True)]
    end = min((torques[-1] for torques, k in seen if len(torques) == len(k)), default=math.inf)
    breaks = sorted({t for torques, _ in seen for t in torques if t <= end})
    starts = [0.0, *breaks][: len(breaks) + math.isinf(end)]
    soft = [sum(1 / k[bisect.bisect_right(torques, start)] for torques, k in seen) for start in starts]
    stiff = tuple(1 / s if s else math.inf for s in soft)
    return (tuple(breaks), stiff) if breaks else stiff[0]


def _check(**values: Any) -> None:
    """Raise, naming it, for a number out of its bounds. `None` passes."""
    for name, value in values.items():
        least = name in ("backlash", "friction_torque", "transmission_error", "hysteresis_loss")
        words = {"ratio": "other than 0", "efficiency": "above 0 and at most 1"}
        size = float(value) if isinstance(value, numbers.Real) else math.nan
        inside = (size > 0 or (size == 0 and least) or (size < 0 and name == "ratio")) and math.isfinite(size)
        if (value is not None or name == "ratio") and not (inside and (size <= 1 or name != "efficiency")):
            allowed = words.get(name, "of at least 0" if least else "above 0")
            raise wrong_value(f"`{name}`", f"a number {allowed}, in SI units", value)


def _angle(size: float) -> str:
    return f"{size:.6g} rad ({size / ARC_MINUTE:.4g} arcmin)"
