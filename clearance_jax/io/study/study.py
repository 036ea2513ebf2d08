"""Reads study files (TOML with units). Unknown keys are errors."""

import warnings
from pathlib import Path
from typing import Any, NamedTuple

from clearance_jax.errors import ClearanceError
from clearance_jax.io.scene.scene import ImplausibleWarning, implausible
from clearance_jax.io.study.calibrate import calibration_of
from clearance_jax.io.study.design import DesignAsked, design_of
from clearance_jax.io.study.file import StudyFile
from clearance_jax.io.study.sweep import sweep_of
from clearance_jax.io.study.wear import WearAsked, wear_of
from clearance_jax.io.table import naming
from clearance_jax.mechanism.mechanism import Mechanism


class Study(NamedTuple):
    """A study file as read.

    - `name` of the study, `text` of the file, `scene_text` of its scene; `mechanism`: that of the scene, with the
      numbers that the study sets.
    - `sweep`: the arguments of `cj.sweep`; `design`: the problem, how to solve and verify it; `wear`: how a joint
      wears; `calibrate`: the arguments of `cj.calibrate`. `None`: the study has no such section.
    """

    name: str
    text: str
    scene_text: str
    mechanism: Mechanism
    sweep: dict[str, Any] | None
    design: DesignAsked | None
    wear: WearAsked | None
    calibrate: dict[str, Any] | None


def load_study(path: str | Path) -> Study:
    """Read a study file. It warns if sizes in its scene are not plausible.

    **Arguments:** `path`: of the file.

    **Raises:** `ClearanceError` naming the file, the key and the fix.
    """
    path = Path(path)
    with naming(str(path)):
        asked = StudyFile(path)
        if warning := implausible(asked.mechanism):
            warnings.warn(f"{path}: {warning}", ImplausibleWarning, stacklevel=2)
        return _study(asked)


def _study(asked: StudyFile) -> Study:
    has = {section: asked.table.has(section) for section in ("sweep", "design", "wear", "calibrate")}
    if not any(has.values()):
        raise ClearanceError(
            f"{asked.table.where} asks for nothing. Add a section `sweep`, `design`, `wear` or `calibrate`."
        )
    wear = wear_of(asked) if has["wear"] else None
    design = design_of(asked, wear) if has["design"] else None
    if wear is not None and wear.cycles is None and not _wears(design):
        raise ClearanceError(
            f"{asked.table.key('wear')} has no effect: it lacks the key `cycles`, how many it lives, and no limit of a "
            "design has `cycles`. Add one of them."
        )
    sweep = sweep_of(asked) if has["sweep"] else None
    calibrate = calibration_of(asked) if has["calibrate"] else None
    return Study(asked.name, asked.text, asked.scene.text, asked.mechanism, sweep, design, wear, calibrate)


def _wears(design: DesignAsked | None) -> bool:
    """Whether a limit of the design is checked after wear."""
    return design is not None and any(limit.ages for limit in design.problem.specification.limits)
