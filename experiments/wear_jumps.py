"""Jumps over cycles of wear against every cycle, with the motion solved anew on every worn profile.

A disc out of balance, 20 kg, swings on a pin that wears its sleeve: 2000 cycles, each a motion of its own, against
blocks that jump over most of them. Then the derivatives of the depths, and of the life until the sleeve is worn off by
so much: of 200 cycles that wear ten times as fast. Brute force is the march with jumps of one cycle: its derivatives
are those of all motions in a row, exact but for the solves' rtol; its life is read off its depths.

    python -m experiments.wear_jumps            `python -m experiments.wear_jumps --save` writes the page
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

import clearance_jax as cj
from clearance_jax import laws, wear
from experiments.common import table
from experiments.publish import command, write

CLEARANCE, PIN, LENGTH = 1e-4, 25e-3, 50e-3
COEFFICIENT, STIFFNESS = "2e-12 1/Pa", 2e12
SWING, PERIOD = 0.01, 0.05
"""Of the disc [rad], [s]: its centre's inertia is nearly its weight, so that the load goes from little to double."""
CYCLES, SECTORS, RTOL = 2000, 120, 1e-7
LIFE = 0.9
"""Life ends at this part of the largest depth."""
TOLERANCES = (1e-2, 2e-3)
BY = ("pin.radial_clearance", "gravity.y", "wear.coefficient")


class Jumped(NamedTuple):
    """A march with jumps against every cycle: errors over the largest value of every cycle's; of derivatives, the worst
    (`None`: not asked for).
    """

    tolerance: float
    evaluations: int
    profile: float
    life: float
    slopes: float | None
    life_slopes: float | None


def swing() -> cj.Mechanism:
    """A disc out of balance that is swung in its sleeve, with friction."""
    play = cj.RevoluteClearance(
        CLEARANCE, PIN, laws.HuntCrossley(1e10, 50.0), laws.CubicCoulomb(0.1, 1e-2), None, LENGTH
    )
    return cj.Mechanism(
        bodies=(cj.Body("disc", 20.0, 0.1, cj.Position(0.05)),),
        joints=(
            cj.Revolute(
                "pin",
                "ground",
                "disc",
                motion=cj.Motion(cj.Harmonic(SWING, 2 * np.pi / PERIOD)),
                clearance=play,
            ),
        ),
        gravity=cj.Gravity(y=-9.81),
    )


def lived(cycles: int, faster: float = 1.0, **how) -> wear.Life:
    law, pressure = wear.Archard(faster * float(wear.archard(COEFFICIENT).coefficient)), wear.Foundation(STIFFNESS)
    told = {"sectors": SECTORS, "rtol": RTOL, "start": "settled"} | how
    return wear.life(swing(), "pin", law, pressure, PERIOD, cycles, **told)


def ended(every: wear.Life, depth: float) -> tuple[float, np.ndarray | None]:
    """When every cycle's largest depth is so much, and its derivatives, straight from the depths."""
    block = int(np.argmax(every.depth.max(axis=1) >= depth))
    sector = int(every.depth[block].argmax())
    (n0, n1), (h0, h1) = every.cycles[block - 1 : block + 1], every.depth[block - 1 : block + 1, sector]
    share, grows = (depth - h0) / (h1 - h0), (h1 - h0) / (n1 - n0)
    if every.slopes is None:
        return n0 + share * (n1 - n0), None
    moved = (1 - share) * every.slopes[block - 1, :, sector] + share * every.slopes[block, :, sector]
    return n0 + share * (n1 - n0), -moved / grows


def compared(cycles: int, tolerances: tuple[float, ...], **how) -> list[Jumped]:
    """Marches of so many cycles with jumps, against every cycle."""
    every = lived(cycles, longest=1, **how)
    depth = LIFE * float(every.depth[-1].max())
    end, by = ended(every, depth)
    text = f"{cycles} cycles: {1e6 * every.depth[-1].max():.4f} µm deep, of {1e6 * CLEARANCE:g} µm of clearance. Life "
    text += f"until {1e6 * depth:.4f} µm: {end:.4f} cycles"
    for name, slope in zip(how.get("by", ()), () if by is None else by, strict=True):
        text += f"; by `{name}` {slope:.5g}"
    write(text + ".")
    rows = []
    for tolerance in tolerances:
        found = lived(cycles, tolerance=tolerance, **how)
        short = lived(cycles, tolerance=tolerance, until=wear.Deepest(depth), **how)
        assert short.end is not None
        slopes = last = None
        if by is not None:
            size = np.abs(every.slopes[-1]).max(axis=1)
            slopes = float((np.abs(found.slopes[-1] - every.slopes[-1]).max(axis=1) / size).max())
            last = float(np.abs(short.end_slopes / by - 1).max())
        off = float(np.abs(found.depth[-1] - every.depth[-1]).max() / every.depth[-1].max())
        rows.append(Jumped(tolerance, found.evaluations, off, abs(short.end / end - 1), slopes, last))
        print(rows[-1], flush=True)
    return rows


def main(quick: bool = False, out: Path = Path("out")) -> list[Jumped]:
    """Write the table into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    asked = {"faster": 10.0, "by": BY}
    if quick:
        return compared(6, TOLERANCES[:1])
    parts = [(CYCLES, compared(CYCLES, TOLERANCES)), (CYCLES // 10, compared(CYCLES // 10, TOLERANCES, **asked))]
    head = ("cycles", "tolerance", "solved", "work saved", "depth", "life", "derivatives of the depth", "of the life")
    shown = [
        (
            n,
            f"{r.tolerance:g}",
            r.evaluations,
            f"{n / r.evaluations:.1f}",
            *("" if x is None else f"{x:.1e}" for x in r[2:]),
        )
        for n, rows in parts
        for r in rows
    ]
    table(head, shown, out / "wear_jumps.md")
    return [row for _, rows in parts for row in rows]


if __name__ == "__main__":
    command(main, __doc__, "6 cycles, without derivatives")
