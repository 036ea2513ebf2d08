"""All that can be said of a design, for a report."""

from typing import NamedTuple

from clearance_jax.design.answer import Design
from clearance_jax.design.certificate import Certificate
from clearance_jax.design.explain import Response, Tradeoff, responses, tradeoff
from clearance_jax.design.standard import StandardFits, nearest_fits
from clearance_jax.design.time_histories import TimeHistory, time_histories
from clearance_jax.errors import ClearanceError


class Findings(NamedTuple):
    """What a report tells of a design; `None` where it was not asked for, or cannot be had."""

    design: Design
    certificate: Certificate | None = None
    responses: tuple[Response, ...] = ()
    tradeoff: Tradeoff | None = None
    fits: StandardFits | None = None
    time_histories: tuple[TimeHistory, ...] = ()
    notes: tuple[str, ...] = ()


def findings(design: Design, certificate: Certificate | None = None) -> Findings:
    """Histories, contributions, trade-off and nearest fits of a design, as far as its problem has them."""
    seen = time_histories(design)
    if not design.feasible:
        note = "No design holds every limit, so there is nothing to explain or to verify."
        return Findings(design, time_histories=seen, notes=(note,))
    notes: list[str] = []
    why, fitted = (), None
    try:
        why = responses(design)
    except ClearanceError as error:
        notes.append(str(error))
    try:
        fitted = nearest_fits(design)
        if fitted is None:
            notes.append("No combination of common fits was found that holds the limits.")
    except ClearanceError as error:
        notes.append(str(error))
    return Findings(design, certificate, why, tradeoff(design), fitted, seen, tuple(notes))
