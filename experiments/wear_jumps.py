"""Jumps over cycles of wear, compared with the wear of every cycle: `python -m experiments.wear_jumps`.

An unbalanced disc of 20 kg swings on a pin that wears its sleeve, for 2000 cycles. The reference solves the motion of
every cycle on the worn profile (jumps of one cycle). The blocks of the library jump over most cycles. Three results are
compared: the depths, their derivatives, and the life until a given depth with its derivatives. The derivatives of the
reference are those of all motions in sequence, exact except for the rtol of the solves. Its life is read from its
depths.

A simulation with derivatives chooses its jumps such that the derivatives are accurate too. Errors of depths are divided
by the largest depth. Errors of derivatives of depths are divided by the largest derivative by the same parameter. They
are largest at the end of the patch, where sectors come into contact one after the other, so that the derivatives are
uneven. Errors of the life and its derivatives are relative to their own values.
"""

import warnings
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
TOLERANCES = (1e-2, 5e-3, 2e-3)
BY = ("pin.radial_clearance", "gravity.y", "wear.coefficient")


class Jumped(NamedTuple):
    """A march with jumps against every cycle: errors of the depths, the life, and the worst of the derivatives of
    either by a number (`None`: not asked for).
    """

    tolerance: float
    evaluations: int
    profile: float
    life: float
    slopes: float | None = None
    life_slopes: float | None = None


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
                motion=cj.Motion(cj.drives.Harmonic(SWING, 2 * np.pi / PERIOD)),
                clearance=play,
            ),
        ),
        gravity=cj.Gravity(y=-9.81),
    )


def lived(cycles: int, **how) -> wear.WearHistory:
    told = {"sectors": SECTORS, "rtol": RTOL, "start": "settled"} | how
    model = wear.WearModel(swing(), "pin", wear.archard(COEFFICIENT), wear.Foundation(STIFFNESS), PERIOD)
    with warnings.catch_warnings():
        # Jumps and every cycle have the same sectors, whose width is not what is measured here.
        warnings.simplefilter("ignore", wear.SectorsWarning)
        return wear.simulate_wear(model, cycles, **told)


def ended(every: wear.WearHistory, depth: float) -> tuple[float, np.ndarray | None]:
    """When every cycle's largest depth is so much, and its derivatives, straight from the depths."""
    block = int(np.argmax(every.depth.max(axis=1) >= depth))
    sector = int(every.depth[block].argmax())
    (n0, n1), (h0, h1) = every.cycles[block - 1 : block + 1], every.depth[block - 1 : block + 1, sector]
    share, grows = (depth - h0) / (h1 - h0), (h1 - h0) / (n1 - n0)
    if every.slopes is None:
        return n0 + share * (n1 - n0), None
    moved = (1 - share) * every.slopes[block - 1, :, sector] + share * every.slopes[block, :, sector]
    return n0 + share * (n1 - n0), -moved / grows


def compared(cycles: int, by: tuple[str, ...], tolerances: tuple[float, ...]) -> list[Jumped]:
    """Marches of so many cycles with jumps, without derivatives and with them, against every cycle."""
    every = lived(cycles, longest=1, by=by)
    depth = LIFE * float(every.depth[-1].max())
    end, slopes = ended(every, depth)
    text = f"{cycles} cycles: {1e6 * every.depth[-1].max():.4f} µm deep, of {1e6 * CLEARANCE:g} µm of clearance. Life "
    text += f"until {1e6 * depth:.4f} µm: {end:.4f} cycles"
    for name, slope in zip(by, () if slopes is None else slopes, strict=True):
        text += f"; by `{name}` {slope:.5g}"
    write(text + ".")
    rows = []
    for names in ((), by) if by else ((),):
        for tolerance in tolerances:
            found = lived(cycles, tolerance=tolerance, by=names)
            short = lived(cycles, tolerance=tolerance, by=names, until=wear.Deepest(depth))
            assert short.end is not None
            off = float(np.abs(found.depth[-1] - every.depth[-1]).max() / every.depth[-1].max())
            row = Jumped(tolerance, found.evaluations, off, abs(short.end / end - 1))
            if found.slopes is not None and every.slopes is not None and slopes is not None:
                size = np.abs(every.slopes[-1]).max(axis=1)
                worst = (np.abs(found.slopes[-1] - every.slopes[-1]).max(axis=1) / size).max()
                row = row._replace(slopes=float(worst), life_slopes=float(np.abs(short.end_slopes / slopes - 1).max()))
            rows.append(row)
            print(row, flush=True)
    return rows


def main(quick: bool = False, out: Path = Path("out")) -> list[Jumped]:
    """Write the table into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    if quick:
        return compared(8, (), TOLERANCES[:1])
    rows = compared(CYCLES, BY, TOLERANCES)
    head = ("tolerance", "solved", "work saved", "depth", "life", "derivatives of the depth", "of the life")
    shown = [
        (
            f"{r.tolerance:g}",
            r.evaluations,
            f"{CYCLES / r.evaluations:.1f}",
            *("" if x is None else f"{x:.1e}" for x in r[2:]),
        )
        for r in rows
    ]
    table(head, shown, out / "wear_jumps.md")
    return rows


if __name__ == "__main__":
    command(main, __doc__, "8 cycles, without derivatives")
