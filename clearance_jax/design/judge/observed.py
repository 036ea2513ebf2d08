"""What a design's motion and joints are like, from one solve in each scenario, and how it stands with its limits.

Instants of peaks, signals over time, forces and work of joints, data for pictures; from these the loads of each joint,
for the choice of its bearing, the data for its drawing, and the limits beside their bounds.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax.ask.question import Question, answer
from clearance_jax.design.answer import Design
from clearance_jax.design.asked.classes import CLEARANCE
from clearance_jax.design.asked.specification import Scenario, Specification, scenarios_of
from clearance_jax.errors import ClearanceError
from clearance_jax.joints.fits import Fit
from clearance_jax.mechanism._base import ClearanceJoint
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMetric, Request
from clearance_jax.metrics.observed import FirstFall, Instants, JointWork, PeakInstants, pin_wrenches
from clearance_jax.metrics.reductions import At, Impacts, Peak
from clearance_jax.metrics.signals import ContactForce
from clearance_jax.results.places import picture
from clearance_jax.solve.settings import DYNAMICS, settings_of

SAMPLES = 2001
# The number of peaks of each force: if a pin falls first, the largest one after its fall is among these.
FORCES = 8


class Observed(NamedTuple):
    """The observations of a scenario. `_request` fills the same fields with metrics; a solve replaces each metric by
    its value.

    - By limit, `limits` (`Instants` of a peak, else the values) and `signals` over time (`None`: it has none).
    - By clearance joint, `forces` (`Instants` of the largest), `falls` (when the first fall is over [s]), `works`
      (`Work`) and `impacts`.
    - Over time, `picture` (`results.places.picture`), and in space `wrenches` on the pins.
    """

    limits: tuple[Any, ...]
    signals: tuple[Any, ...]
    forces: tuple[Any, ...]
    falls: tuple[Any, ...]
    works: tuple[Any, ...]
    impacts: tuple[Any, ...]
    picture: Any
    wrenches: Any = ()


class SampledFunction(AbstractMetric):
    """A metric: a function of (prepared mechanism, time [s], state) at increasing times [s]."""

    function: Callable = eqx.field(static=True)
    times: Float[Array, " times"] = eqx.field(converter=lambda t: jnp.asarray(t, float))

    def request(self, mechanism, t1, options):
        return Request(times=self.times)

    def value(self, reply):
        ready = reply.mechanism.prepare()
        return jax.vmap(lambda time, y: self.function(ready, time, y))(self.times, reply.solution.y)


def sample_times(specification: Specification) -> np.ndarray:
    """The times of signals and pictures [s]."""
    return np.linspace(specification.t0, specification.t1, SAMPLES)


def observe(specification: Specification, x: np.ndarray, scenario: Scenario) -> Observed | None:
    """Observe a design (variables (n,)) in a scenario; `None` if the motion does not reach its end."""
    x = specification.values(x) * scenario.factors
    moved = specification.move(specification.mechanism, scenario.values)
    metrics, structure = jax.tree.flatten(_request(specification), is_leaf=lambda m: isinstance(m, AbstractMetric))
    named = {str(i): metric for i, metric in enumerate(metrics)}
    settings = specification.judged_by(DYNAMICS).settings()  # quasi-static poses have no impacts and no losses
    question = Question(moved, named, specification.t1, settings)
    values = answer(question, dict(zip(specification.variables, x, strict=True))).values
    observed = jax.tree.map(np.asarray, jax.tree.unflatten(structure, [values[name] for name in named]))
    return observed if all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(observed.picture)) else None


def _request(specification: Specification) -> Observed:
    joints = [joint.name for joint in specification.mechanism.clearance_joints()]
    times, limits = sample_times(specification), specification.limits
    # One motion shows the new mechanism, also for limits on a worn one.
    metrics = [limit.simulation_metric.base_metric for limit in limits]
    return Observed(
        tuple(PeakInstants(metric) if metric.ranked else metric for metric in metrics),
        tuple(None if limit.signal is None else At(limit.signal, times) for limit in limits),
        tuple(PeakInstants(Peak(ContactForce(name), count=FORCES)) for name in joints),
        tuple(FirstFall(name) for name in joints),
        tuple(JointWork(name) for name in joints),
        tuple(Impacts(name) for name in joints),
        SampledFunction(picture, times),
        () if specification.mechanism.is_plane else SampledFunction(pin_wrenches, times),
    )


class JointLoad(NamedTuple):
    """The load of a `joint` in one `condition`.

    - `largest`: the largest normal force [N], at `time` [s]; `mean`: its mean over time [N].
    - `first_fall`: whether the largest one belongs to the first fall of a pin that started in mid-air; then `after` is
      the largest one after it [N], at `time_after` [s] (`None`: not known, or none).
    - `impacts`: how often pin and sleeve meet; `friction_loss`, `contact_loss`: energy lost in friction and in contact
      damping [J].
    - `diameter` of the pin and `length` of the contact [m]; `None`: not known.
    - In space, at that time: `force` on the pin along the sleeve's axes [N], and the size of the `moment` on it across
      the axis [N m].
    """

    joint: str
    condition: str
    largest: float
    time: float
    mean: float
    impacts: int
    friction_loss: float
    contact_loss: float
    diameter: float
    length: float | None
    force: tuple[float, ...] | None = None
    moment: float | None = None
    first_fall: bool = False
    after: float | None = None
    time_after: float | None = None

    @property
    def largest_pressure(self) -> float | None:
        """The pressure of the largest force on the pin's projected area, F / (d L) [Pa]."""
        return None if self.length is None else self.largest / (self.diameter * self.length)

    @property
    def mean_pressure(self) -> float | None:
        """The pressure of the mean force on the pin's projected area [Pa]."""
        return None if self.length is None else self.mean / (self.diameter * self.length)


def joint_loads(mechanism: Mechanism, condition: str, times: np.ndarray, seen: Observed) -> tuple[JointLoad, ...]:
    """The load of every clearance joint; components of forces are those at the nearest of the sample `times` [s]."""
    rows = zip(mechanism.clearance_joints(), seen.forces, seen.falls, seen.works, seen.impacts, strict=True)
    out = []
    for joint, force, fall_end, work, impacts in rows:
        largest, time, mean = float(force.values[0]), float(force.times[0]), float(work.mean_force)
        optional = _of_fall(force, float(fall_end))
        if not mechanism.is_plane:
            (exerted, moment), k = seen.wrenches[joint.name], int(np.argmin(np.abs(times - time)))
            optional |= {"force": tuple(exerted[k].tolist()), "moment": float(np.hypot(*moment[k, :2]))}
        rest = int(impacts), float(work.friction_loss), float(work.contact_loss), *pin_size(joint)
        out.append(JointLoad(joint.name, condition, largest, time, mean, *rest, **optional))
    return tuple(out)


def _of_fall(force: Instants, end: float) -> dict[str, Any]:
    """The fields of `JointLoad` about the first fall, which ends at a time [s]; empty if the largest force is later."""
    if force.times[0] > end:
        return {}
    later = np.flatnonzero((force.times > end) & (force.values > 0))
    after = {"after": float(force.values[later[0]]), "time_after": float(force.times[later[0]])} if later.size else {}
    return {"first_fall": True} | after


def pin_size(joint: ClearanceJoint) -> tuple[float, float | None]:
    """Diameter of the pin and length of the contact [m]; `None`: not known."""
    geometry = joint.clearance.geometry()
    return 2 * float(geometry.pin_radius), None if geometry.length is None else float(geometry.length)


class JointDrawing(NamedTuple):
    """The data for the drawing of a clearance `joint`.

    - `diameter`: the nominal one [m]; `clearance`: the radial one, or that of a guide to either side [m], the largest
      allowed if it is `designed`, otherwise that of the mechanism.
    - `fit`: as of `nearest_fits` (`None`: not known); `remark`: where the fit exceeds the designed clearance or bounds.
    """

    joint: str
    diameter: float
    clearance: float
    designed: bool
    fit: Fit | None
    remark: str = ""


def joint_drawings(
    design: Design, fits: Mapping[str, Fit], remarks: Mapping[str, str] = MappingProxyType({})
) -> tuple[JointDrawing, ...]:
    """The drawings of all clearance joints of a design, with fits and remarks by variable."""
    return tuple(
        JointDrawing(
            joint.name,
            pin_size(joint)[0],
            float(joint.joint.play()[0].scale),
            joint.name + CLEARANCE in design.clearances,
            fits.get(joint.name + CLEARANCE),
            remarks.get(joint.name + CLEARANCE, ""),
        )
        for joint in design.mechanism.clearance_joints()
    )


# The number of limits that are shown, the nearest to their bounds.
SHOWN = 12


class Standing(NamedTuple):
    """How near a limit (its `label`) is to its bound in one scenario: `share`, value over bound; `value` and `bound` in
    `unit` (for a risk of several limits, shares of their bounds); the `time` of the peak [s], if the metric is one.
    """

    label: str
    unit: str
    value: float
    bound: float
    share: float
    time: float | None


def standings(design: Design, look: Callable[[Scenario], Observed | None] | None = None) -> tuple[Standing, ...]:
    """The standings of the limits nearest to their bounds, at most `SHOWN`, the nearest first. `look`: observes a
    scenario, for the instants of its peaks (default: these are `None`).
    """
    program, limits, specification = design.program, design.evaluation.limits, design.specification
    order = np.argsort(-np.nan_to_num(limits, nan=np.inf))[:SHOWN]
    if specification.manufacture.title:
        # The risk of all parts: in the unit of a single limit, or as a share of several bounds.
        asked = specification.limits[0]
        bound, unit = (asked.bound, asked.metric.unit) if len(specification.limits) == 1 else (1.0, "")
        shares = ((program.limit_names[k], float(1 + limits[k])) for k in order)
        return tuple(Standing(label, unit, share * bound, bound, share, None) for label, share in shares)
    # A limit that is judged among parts is one number for a condition; its peak is that of the design itself.
    scenarios = scenarios_of(specification.nominal() if specification.manufacture.among else specification)
    # The limits of the program are all values of all limits in the first scenario, then in the second, ...
    titles = [limit.title for limit in specification.limits]
    groups = program.groups[: len(program.groups) // len(scenarios)]
    seen: dict[int, Observed | None] = {}
    out = []
    for k in order.tolist():
        number, row = divmod(k, len(groups))
        limit, peak = titles.index(groups[row]), groups[:row].count(groups[row])
        asked = specification.limits[limit]
        if look is not None and number not in seen:
            seen[number] = look(scenarios[number])
        value, share = float((1 + limits[k]) * asked.bound), float(1 + limits[k])
        # The observed mechanism is new.
        observed = None if asked.ages else seen.get(number)
        instants = None if observed is None else observed.limits[limit]
        time = float(instants.times[peak]) if isinstance(instants, Instants) else None
        out.append(Standing(program.limit_names[k], asked.metric.unit, value, asked.bound, share, time))
    return tuple(out)


class TimeHistory(NamedTuple):
    """The `signal` of a `limit` over time.

    - `times` (times,) [s]; `values` (times,) in `unit`, by condition (with one condition only, under an empty name);
      `bound`.
    - `reduction`: the reduction of the signal that is bounded, in words (empty: every value); `since`: from when on
      [s] (`None`: the start).
    """

    limit: str
    signal: str
    unit: str
    reduction: str
    since: float | None
    bound: float
    times: np.ndarray
    values: dict[str, np.ndarray]


def time_histories(design: Design) -> tuple[TimeHistory, ...]:
    """The signal of each limit over time, at the design, without conditions that cannot be simulated.

    **Arguments:** `design`: the answer of a problem.
    """
    specification = design.specification
    times, signals, by_condition = sample_times(specification), [limit.signal for limit in specification.limits], {}
    asked = {str(i): At(signal, times) for i, signal in enumerate(signals) if signal is not None}
    for name, given in specification.conditions.items():
        moved = specification.move(design.mechanism, given)
        try:
            settings = settings_of(moved, specification.t1, specification.solving)
            seen = answer(Question(moved, asked, specification.t1, settings)).values
        except (ClearanceError, RuntimeError):
            continue  # a design that could not be simulated is reported as such elsewhere
        by_condition[specification.label(name)] = [seen.get(str(i)) for i in range(len(signals))]
    return histories_of(specification, times, by_condition)


def histories_of(
    specification: Specification, times: np.ndarray, by_condition: Mapping[str, Sequence[Any]]
) -> tuple[TimeHistory, ...]:
    """The time histories of all limits with a signal, from lists of signals by condition."""
    return tuple(
        TimeHistory(
            limit.label,
            limit.signal_label,
            limit.signal.unit,
            limit.reduction,
            limit.since,
            limit.bound,
            times,
            {name: np.asarray(signals[i]) for name, signals in by_condition.items()},
        )
        for i, limit in enumerate(specification.limits)
        if limit.signal is not None
    )
