"""Impacts over decades of speeds, sizes and masses: `python -m experiments.impacts` writes out/impacts.md.

A pin flies from the middle of its sleeve to the wall and back, for every law and every combination of a speed
(2 mm/s to 20 m/s), a mass (1 g to 10 kg, which for an impact is a stiffness) and a radial clearance. Friction laws act
beside the wall of Hunt and Crossley on a pin that a drive turns by 20 rad/s. The derivative of the pin's last velocity
by its first one is compared with a difference over a ten thousandth of the speed, of motions at rtol 1e-10. In
brackets: how many of the fifteen impacts are not compared, since these motions do not reach their end, or since this
difference and one of ten times its length are more than 1 % apart.

A number is the largest error of the derivative over the speeds and masses, of the larger of the derivative and one.
During the touch the derivative grows to about the clearance over the penetration, and falls again: the error is
rtol times this number at least. "early" counts solves that end early, with their code's sentence; "refused": the
library refuses to differentiate the law (class C-1).
"""

import itertools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax import laws
from experiments.common import output, table
from experiments.contact_laws import FAMILY, K, friction_laws, other_laws
from experiments.publish import command

RTOL, TRUTH, CHANGES, APART = 1e-8, 1e-10, (1e-3, 1e-4), 1e-2
# From 1 mm/s down laws take the speed of an impact as this: a kink, at which there is no derivative.
SPEEDS, MASSES = (2e-3, 2e-2, 0.2, 2.0, 20.0), (1e-3, 0.14, 10.0)
CLEARANCES = (1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0)
QUICK = ("tsuji, 0.7", "dahl")


class Row(NamedTuple):
    """Of one law and one clearance: the largest error (`None`: refused), how many of the solves end early, and how many
    are not compared.
    """

    law: str
    clearance: float
    error: float | None
    early: int
    open: int

    @property
    def cell(self) -> str:
        if self.error is None:
            return "refused"
        said = [f"{self.error:.0e}", f"({self.open})" * bool(self.open), f"{self.early} early" * bool(self.early)]
        return " ".join(word for word in said if word)


def every_law() -> dict[str, tuple[Any, Any]]:
    """The normal law and the friction law by a name."""
    normal = {name: (make(K, 0.7), None) for name, make in FAMILY.items()}
    normal |= {name: (law, None) for name, law in other_laws().items()}
    wall = laws.HuntCrossley(K, 0.5)
    return normal | {name: (wall, law) for name, (law, _) in friction_laws().items()}


def impact(normal: Any, friction: Any) -> Any:
    """Velocity at the end, its derivative by that at the start, and the code, of (speed, mass, clearance, rtol);
    compiled once a law.
    """
    play = cj.RevoluteClearance(1e-3, 1e-2, normal, friction, length=1e-2)
    turned = cj.Motion(cj.drives.ConstantSpeed(0.0 if friction is None else 20.0))
    joint = cj.Revolute("j", "ground", "pin", motion=turned, clearance=play)
    pin, states = cj.Mechanism((cj.Body("pin", 1.0),), (joint,)), 4 + len(play.remembers)

    @jax.jit
    def flown(start, speed, mass, clearance, rtol):
        numbers = {"pin.mass": mass, "j.radial_clearance": clearance, "j.pin_radius": 10 * clearance}

        def last(v):
            y0, end = jnp.zeros(states).at[2].set(v), 1.5 * clearance / speed
            found = cj.simulate(cj.replace(pin, numbers), end, y0=y0, rtol=rtol, throw=False, energy_balance=False)
            return found.final[2:4], found.code

        return jax.jvp(last, (start,), (jnp.ones(()),))

    def found(start, *numbers):
        (velocity, code), (rate, _) = flown(*(jnp.asarray(x) for x in (start, *numbers)))
        return np.asarray(velocity), np.asarray(rate), int(code)

    return found


def row_of(law: str, clearance: float, flown: Any, speeds: tuple, masses: tuple) -> Row:
    """The worst of one clearance."""
    worst, early, unknown = 0.0, 0, 0
    for speed, mass in itertools.product(speeds, masses):
        _, rate, code = flown(speed, speed, mass, clearance, RTOL)
        early += code != 0
        wide, expected = (difference(flown, speed, mass, clearance, change) for change in CHANGES)
        size = max(1.0, float(np.max(np.abs(expected))))
        known = np.all(np.abs(wide - expected) <= APART * size)
        unknown += not known
        if known and code == 0:
            worst = max(worst, float(np.max(np.abs(rate - expected))) / size)
    return Row(law, clearance, worst, early, unknown)


def difference(flown: Any, speed: float, mass: float, clearance: float, change: float) -> np.ndarray:
    """The derivative by a central difference over a part of the speed; not a number where a motion ends early."""
    up, down = (flown(start * speed, speed, mass, clearance, TRUTH) for start in (1 + change, 1 - change))
    return (up[0] - down[0]) / (2 * change * speed) if up[2] == down[2] == 0 else np.full(2, np.nan)


def rows_of(law: str, quick: bool) -> list[Row]:
    """A law at every clearance."""
    normal, friction = every_law()[law]
    clearances = CLEARANCES[2:3] if quick else CLEARANCES
    if normal.smoothness == "C-1":
        return [Row(law, clearance, None, 0, 0) for clearance in clearances]
    flown = impact(normal, friction)
    some = (SPEEDS[3:4], MASSES[1:2]) if quick else (SPEEDS, MASSES)
    return [row_of(law, clearance, flown, *some) for clearance in clearances]


def main(quick: bool = False) -> list[Row]:
    """Write the table; returns its rows."""
    rows = []
    for law in QUICK if quick else every_law():
        rows.append(rows_of(law, quick))
        print(law, *(row.cell for row in rows[-1]), flush=True)
    head = ("law", *(f"{row.clearance:g} m" for row in rows[0]))
    table(head, [(own[0].law, *(row.cell for row in own)) for own in rows], output(f"impacts{'_quick' * quick}.md"))
    return [row for own in rows for row in own]


if __name__ == "__main__":
    command(main, __doc__, quick="two laws, one impact each")
