"""The findings about a design, for a report: limits, loads, pictures, contributions, fits, maintenance."""

import functools
import platform
from collections.abc import Callable, Mapping
from importlib.metadata import version
from types import MappingProxyType
from typing import Any, NamedTuple

import xarray as xr

from clearance_jax._version import __version__
from clearance_jax.design.answer import Design
from clearance_jax.design.asked.specification import scenarios_of
from clearance_jax.design.judge import observed
from clearance_jax.design.judge.explain import Maintenance, Response, Tradeoff, maintenances, responses, tradeoff
from clearance_jax.design.judge.standard import StandardFits, chosen_fits, nearest_fits
from clearance_jax.design.judge.verify import Certificate
from clearance_jax.design.search.yields import samples_needed
from clearance_jax.errors import ClearanceError
from clearance_jax.results.dataset import picture_dataset
from clearance_jax.results.places import Outline, outline
from clearance_jax.solve.settings import QUASI_STATIC

CUT_SHORT = "Interrupted before every statement was made."
NO_CLASSES = "No classes were chosen, so there is nothing to explain or to verify."
INFEASIBLE = "No design holds every limit, so there is nothing to explain or to verify."
# Samples for standard fits if each needs a wear simulation and no yield is asked for; they can prove 86 %.
LIVED = 20
OF_DYNAMICS = "Loads and pictures are those of the dynamics; the limits are judged by quasi-static poses."
NO_TRADE = "There is no trade-off where a design is judged among neighbours, or chosen from classes."
NO_FITS = "No combination of common fits was found that holds the limits."


class Findings(NamedTuple):
    """Everything that a report says of a `design`. A field is `None` or empty if it was not asked for, or cannot be
    computed.

    - `certificate`, `responses`, `tradeoff`, `fits`, `time_histories`, `maintenance`: as `verify`, `responses`,
      `tradeoff`, `nearest_fits`, `time_histories`, `maintenances` give them.
    - `standings`: of each limit in each scenario; `drawings`: of each clearance joint; `loads`: of each joint in each
      condition; `motions`: a dataset of each condition, for pictures.
    - `notes`: what else must be said, in sentences; `software`: the versions.
    """

    design: Design
    certificate: Certificate | None = None
    responses: tuple[Response, ...] = ()
    tradeoff: Tradeoff | None = None
    fits: StandardFits | None = None
    time_histories: tuple[observed.TimeHistory, ...] = ()
    notes: tuple[str, ...] = ()
    standings: tuple[observed.Standing, ...] = ()
    drawings: tuple[observed.JointDrawing, ...] = ()
    loads: tuple[observed.JointLoad, ...] = ()
    motions: Mapping[str, xr.Dataset] = MappingProxyType({})
    maintenance: tuple[Maintenance, ...] = ()
    software: str = ""

    @property
    def good(self) -> bool:
        """Whether the design is feasible, and its certificate, if there is one, confirms limits and yield."""
        proof = self.certificate
        return self.design.feasible and (proof is None or (proof.holds and proof.yields))

    @property
    def outline(self) -> Outline | None:
        """The outline of the mechanism, in the first condition."""
        return next((outline(motion) for motion in self.motions.values()), None)

    @property
    def worst(self) -> dict[str, str]:
        """The condition of the largest force by joint, without first falls."""
        rising = sorted(self.loads, key=lambda load: load.largest if load.after is None else load.after)
        conditions = {load.joint: load.condition for load in rising}  # the last one counts, which is the largest
        return {load.joint: conditions[load.joint] for load in self.loads}

    @property
    def verdict(self) -> str:
        """A sentence on whether the limits are held, and by which evidence."""
        design = self.design
        if not design.feasible:
            return f"No feasible design: {design.lack}."
        if self.certificate is None:
            return "Every limit is held. Not verified by another solver."
        if self.certificate.holds and not self.certificate.yields:
            return f"The yield is below its target, {self.certificate.target:.4%}. {self.certificate.yield_estimate}"
        verb = "are held" if self.certificate.holds else "are NOT held"
        return f"The limits {verb} in a fresh simulation by another solver ({self.certificate.solver})."


def known_findings(design: Design, certificate: Certificate | None = None) -> Findings:
    """The findings about a `design` and its `certificate`, if there is one, that need no solve."""
    lack = "" if design.feasible else NO_CLASSES if design.evaluation.feasible else INFEASIBLE
    notes = tuple(note for note in (lack, design.specification.manufacture.doubt) if note)
    software = f"clearance_jax {__version__}, jax {version('jax')}, Python {platform.python_version()}"
    shown = {
        "standings": observed.standings(design),
        "drawings": observed.joint_drawings(design, {}),
        "software": software,
    }
    return Findings(design, certificate, notes=notes, **shown)


def findings(
    design: Design,
    certificate: Certificate | None = None,
    progress: Callable[[str], None] | None = None,
    cluster: Any = None,
    trade: Mapping[str, Any] | None = None,
) -> Findings:
    """All findings about a design that its problem allows: limits, loads, pictures, contributions, nearest fits.

    **Arguments:** `design`: the answer of a problem; `certificate`: of `design.verify()`, if there is one; `progress`:
    called with what comes next, in words; `cluster`: as of `ToleranceProblem.solve`, for the samples of fits and a
    trade-off; `trade`: options of `tradeoff`, {} for the default ones; `None`: no trade-off, which searches anew for
    every bound.

    If you interrupt it, it returns what it has found until then, with the note `CUT_SHORT`.
    """
    steps: dict[str, Callable[[Findings], Findings]] = {"loads and pictures": _see}
    if design.feasible:
        steps |= {
            "contributions": _step(lambda design: {"responses": responses(design)}),
            "standard fits": _step(functools.partial(_fits, cluster)),
        }
        if any(limit.ages for limit in design.specification.limits):
            steps["maintenance intervals"] = _step(lambda design: {"maintenance": maintenances(design)})
    seen = known_findings(design, certificate)
    try:
        for name, step in steps.items():
            if progress is not None:
                progress(name)
            seen = step(seen)
    except KeyboardInterrupt:
        return _note(seen, CUT_SHORT)
    return with_tradeoff(seen, progress, cluster, trade)


def with_tradeoff(
    findings: Findings,
    progress: Callable[[str], None] | None = None,
    cluster: Any = None,
    trade: Mapping[str, Any] | None = None,
) -> Findings:
    """The findings with a trade-off if `trade` is given. Arguments as of `findings`."""
    if trade is None or not findings.design.feasible:
        return findings
    if findings.design.specification.manufacture.among or findings.design.classes is not None:
        return _note(findings, NO_TRADE)
    try:
        return findings._replace(tradeoff=tradeoff(findings.design, **trade, progress=progress, cluster=cluster))
    except KeyboardInterrupt:
        return _note(findings, CUT_SHORT)


def _note(findings: Findings, note: str) -> Findings:
    return findings._replace(notes=(*findings.notes, note))


def _see(findings: Findings) -> Findings:
    """Add standings, time histories, loads and motions of the design."""
    design = findings.design
    specification = design.specification
    parts, times = specification.nominal(), observed.sample_times(specification)
    look = functools.partial(observed.observe, specification, design.evaluation.x)
    if specification.fidelity == QUASI_STATIC:
        findings = _note(findings, OF_DYNAMICS)
    signals, loads, motions = {}, [], {}
    for name, scenario in zip(parts.conditions, scenarios_of(parts), strict=True):
        now = look(scenario)
        if now is None:
            continue  # a design that could not be simulated is reported as such elsewhere
        mechanism, condition = specification.move(design.mechanism, scenario.values), parts.label(name)
        signals[condition] = now.signals
        loads += observed.joint_loads(mechanism, condition, times, now)
        motions[condition] = picture_dataset(mechanism, times, now.picture)
    return findings._replace(
        standings=observed.standings(design, look),
        time_histories=observed.histories_of(specification, times, signals),
        loads=tuple(loads),
        motions=motions,
    )


def _step(compute: Callable[[Design], dict[str, Any]]) -> Callable[[Findings], Findings]:
    """The step that sets fields by a function of the design, or notes why that is not possible."""

    def step(findings: Findings) -> Findings:
        try:
            return findings._replace(**compute(findings.design))
        except ClearanceError as error:
            return _note(findings, str(error))

    return step


def _fits(cluster: Any, design: Design) -> dict[str, Any]:
    asked, samples = design.specification, None
    if any(limit.ages for limit in asked.limits):
        target = getattr(asked.manufacture, "target", None)
        samples = LIVED if target is None else samples_needed(target)
    fits = (nearest_fits if design.classes is None else chosen_fits)(design, samples=samples, cluster=cluster)
    if fits is None:
        raise ClearanceError(NO_FITS)
    return {"fits": fits, "drawings": observed.joint_drawings(design, fits.fits, fits.remarks)}
