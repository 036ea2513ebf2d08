"""The end of a pin's first fall, an artefact of a start without contact."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.kinematics import relative_motions
from clearance_jax.metrics.measure import AbstractMetric, Request
from clearance_jax.metrics.signals import clearance_index
from clearance_jax.solve.observers import AbstractObserver
from clearance_jax.solve.problem import Problem, motion


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
    """The time when it is `over` [s] (infinity: not yet), whether the pin has `landed`, and how often its rate has
    changed sign since.
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

    def __call__(self, record, times, ends, problem):
        (_, rate), (depth, now) = (
            self._deepest(t, motion(problem, y), problem) for t, y in zip(times, ends[:2], strict=True)
        )
        landed, touching = record.landed | (depth > 0), depth > 0
        turns = record.turns + (record.landed & (jnp.sign(rate) != jnp.sign(now)))
        done = jnp.isinf(record.over) & landed & (~touching | (turns >= 2))
        # A pin that starts in contact is not overwritten: its fall was over before it began.
        over = jnp.where(done & (record.over > 0), times[1], record.over)
        return _Fall(over, landed, turns)

    def _deepest(self, time: Scalar, y: Array, problem: Problem) -> tuple[Array, Array]:
        """Penetration [m] and its rate [m/s] at the deepest point."""
        clearance = problem.mechanism.clearance_joints()[self.joint].clearance
        depth, rate = clearance.depths(relative_motions(time, y, problem.mechanism)[self.joint])
        k = jnp.argmax(depth)
        return depth[k], rate[k]
