"""Derivatives of motions: `python -m experiments.derivatives` writes the tables out/derivatives_*.md.

ladder         error against tolerance, on the slider-crank, beside what other ways give
closed_forms   a trap for error control, two balls, times of switching
cost           time of value and Jacobian over time of the value, and of compiling them
finite         ten thousand random scenes and starts: no derivative that is not a finite number

All but `cost`, whose tolerances are those of the ladder, run alone too, and have a page of their own then:
`python -m experiments.derivatives ladder`.
"""

from typing import NamedTuple

from experiments.derivatives import closed_forms, cost, finite, ladder


class Results(NamedTuple):
    """What the four parts found."""

    rungs: list[ladder.Rung]
    closed: list[closed_forms.Row]
    costs: list[cost.Cost]
    counts: list[finite.Count]


def main(quick: bool = False) -> Results:
    """All tables (`quick`: a tiny version of each)."""
    rungs = ladder.main(quick)
    return Results(rungs, closed_forms.main(quick), cost.main(quick, cost.tolerances(rungs)), finite.main(quick))
