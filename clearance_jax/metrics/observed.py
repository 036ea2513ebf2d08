"""Metrics that a design asks for beside those of its limits: when peaks are, what joints lose (their wear and
heat), and when the first fall of a pin is over, an artefact of a start without contact.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.equations import balance
from clearance_jax.dynamics.kinematics import relative_motions
from clearance_jax.joints import Relative
from clearance_jax.mechanism._base import ClearanceJoint
from clearance_jax.mechanism.gaps import CoordinateGap
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, layout
from clearance_jax.metrics.functions import clearance_index, contact_index
from clearance_jax.metrics.measure import AbstractMetric, Request
from clearance_jax.solve.steps.observers import AbstractObserver
from clearance_jax.solve.steps.problem import Problem, motion
from clearance_jax.spatial import as_array


class Instants(NamedTuple):
    """Peaks, the highest first: `values` in the signal's unit, `times` [s]."""

    values: Float[Array, " count"]
    times: Float[Array, " count"]


class PeakInstants(AbstractMetric):
    """The values and times of a `ranked` metric, from its own solve. Times have no derivative."""

    peak: AbstractMetric

    @property
    def unit(self):
        return self.peak.unit

    def static_bound(self):
        return PeakInstants(self.peak.static_bound())

    def request(self, mechanism, t1, options):
        return self.peak.request(mechanism, t1, options)

    def value(self, reply):
        (picked,) = reply.picked
        assert picked is not None
        return Instants(self.peak.value(reply).reshape(-1), picked.time)


class Work(NamedTuple):
    """The mean normal force of a joint [N], or effort of a gap's flanks [N m, N of a slide], and the energy lost in its
    friction and in its contact damping [J].
    """

    mean_force: Scalar
    friction_loss: Scalar
    contact_loss: Scalar


class JointWork(AbstractMetric):
    """`Work` of a joint with clearance or of a gap, integrated along. All joints', gaps' and dampers' losses add up to
    `EnergyLost`.

    **Arguments:** `joint`: its name, or that of a gap (`axis_drive`).
    """

    joint: str = eqx.field(static=True)

    def request(self, mechanism, t1, options):
        contact_index(mechanism, self.joint)  # an unknown name raises here
        return Request(integrands=(JointPowers(self.joint),))

    def value(self, reply):
        pressed, rubbed, absorbed = reply.integrals[0]
        ready = reply.mechanism.prepare()
        gained = _elastic_energy(ready, self.joint, reply.t1, reply.solution.final)
        gained -= _elastic_energy(ready, self.joint, reply.t0, reply.solution.initial)
        return Work(pressed / reply.span, rubbed, absorbed - gained)


class JointPowers(Module):
    """Normal force [N], power lost in friction and power absorbed beside it [W] of a joint, shape (3,)."""

    joint: str = eqx.field(static=True)

    def __call__(self, time, y, mechanism):
        """The three powers at a state."""
        joint, at, state = _play(mechanism, self.joint, time, y)
        action = joint.clearance.act(at, state.memory.get(joint.name, ()))
        return jnp.stack([action.normal_force, action.friction_power, action.absorbed_power])

    def scale(self, mechanism):
        """Infinite: kinks are the laws' events, at which steps end anyway."""
        return jnp.asarray(jnp.inf)


def _play(mechanism: PreparedMechanism, name: str, time, y) -> tuple[ClearanceJoint | CoordinateGap, Relative, State]:
    index = contact_index(mechanism, name)
    at = relative_motions(time, y, mechanism)[index]
    return mechanism.contacts()[index], at, layout(mechanism).split(y)


def _elastic_energy(mechanism: PreparedMechanism, name: str, time, y) -> Scalar:
    """What a joint's contact holds elastically [J]."""
    joint, at, _ = _play(mechanism, name, jnp.asarray(time, float), y)
    return joint.clearance.elastic_energy(at)


class FirstFall(AbstractMetric):
    """When the first fall of a joint's pin is over [s]: it leaves the wall for the first time, or stays there through
    one compression and restitution. Minus infinity for a pin that starts in contact, infinity for one that never lands.
    It has no derivative.

    **Arguments:** `joint`: its name.
    """

    joint: str = eqx.field(static=True)

    def request(self, mechanism, t1, options):
        return Request((_Landing(clearance_index(mechanism, self.joint)),))

    def value(self, reply):
        return jnp.where(reply.solution.succeeded, reply.solution.records[0].over, jnp.nan)


class _Fall(NamedTuple):
    """When the fall is `over` [s] (infinity: not yet), whether the pin has `landed`, and how often the rate of its
    penetration has changed its sign since (`turns`).
    """

    over: Array
    landed: Array
    turns: Array


class _Landing(AbstractObserver):
    """Follows a joint (by its index among the clearance joints) through its first fall."""

    joint: int = eqx.field(static=True)

    def start(self, t0, y0, problem):
        depth, _ = self._deepest(t0, motion(problem, y0), problem)
        return _Fall(jnp.where(depth > 0, -jnp.inf, jnp.inf), jnp.zeros((), bool), jnp.zeros((), int))

    def __call__(self, record, step, problem):
        (_, rate_before), (depth, rate) = (
            self._deepest(t, motion(problem, y), problem) for t, y in zip(step.times, step.trial[:2], strict=True)
        )
        landed, touching = record.landed | (depth > 0), depth > 0
        turns = record.turns + (record.landed & (jnp.sign(rate_before) != jnp.sign(rate)))
        done = jnp.isinf(record.over) & landed & (~touching | (turns >= 2))
        # A pin that starts in contact is not overwritten: its fall was over before it began.
        over = jnp.where(done & (record.over > 0), step.times[1], record.over)
        return _Fall(over, landed, turns)

    def _deepest(self, time: Scalar, y: Array, problem: Problem) -> tuple[Array, Array]:
        """Penetration [m] and its rate [m/s] at the deepest point."""
        clearance = problem.mechanism.clearance_joints()[self.joint].clearance
        depth, rate = clearance.depths(relative_motions(time, y, problem.mechanism)[self.joint])
        k = jnp.argmax(depth)
        return depth[k], rate[k]


def pin_wrenches(mechanism: PreparedMechanism, time: Scalar, y: Array) -> dict[str, tuple[Array, Array]]:
    """The force [N] and moment [N m] of each clearance joint on its pin, in the sleeve's axes."""
    actions = balance(mechanism, time, layout(mechanism).split(y)).actions
    return {name: (as_array(action.force), as_array(action.torque)) for name, action in actions.items()}
