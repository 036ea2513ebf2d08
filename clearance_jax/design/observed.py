"""Observations of a design in one scenario, from one solve: limits and instants of peaks, signals over time, forces and
work of joints, and data for pictures.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.types import Scalar
from clearance_jax.ask.lanes import answer
from clearance_jax.ask.question import Question
from clearance_jax.design.specification import Scenario, Specification
from clearance_jax.dynamics.equations import balance
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.metrics.first_fall import FirstFall
from clearance_jax.metrics.instants import PeakInstants
from clearance_jax.metrics.joint_work import JointWork
from clearance_jax.metrics.measure import AbstractMetric, Request
from clearance_jax.metrics.reductions import At, Impacts, Peak
from clearance_jax.metrics.signals import ContactForce
from clearance_jax.results.marks import picture
from clearance_jax.solve.settings import DYNAMICS
from clearance_jax.spatial import as_array

SAMPLES = 2001
# The number of peaks of each force: if a pin falls first, the largest one after its fall is among these.
FORCES = 8


class Observed(NamedTuple):
    """The observations of a scenario; before the solve, the metrics for them in the same fields:

    - by limit, `limits` (`Instants` of a peak, else the values) and `signals` over time (`None`: it has none);
    - by clearance joint, `forces` (`Instants` of the largest), `falls` (when the first fall is over [s]), `works`
      (`Work`) and `impacts`;
    - over time, `picture` (`results.marks.picture`), and in space `wrenches` on the pins.
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


def pin_wrenches(mechanism: PreparedMechanism, time: Scalar, y: Array) -> dict[str, tuple[Array, Array]]:
    """The force [N] and moment [N m] of each clearance joint on its pin, in the sleeve's axes."""
    actions = balance(mechanism, time, layout(mechanism).split(y)).actions
    return {name: (as_array(action.force), as_array(action.torque)) for name, action in actions.items()}


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
    times = sample_times(specification)
    # One motion shows the new mechanism, also for limits on a worn one.
    metrics = [limit.simulation_metric.base_metric for limit in specification.limits]
    signals = [getattr(metric, "signal", None) for metric in metrics]
    return Observed(
        tuple(PeakInstants(metric) if isinstance(metric, Peak) else metric for metric in metrics),
        tuple(None if signal is None else At(signal, times) for signal in signals),
        tuple(PeakInstants(Peak(ContactForce(name), count=FORCES)) for name in joints),
        tuple(FirstFall(name) for name in joints),
        tuple(JointWork(name) for name in joints),
        tuple(Impacts(name) for name in joints),
        SampledFunction(picture, times),
        () if specification.mechanism.is_plane else SampledFunction(pin_wrenches, times),
    )
