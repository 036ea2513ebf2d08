"""Mean force and losses of a clearance joint over a motion, which measure its wear and its heat."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.kinematics import relative_motions
from clearance_jax.joints import Relative
from clearance_jax.mechanism._base import ClearanceJoint
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, layout
from clearance_jax.metrics.measure import AbstractMetric, Request
from clearance_jax.metrics.signals import clearance_index


class Work(NamedTuple):
    """The mean normal force of a joint [N], and the energy lost in its friction and in its contact damping [J]."""

    mean_force: Scalar
    friction_loss: Scalar
    contact_loss: Scalar


class JointWork(AbstractMetric):
    """`Work` of a clearance joint, integrated along with the motion by the solver. The losses of all joints and dampers
    add up to `EnergyLost`.
    """

    joint: str = eqx.field(static=True)

    def request(self, mechanism, t1, options):
        clearance_index(mechanism, self.joint)  # an unknown name raises here
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
        action = joint.clearance.act(at, state.memory[joint.name])
        return jnp.stack([action.normal_force, action.friction_power, action.absorbed_power])

    def scale(self, mechanism):
        """Infinite: kinks are the laws' events, at which steps end anyway."""
        return jnp.asarray(jnp.inf)


def _play(mechanism: PreparedMechanism, name: str, time, y) -> tuple[ClearanceJoint, Relative, State]:
    index = clearance_index(mechanism, name)
    at = relative_motions(time, y, mechanism)[index]
    return mechanism.clearance_joints()[index], at, layout(mechanism).split(y)


def _elastic_energy(mechanism: PreparedMechanism, name: str, time, y) -> Scalar:
    """What a joint's contact holds elastically [J]."""
    joint, at, _ = _play(mechanism, name, jnp.asarray(time, float), y)
    return joint.clearance.elastic_energy(at)
