"""Cases that are difficult for contact solvers: `python -m experiments.hard` writes out/hard.md.

Every case is solved at three tolerances (1e-6, 1e-8 and 1e-10 where the remark names no others; Dopri8 below 1e-8,
Tsit5 else). The error is that of the worst state over all saved times, relative to the largest magnitude of this state.
References share no code with the library: hand-written equations of motion, solved with every switching located, or
closed forms. "own" marks those that are the library's solve at a thousandth of the tolerance.

A case passes if at each of its tolerances

- the solve reaches its end with finite states,
- the error is at most 3000 rtol; or 10 A rtol, if that is more. A says by how much the scene amplifies a small change
  of its start (in units of the clearance and of the speed of the machine), measured on the reference. A scene with A
  above 1e7 is chaotic: its states are not compared;
- the residual of the energy balance is at most 10 rtol (or 1e-12),
- the further conditions in its remark hold.

"Steps" are those at the middle tolerance, "energy" is the residual at the tightest. What a case breaks stands in its
last column.
"""

from collections.abc import Sequence

from experiments.common import output, table
from experiments.hard import arms, crank, pin, rubbing, several, space
from experiments.hard.case import RTOLS, Row
from experiments.publish import command, say

CASES = (*crank.CASES, *pin.CASES, *rubbing.CASES, *several.CASES, *space.CASES, *arms.CASES)


def main(quick: bool = False, cases: Sequence = CASES) -> list[Row]:
    rows: list[Row] = []
    head = ("case", "states", "steps", *(f"error {k}" for k in (1, 2, 3)), "energy", "result", "passed", "remark")
    try:
        for case in cases:
            rows.append(case(quick))
            print(f"{rows[-1].case}: {rows[-1].errors}, {rows[-1].broken or 'passed'}", flush=True)
    finally:  # a case that raises, or an interruption, costs no other one
        table(head, [cells(row) for row in rows], output(f"hard{'_quick' if quick else ''}.md"))
        say(summary(rows))
    return rows


def cells(row: Row) -> list[str]:
    at = "" if row.rtols == RTOLS else f"rtol {', '.join(f'{rtol:g}' for rtol in row.rtols)}; "
    passed = "NOT PASSED: " + "; ".join(row.broken) if row.broken else "yes"
    errors = [f"{e:.1e}" for e in row.errors]
    return [
        row.case,
        str(row.states),
        str(row.steps),
        *errors,
        f"{row.energy:.1e}",
        row.result,
        passed,
        at + row.remark,
    ]


def summary(rows: Sequence[Row]) -> str:
    """How many pass, and where the error does not fall with the tolerance."""
    regular = [row for row in rows if not row.chaotic]
    stays = [row.case for row in regular if not row.falls]
    falls = f"The error falls with rtol in {len(regular) - len(stays)} of the {len(regular)} that are not chaotic"
    return (
        f"{sum(not row.broken for row in rows)} of {len(rows)} cases pass. {falls}"
        f"{'; not in: ' + ', '.join(stays) if stays else ''}.\n"
        f"Chaotic: {', '.join(row.case for row in rows if row.chaotic) or 'none'}. "
        f"Processor time: {sum(row.seconds for row in rows):.0f} s of solves."
    )


if __name__ == "__main__":
    command(main, __doc__)
