"""How far a quasi-static motion can be believed: `python -m experiments.quasi_static` writes out/quasi_static.md.

`fidelity="quasi-static"` is compared with the dynamics from a settled start, in random cases of five mechanisms: the
loaded slider-crank, joint 5 in the plane, the tool changer, the arm of six axes with three sleeves, and an arm of the
UR5's layout with three sleeves (built from the lengths and masses that are published with its Denavit-Hartenberg
parameters, not a model of that product). Clearances (5 to 300 um), loads and payloads, speeds and times of moves,
postures and friction are random. A move is a quintic or a trapezoid, at random. Every second case has dampers of random
size in its play. The dynamics have rtol 1e-6 (the UR5's layout 1e-5).

- *Ratio*: the peak of the end point's position error in the poses, divided by that in the dynamics, after the first
  tenth of the motion.
- *Gap*: the 95th percentile over time (after the same tenth, 181 samples) of the distance between the two error
  vectors, divided by the peak in the dynamics.
- *Ringing*: the ringing that `solution.validity` estimates, divided by the largest error of the poses. The word is
  *follows* up to the first threshold (`SMALL`), *peak only* up to the second (`LARGE`), and *not valid* beyond.

The words must meet these requirements. *Follows*: at least 20 % of the cases, and the gap of each is at most 15 %.
*Peak only*: the ratio of each case is within 25 % of 1, and that of half of the cases within 10 %. *Not valid*: at most
30 % of the cases.

The cases of one random seed calibrate the two thresholds. The cases of another seed check them. The measured values of
a mechanism are kept in out/quasi_static_NAME.npz, and a later run of the same cases reads them.
"""

from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax.solve.validity import LARGE, SMALL, WORDS, bends
from experiments.common import output, table
from experiments.publish import command, say
from experiments.quasi_static_cases import MECHANISMS, Case, cases, stacked

CALIBRATION, CHECK = 1, 2
EACH = {name: 20 if "UR5" in name else 26 for name in MECHANISMS}
RTOL = {name: 1e-5 if "UR5" in name else 1e-6 for name in MECHANISMS}
# Samples of poses and of dynamics; lanes that are solved together.
GRID, FINE, CHUNK = 201, 801, 8
# The part of a motion that does not count; what is asked of gap and ratio.
FIRST, GAP, RATIO = 0.1, 0.15, 0.25
TRIED = ((SMALL, 0.4), (SMALL, LARGE), (SMALL, 0.8), (SMALL, 1.0), (0.2, LARGE))


class Row(NamedTuple):
    """A case, and what was found of it; the set that it belongs to."""

    name: str
    seed: int
    said: str
    damped: bool
    ratio: float
    gap: float
    ringing: float
    periods: float
    ended: bool

    def word(self, small: float = SMALL, large: float = LARGE) -> str:
        """The flag by two thresholds."""
        return WORDS[0 if self.ringing <= small else 1 if self.ringing <= large else 2]


def measured(name: str, made: list[Case]) -> dict[str, np.ndarray]:
    """Position errors of the end point by poses and by dynamics, and the lowest frequency of the poses."""
    point = MECHANISMS[name][1]

    def of(lane):
        mechanism, end = lane
        without = mechanism.ideal()
        poses = cj.simulate(mechanism, end, save_at=GRID, fidelity="quasi-static", throw=False)
        ideal = cj.simulate(without, end, save_at=FINE, rtol=1e-10, throw=False)[f"{point}.position"]
        motion = cj.simulate(mechanism, end, save_at=FINE, rtol=RTOL[name], start="settled", throw=False)
        return {
            "poses": poses[f"{point}.position"] - ideal[:: (FINE - 1) // (GRID - 1)],
            "dynamics": motion[f"{point}.position"] - ideal,
            "frequency": poses.frequencies,
            "code": jnp.maximum(motion.code, poses.code),
        }

    return cj.batch(of, stacked(made), chunk=CHUNK)


def kept(name: str, made: list[Case]) -> dict[str, np.ndarray]:
    """The same, from what an earlier run of these cases has kept."""
    path, said = _file(name), [case.said for case in made]
    if path.exists():
        with np.load(path) as found:
            if list(found["said"]) == said and float(found["rtol"]) == RTOL[name]:
                return {key: found[key] for key in found.files}
    found = measured(name, made)
    np.savez(path, said=said, rtol=RTOL[name], **found)
    return found


def _file(name: str) -> Path:
    return output(f"quasi_static_{'_'.join(name.replace(chr(39), '').split())}.npz")


def rows_of(name: str, each: int) -> list[Row]:
    """All cases of a mechanism, of both seeds."""
    made = {seed: cases(name, each, seed) for seed in (CALIBRATION, CHECK)}
    found = kept(name, [case for own in made.values() for case in own])
    listed = [(seed, case) for seed, own in made.items() for case in own]
    return [_row(name, seed, case, {key: found[key][i] for key in KEYS}) for i, (seed, case) in enumerate(listed)]


KEYS = ("poses", "dynamics", "frequency", "code")


def _row(name: str, seed: int, case: Case, found: dict[str, np.ndarray]) -> Row:
    poses, motion = found["poses"], found["dynamics"]
    late = [int(FIRST * (count - 1)) for count in (GRID, FINE)]
    by_poses = np.linalg.norm(poses, axis=1)
    peak = np.linalg.norm(motion, axis=1)[late[1] :].max()
    gap = np.linalg.norm(motion[:: (FINE - 1) // (GRID - 1)] - poses, axis=1)[late[0] :]
    times = np.linspace(0.0, case.end, GRID)
    bend = np.asarray(jax.jit(bends)(times, poses[:, None], found["frequency"]))
    return Row(
        name,
        seed,
        case.said,
        case.damped,
        by_poses[late[0] :].max() / peak,
        float(np.percentile(gap, 95)) / peak,
        bend.max() / by_poses.max(),
        found["frequency"].min() * case.end,
        int(found["code"]) == 0,
    )


HEAD = (
    "cases",
    "follows [%]",
    "gap, largest",
    "gap <= 15 % [%]",
    "peak only [%]",
    "off, median",
    "off, largest",
    "within 25 % [%]",
    "not valid [%]",
)


def line(rows: list[Row], small: float = SMALL, large: float = LARGE) -> tuple:
    """What the words are worth in some cases."""
    by = {word: [row for row in rows if row.word(small, large) == word] for word in WORDS}
    share = {word: f"{100 * len(own) / len(rows):.0f}" for word, own in by.items()}
    gaps = np.array([row.gap for row in by["follows"]])
    off = np.abs([row.ratio - 1 for row in by["peak only"]])
    followed = (f"{gaps.max():.2f}", f"{100 * np.mean(gaps <= GAP):.0f}") if gaps.size else ("", "")
    peaks = (
        (f"{np.median(off):.2f}", f"{off.max():.2f}", f"{100 * np.mean(off <= RATIO):.0f}") if off.size else ("",) * 3
    )
    return len(rows), share["follows"], *followed, share["peak only"], *peaks, share["not valid"]


def main(quick: bool = False) -> list[Row]:
    """Write the tables; returns all rows."""
    names = list(MECHANISMS)[1:2] if quick else list(MECHANISMS)
    rows = [row for name in names for row in rows_of(name, 3 if quick else EACH[name])]
    failed, rows = [row for row in rows if not row.ended], [row for row in rows if row.ended]
    lines = []
    for name in names:
        for damped in (False, True):
            own = [row for row in rows if row.name == name and row.damped == damped]
            lines += [(name, "damped" if damped else "undamped", *line(own))] if own else []
    for seed, word in ((CALIBRATION, "calibration"), (CHECK, "check")):
        lines.append((f"all, {word}", "", *line([row for row in rows if row.seed == seed])))
    lines.append(("all", "", *line(rows)))
    suffix = "_quick" if quick else ""
    say(f"Thresholds: {SMALL} and {LARGE}. {len(rows)} cases, {len(failed)} more did not reach their end.")
    table(("mechanism", "joints", *HEAD), lines, output(f"quasi_static{suffix}.md"))
    some = [row for row in rows if row.seed == CALIBRATION]
    tried = [(small, large, *line(some, small, large)) for small, large in TRIED]
    say("Other thresholds, on the cases that calibrate:")
    table(("follows up to", "peak only up to", *HEAD), tried, output(f"quasi_static_thresholds{suffix}.md"))
    wrong = [row for row in rows if broken(row)]
    say(f"{len(wrong)} cases do not hold what their word says:")
    for row in wrong:
        say(
            f"{row.name}, {row.word()}: gap {row.gap:.2f}, ratio {row.ratio:.2f}, ringing {row.ringing:.2f}, "
            f"{row.periods:.2g} periods; {row.said}"
        )
    return rows


def broken(row: Row) -> bool:
    """Whether a case does not hold what its word says."""
    follows, only = row.word() == "follows", row.word() == "peak only"
    return (follows and row.gap > GAP) or (only and abs(row.ratio - 1) > RATIO)


if __name__ == "__main__":
    command(main, __doc__, quick="joint 5 alone, three cases of each seed")
