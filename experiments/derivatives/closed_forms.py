"""Derivatives whose exact value is known, in three cases: a trap for error control, two balls, and the times of events.
`python -m experiments.derivatives closed_forms` compares those of the library with the plain ones.

"Plain" is the derivative of the program: forward mode through the same solver, whose steps are chosen for the motion
alone and whose event times do not depend on the parameters.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import gamma

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.solve.settings import CONTROLLED, SCREENING
from experiments.common import output, table
from experiments.publish import say

LOOSE, TIGHT = 1e-6, 1e-10
LIMIT = 1e-8
RIGID_LIMIT = 1e-3
SOLVER = "dopri8"


class Row(NamedTuple):
    """One derivative: exact, ours, and the plain one (NaN: not computed)."""

    case: str
    by: str
    rtol: float
    exact: float
    ours: float
    plain: float

    @property
    def error(self) -> float:
        """Of ours, over the exact one's size or (where that is smaller) one."""
        return abs(self.ours - self.exact) / max(1.0, abs(self.exact))

    @property
    def plain_error(self) -> float:
        return abs(self.plain - self.exact) / max(1.0, abs(self.exact))


def final(mechanism, t1, rtol, y0=None, rule: str = "controlled"):
    """The state at the end."""
    s = cj.simulate(mechanism, t1, rtol=rtol, solver=SOLVER, energy_balance=False, y0=y0, throw=False, derivatives=rule)
    return s.final


def rows(case: str, end: Callable[..., Any], at, exact: dict[str, float], rtols, plain: bool) -> list[Row]:
    """Derivatives of `end(values, rtol, rule)` at `at`, one for every entry of `exact`."""
    rules = (CONTROLLED, SCREENING) if plain else (CONTROLLED,)
    both = [jax.jit(jax.jacfwd(lambda v, r, rule=rule: end(v, r, rule))) for rule in rules]
    out = []
    for rtol in rtols:
        found = [np.asarray(f(jnp.asarray(at, float), jnp.asarray(rtol))) for f in both]
        seconds = found[1] if plain else np.full(len(exact), np.nan)
        out += [
            Row(case, by, rtol, value, float(a), float(b))
            for (by, value), a, b in zip(exact.items(), found[0], seconds, strict=True)
        ]
    return out


# The trap of arXiv:2406.09699 ----------------------------------------------------------------------------------------

FREQUENCY, TRAP_END, REST = 3.0, 2.0, 0.25


def oscillator() -> cj.Mechanism:
    """A body of 1 kg on a spring, started at rest where the spring pulls nothing: no error estimate, no small steps."""
    spring = cj.actuators.JointSpring(FREQUENCY**2, 0.0, REST)
    motion = cj.Motion(position=REST, actuators=(spring,))
    return cj.Mechanism(bodies=(cj.Body("bob", 1.0),), joints=(cj.Prismatic("slide", "ground", "bob", motion=motion),))


def trap(rtols, plain: bool) -> list[Row]:
    mechanism = oscillator()
    names = ("slide.0.rest", "slide.position", "slide.0.stiffness")

    def end(values, rtol, rule):
        return final(cj.replace(mechanism, dict(zip(names, values, strict=True))), TRAP_END, rtol, rule=rule)[0]

    swing = np.cos(FREQUENCY * TRAP_END)
    exact = {"rest": 1 - swing, "start": swing, "stiffness": 0.0}
    return rows("trap", end, [REST, REST, FREQUENCY**2], exact, rtols, plain)


# Two balls -----------------------------------------------------------------------------------------------------------

REACH, BALL_END, STEEL = 1.0, 1.0, 1e10
"""Distance of the centres at touch [m], end [s], and the stiffness [N/m^1.5] of two steel surfaces."""
FLIGHT = 0.9
BALLS = (0.0, FLIGHT - REACH, 1.0, 0.0)
"""Positions [m] and velocities [m/s] of the hitting and of the hit ball, which touch after FLIGHT (in metres and in
seconds). In contact dv/dx grows to some v/Tc = 4000/s and comes back to nothing; what is left of it, by the tolerance
or by round-off of the distance (1e-16 m against a depth of 1e-4 m), acts for the time of flight that follows.
"""


def balls() -> cj.Mechanism:
    """Two bodies of 1 kg on one line; what touches are a sleeve and a pin with a clearance of `REACH`."""
    joint = cj.RevoluteClearance(REACH, 2.0, laws.Hertz(STEEL))
    return cj.Mechanism(
        bodies=(cj.Body("one", 1.0), cj.Body("two", 1.0)),
        joints=(cj.Prismatic("slide1", "ground", "one"), cj.Prismatic("slide2", "ground", "two")),
        loops=(cj.Revolute("bump", "one", "two", clearance=joint),),
        assemble=False,
    )


def impact_duration(speed: float, mass: float, stiffness: float) -> float:
    """How long a Hertz impact lasts: m v^2/2 = 2/5 K d^(5/2) gives the depth, and a quarter of the motion from there
    the integral of du/sqrt(1 - u^(5/2)) over [0, 1].
    """
    depth = (5 * mass * speed**2 / (4 * stiffness)) ** 0.4
    return 2 * depth / speed * np.sqrt(np.pi) * gamma(1.4) / gamma(0.9)


def two_balls(rtols, plain: bool) -> list[Row]:
    """The place of the hit ball: x1 - c + v1 T - v Tc/2, with v = v1 - v2 and Tc ~ v^(-1/5) K^(-2/5).

    (The centre of mass moves evenly, the speeds swap, and when they part the balls are as far apart as at the touch.)
    """
    mechanism = balls()

    def end(values, rtol, rule):
        m = cj.replace(mechanism, {"bump.normal.stiffness": values[4]})
        return final(m, BALL_END, rtol, y0=values[:4], rule=rule)[1]

    speed = BALLS[2] - BALLS[3]
    lasts = impact_duration(speed, 0.5, STEEL)
    exact = {"x1": 1.0, "x2": 0.0, "v1": BALL_END - 0.4 * lasts, "v2": 0.4 * lasts, "K": 0.2 * speed * lasts / STEEL}
    # By K times K, like every other row a number that can be compared with one.
    found = rows("two balls", end, [*BALLS, STEEL], exact, rtols, plain)
    scaled = [
        r._replace(by="ln K", exact=STEEL * r.exact, ours=STEEL * r.ours, plain=STEEL * r.plain) if r.by == "K" else r
        for r in found
    ]
    return scaled


def rigid_distance(found: list[Row]) -> float:
    """How far the tightest derivatives by x1, x2, v1, v2 are from those of rigid balls, (1, 0, T, 0)."""
    tight = min(r.rtol for r in found)
    mine = {r.by: r.ours for r in found if r.rtol == tight}
    return max(abs(mine[by] - value) for by, value in {"x1": 1.0, "x2": 0.0, "v1": BALL_END, "v2": 0.0}.items())


# Times of switching --------------------------------------------------------------------------------------------------

BEGIN, STOP, RISE = (0.2, 0.7), (0.5, 1.0), (0.3, -0.2)
MEETING = (0.2, 0.5), (0.5, 1.0)
"""The second step begins where the first ends: two breaks at one time."""
TIMING_END = 1.3


def shaken(begin, stop) -> cj.Mechanism:
    """A body on a spring on a carriage that a sum of two STEPs moves."""
    drive = cj.drives.StepSum(list(begin), list(stop), list(RISE))
    spring = cj.actuators.JointSpring(FREQUENCY**2)
    return cj.Mechanism(
        bodies=(cj.Body("carriage"), cj.Body("bob", 1.0)),
        joints=(
            cj.Prismatic("rail", "ground", "carriage", motion=cj.Motion(drive)),
            cj.Prismatic("slide", "carriage", "bob", motion=cj.Motion(actuators=(spring,))),
        ),
    )


def shaken_exactly(values):
    """The body's place on the carriage: -1/w times the integral of a(t) sin(w (T - t)), each STEP's a a line in t."""
    w, place = FREQUENCY, 0.0
    for begin, stop, rise in zip(values[:2], values[2:4], RISE, strict=True):
        span = stop - begin

        def primitive(t, begin=begin, span=span, rise=rise):
            a, slope = rise * (6 - 12 * (t - begin) / span) / span**2, -12 * rise / span**3
            return a * jnp.cos(w * (TIMING_END - t)) / w + slope * jnp.sin(w * (TIMING_END - t)) / w**2

        place -= (primitive(stop) - primitive(begin)) / w
    return place


def timing(rtols, plain: bool) -> list[Row]:
    out = []
    mechanism = shaken(BEGIN, STOP)

    def end(values, rtol, rule):
        moved = cj.replace(mechanism, {"drive.rail.begin": values[:2], "drive.rail.end": values[2:]})
        return final(moved, TIMING_END, rtol, rule=rule)[0]

    for case, times in (("times apart", (BEGIN, STOP)), ("times that meet", MEETING)):
        at = jnp.asarray([*times[0], *times[1]])
        exact = [float(x) for x in jax.grad(shaken_exactly)(at)]
        names = ("begin.0", "begin.1", "end.0", "end.1")
        out += rows(case, end, at, dict(zip(names, exact, strict=True)), rtols, plain)
    return out


def measure(quick: bool) -> list[Row]:
    rtols = (TIGHT,) if quick else (LOOSE, TIGHT)
    return [*trap(rtols, not quick), *two_balls(rtols, not quick), *timing(rtols, not quick)]


def main(quick: bool = False) -> list[Row]:
    found = measure(quick)
    suffix = "_quick" if quick else ""
    table(
        ("case", "by", "rtol", "exact", "error", "plain", "its error"),
        [
            (
                r.case,
                r.by,
                f"{r.rtol:.0e}",
                f"{r.exact:.6g}",
                f"{r.error:.1e}",
                f"{r.plain:.6g}",
                f"{r.plain_error:.1e}",
            )
            for r in found
        ],
        output(f"derivatives_closed_forms{suffix}.md"),
    )
    worst = {
        case: max(r.error for r in found if r.case == case and r.rtol == TIGHT) for case in {r.case for r in found}
    }
    for case, error in sorted(worst.items()):
        say(f"{case}: worst error {error:.1e}, required {LIMIT:.0e}: {'yes' if error <= LIMIT else 'NO'}")
    apart = rigid_distance([r for r in found if r.case == "two balls"])
    verdict = "yes" if apart <= RIGID_LIMIT else "NO"
    say(f"two balls against rigid ones: {apart:.1e}, required {RIGID_LIMIT:.0e}: {verdict}")
    return found
