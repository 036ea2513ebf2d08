"""Steps of laws with memory, per touch: `python -m experiments.memory` writes a table for each joint to out/.

One body falls and bounces in the play of one joint: a pin in the plane, a block in its guide, a pin in a long sleeve
and a ball in its socket, each as a joint of the tree and as one that closes a loop. A law remembers the bend of its
bristles (LuGre, Dahl, elasto-plastic), the flow of its wall (standard linear solid) or the speed of the last impact
(exact restitution). "Without" is the wall of the bristles without friction. The bristles are short, so that a step of
contact is limited by how fast they give way: most of a motion's steps are those, and not those of its touches.

A bristle bends while its point has touched, by what the start of a step latched. "By penetration": the same where it
bends while the penetration is positive. Its rate jumps then inside every step across a touch, before that is cut. "Off"
is how far the end of the motion is from that of the same law by what was latched (in m, rad, m/s and rad/s).
"""

from collections.abc import Callable
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.dynamics.kinematics import relative_motions
from clearance_jax.laws._friction import AbstractFrictionLaw, AbstractModifiedFriction
from clearance_jax.parameters import flatten
from experiments.common import output, table
from experiments.publish import command, write

RTOLS = (1e-6, 1e-9)
CLEARANCE, SIZE, LENGTH = 1e-4, 0.01, 0.04


class ByPenetration(AbstractModifiedFriction):
    """A friction law whose memory goes on while the surfaces press."""

    law: AbstractFrictionLaw = flatten()
    smoothness: ClassVar = "C0"
    acts_apart: ClassVar[bool] = True

    def traction(self, constants, slip, normal_force, memory):
        return self.law.traction(constants, slip, normal_force, memory)

    def memory_rate(self, constants, slip, normal_force, memory):
        rates = self.law.memory_rate(constants, slip, normal_force, memory)
        return jax.tree.map(lambda rate: jnp.where(normal_force > 0, rate, 0.0), rates)


def laws_of() -> dict[str, tuple]:
    """The normal law and the friction law of each row."""
    wall = laws.HuntCrossley(1e9, 0.5)
    bristles = {
        "LuGre": laws.LuGre(0.2, 0.15, 1e-3, 1e5, 10.0),
        "Dahl": laws.Dahl(0.2, 1e5),
        "elasto-plastic": laws.ElastoPlastic(0.2, 0.15, 1e-3, 1e5, 10.0),
    }
    return {
        "without": (wall, None),
        "exact restitution": (laws.exact_restitution(1e9, 0.7), None),
        "standard linear solid": (laws.StandardLinearSolid(1e7, 0.4, 5e-3), None),
        **{name: (wall, law) for name, law in bristles.items()},
        "Dahl, by penetration": (wall, ByPenetration(bristles["Dahl"])),
    }


# Joints --------------------------------------------------------------------------------------------------------------

END = 0.05


def spun() -> cj.Motion:
    return cj.Motion(velocity=20.0)


def pushed() -> cj.Motion:
    return cj.Motion(velocity=0.5)


def flying() -> cj.Ball:
    return cj.Ball(spin=cj.Spin(3.0, 5.0, 20.0))


def pin(*law) -> cj.Revolute:
    return cj.Revolute("j", "ground", "part", motion=spun(), clearance=cj.RevoluteClearance(CLEARANCE, SIZE, *law))


def guide(*law) -> cj.Prismatic:
    play = cj.GuideClearance(CLEARANCE, LENGTH, SIZE, *law)
    return cj.Prismatic("j", "ground", "part", motion=pushed(), clearance=play)


def sleeve(*law) -> cj.Revolute:
    play = cj.SleeveClearance(CLEARANCE, SIZE, LENGTH, *law, axial_clearance=CLEARANCE)
    return cj.Revolute("j", "ground", "part", motion=spun(), clearance=play)


def ball(*law) -> cj.Spherical:
    return cj.Spherical("j", "ground", "part", motion=flying(), clearance=cj.SphericalClearance(CLEARANCE, SIZE, *law))


class Case(NamedTuple):
    """A joint with play, its name `j`: in the tree, or closing a loop about a body that `floats` there; in the plane or
    in `space`.
    """

    joint: Callable
    floats: Callable | None = None
    space: bool = False

    def mechanism(self, *law) -> cj.Mechanism:
        body = cj.Body("part", 0.5, cj.Inertia(2e-3, 2e-3, 2e-3) if self.space else 2e-3)
        joint = self.joint(*law)
        tree, loops = ((joint,), ()) if self.floats is None else ((self.floats(),), (joint,))
        return cj.Mechanism((body,), tree, loops, gravity=cj.Gravity(0.2, -9.81))


CASES = {
    "pin, tree": Case(pin),
    "pin, loop": Case(pin, lambda: cj.Planar("float", "ground", "part", turn=spun())),
    "guide, tree": Case(guide),
    "guide, loop": Case(guide, lambda: cj.Planar("float", "ground", "part", slide_x=pushed())),
    "sleeve, tree": Case(sleeve, None, True),
    "sleeve, loop": Case(sleeve, lambda: cj.Free("float", "ground", "part", motion=flying()), True),
    "ball, tree": Case(ball, None, True),
    "ball, loop": Case(ball, lambda: cj.Free("float", "ground", "part", motion=flying()), True),
}
QUICK = ("pin, tree",)


# Measured ------------------------------------------------------------------------------------------------------------


class Row(NamedTuple):
    """Steps, rejections and touches of one motion, and its end."""

    case: str
    law: str
    rtol: float
    touches: int
    steps: int
    rejected: int
    end: np.ndarray

    @property
    def name(self) -> str:
        """The law without how its memory goes on."""
        return self.law.split(",")[0]


@jax.jit
def depths(times, states, mechanism):
    """The penetration at every contact point at every step end [m], shape (steps, points)."""

    def at(time, y):
        (seen,) = relative_motions(time, y, mechanism)
        return mechanism.clearance_joints()[0].clearance.depths(seen)[0]

    return jax.vmap(at)(times, states)


def row_of(case: str, law: str, rtol: float, end: float) -> Row:
    """One motion, its touches counted at its step ends."""
    mechanism = CASES[case].mechanism(*laws_of()[law])
    trace = cj.trace(mechanism, end, rtol=rtol, save_at=2)
    room = -len(trace.time) % 4096  # one program for all
    times, states = np.pad(trace.time, (0, room), "edge"), np.pad(trace.y, ((0, room), (0, 0)), "edge")
    touching = np.asarray(depths(times, states, mechanism.prepare())) > 0
    touches = int(np.sum(touching[1:] & ~touching[:-1]))
    found = trace.solution
    moving = 2 * len(mechanism.free_coordinates())
    return Row(case, law, rtol, touches, int(found.steps), int(found.rejected), np.asarray(found.final)[:moving])


def cells(row: Row, rows: list[Row]) -> tuple:
    """What the table says of a row: how far the end is from that of the same law by what was latched."""
    (latched,) = (r for r in rows if (r.law, r.rtol) == (row.name, row.rtol))
    away = "" if row is latched else f"{np.max(np.abs(row.end - latched.end)):.0e}"
    per_touch = row.rejected / max(row.touches, 1)
    return row.law, f"{row.rtol:g}", row.touches, row.steps, row.rejected, f"{per_touch:.1f}", away


def main(quick: bool = False) -> list[Row]:
    """Write a table for each joint; returns its rows."""
    names = ("without", "Dahl", "Dahl, by penetration") if quick else laws_of()
    end, rtols = (0.2 * END, RTOLS[:1]) if quick else (END, RTOLS)
    rows = []
    for case in QUICK if quick else CASES:
        write(f"## {case[0].upper()}{case[1:]}\n")
        here = [row_of(case, law, rtol, end) for law in names for rtol in rtols]
        head = ("law", "rtol", "touches", "steps", "rejected", "a touch", "off")
        told = output(f"memory_{case.replace(', ', '_')}{'_quick' if quick else ''}.md")
        table(head, [cells(row, here) for row in here], told)
        rows += here
    return rows


if __name__ == "__main__":
    command(main, __doc__, quick="a pin in the plane, one law of bristles")
