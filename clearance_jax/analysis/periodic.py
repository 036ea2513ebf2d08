"""`periodic_motion`: the limit cycle of a periodically driven mechanism, its multipliers and its derivative."""

from typing import Any, Unpack

import jax.numpy as jnp
from jax.core import Tracer

from clearance_jax.analysis.cycle import PeriodicMotion, find
from clearance_jax.analysis.period_map import SEAM, CycleOptions, CycleSearch, seams
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism._base import sampling_periods
from clearance_jax.mechanism.actuators import Servo
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.motion.drives import Constant
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.settings import SolveOptions, settings_of

KNOWN = ("t0", "rtol", "solver", "max_steps")


def periodic_motion(
    mechanism: Mechanism,
    period: Any,
    *,
    guess: Any = None,
    settle: int = 10,
    turns: Any = None,
    max_iterations: int = 40,
    free_period: bool = False,
    **options: Unpack[SolveOptions],
) -> PeriodicMotion:
    """The motion that repeats after `period`, or with `free_period` one that nothing drives, whose own period is near
    `period`: the limit cycle of a servo with backlash, say. It works under jit and vmap. `y` and, if it is free, the
    period of the result also have derivatives (jvp, jacfwd, grad) by every number of the mechanism; `y` has one by a
    given `period`.

    A search that fails raises nothing: see `converged` and `message` of the result (the derivative is then NaN). The
    motion that is found may be unstable: see `stable`. It is assumed that the drives repeat what they do from t0 to t0
    + period. If you vary the speed of a drive, vary `period` along with it: otherwise the derivative is that of a drive
    that jumps.

    **Arguments:**

    - `mechanism`: what moves.
    - `period` [s]: a whole multiple of every drive's period; with `free_period` a first guess, within a fifth or so.
    - `guess`: a state [q, v, memory] from which to start, shape (n,); `None`: the mechanism's initial one.
    - `settle`: how many periods are simulated before Newton's method starts, and again wherever it does not lower the
      residual.
    - `turns`: whole turns of each free coordinate in a period, shape (free,); `None`: as the simulated motion has them.
    - `free_period`: whether the period is looked for. Nothing may depend on time then: drives and targets are constant.
    - `max_iterations`: most Newton steps and phases of settling.
    - `options`: `simulate`'s `t0`, where the period starts [s]; `rtol` (1e-9), of the solves and of the fixed point;
      `solver`; `max_steps`, of a period.

    **Raises:** `ClearanceError` for what `simulate` raises it for, a mechanism without free coordinates, a drive that
    is not back at its start (whole turns aside) after the period, and a law of class C-1, which has no true derivative.
    """
    settings = settings_of(mechanism, options.get("t0", 0.0) + period, options, KNOWN, rtol=1e-9, max_steps=100_000)
    plan = layout(mechanism)
    if not plan.free:
        raise ClearanceError("A periodic motion needs a free coordinate, but every joint of this mechanism is driven.")
    if mechanism.controllers or mechanism.has_payloads or sampling_periods(mechanism):
        raise ClearanceError(
            "A periodic motion is not looked for with controllers, digital servos or payloads that come and go. Take "
            "them away, or simulate for long."
        )
    if free_period:
        _refuse_courses(mechanism)
    guess, turns = (None if x is None else jnp.asarray(x, float) for x in (guess, turns))
    for name, given, size in (("guess", guess, plan.size), ("turns", turns, plan.free)):
        if given is not None and given.shape != (size,):
            raise ClearanceError(f"`{name}` must have shape ({size},), but it has {given.shape}.")
    t0, period = settings.t0, jnp.asarray(period, float)
    for name, gap in seams(mechanism, t0, period).items():
        if not isinstance(gap, Tracer) and not float(gap) <= SEAM:
            raise ClearanceError(
                f"The drive of `{name}` does not repeat after the period of {float(period):g} s: it misses its start "
                f"by {float(gap):.2g} (radians or largest lengths). Give the drives' common period, to full precision."
            ).about(name, float(period))
    search = CycleSearch(mechanism, t0, period, settings.rtol, guess, turns)
    return find(search, CycleOptions(settings.compiled_in(), settle, max_iterations, free_period))


def _refuse_courses(mechanism: Mechanism) -> None:
    """Raise for what moves by itself in time: a cycle with a period of its own has no place for it."""
    courses = [(wrench.name, wrench.course) for wrench in mechanism.wrenches]
    for c in mechanism.coordinates():
        courses.append((c.name, c.motion.drive))
        courses += [(c.name, actuator.target) for actuator in c.motion.actuators if isinstance(actuator, Servo)]
    moving = [name for name, law in courses if law is not None and not isinstance(law, Constant)]
    if moving:
        text = f"`{moving[0]}` moves in time, so the motion has the period of its drives. Leave `free_period` out."
        raise ClearanceError(text).about("free_period", True)
