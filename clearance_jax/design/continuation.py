"""Design by continuation: searches with contact laws smoothed over smaller and smaller widths, and at last with the
laws themselves, each from the design of the one before.
"""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from clearance_jax.design.answer import Design
from clearance_jax.design.run import INTERRUPTED
from clearance_jax.design.search import search
from clearance_jax.design.specification import Specification
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.variants import change_each_play


def smoothed(mechanism: Mechanism, width: float) -> Mechanism:
    """The mechanism with a smooth onset of every normal law over a width [m]."""
    return change_each_play(mechanism, lambda play: dataclasses.replace(play, normal=play.normal.smoothed(width)))


def continued(
    specification: Specification,
    widths: Sequence[float],
    start: Mapping[str, float] | None,
    starts: int,
    record: str | Path | None,
    **options: Any,
) -> Design:
    """The best design of the laws themselves, from designs of laws smoothed over `widths` [m], the last of which is 0.

    Only the first width has further `starts`. Every width has its own record beside the `record`. Other arguments as
    those of `search`.

    **Raises:** `ClearanceError` for widths that do not fall to 0, and for classes.
    """
    _check(widths, options.get("classes"))
    before: list[tuple[float, Design]] = []
    for width in widths[:-1]:
        asked = dataclasses.replace(specification, mechanism=smoothed(specification.mechanism, width))
        design = search(asked, start=start, starts=starts, record=_record_of(record, width), **options)
        if design.stop_reason == INTERRUPTED:
            note = f"this is a design of laws that are smoothed over {width:g} m, not of the laws themselves"
            note = "; ".join(text for text in (design.note, note) if text)
            return dataclasses.replace(design, note=note, before=tuple(before))
        before.append((width, design))
        start, starts = design.clearances, 1
    design = search(specification, start=start, starts=starts, record=record, **options)
    return dataclasses.replace(design, before=tuple(before))


def _check(widths: Sequence[float], classes: Any) -> None:
    falls = all(high > low for high, low in itertools.pairwise(widths))
    if not (falls and widths and all(0 <= width < math.inf for width in widths) and widths[-1] == 0):
        raise ClearanceError(
            "`smoothing` must be widths [m] that become smaller, and the last one must be 0, which is the law itself: "
            f"such as (1e-6, 1e-7, 0). But it is {tuple(widths)}."
        )
    if classes is not None:
        raise ClearanceError(
            "`smoothing` is for variables that take any values: leave `classes` out, and then choose the classes with "
            "`start` at the answer."
        )


def _record_of(record: str | Path | None, width: float) -> Path | None:
    """The record of a width: a file beside that of the laws themselves."""
    path = None if record is None else Path(record)
    return path and path.with_name(f"{path.stem}.smoothed-{width:g}{path.suffix}")
