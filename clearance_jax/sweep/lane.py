"""What is computed of one lane: every output from one solve, how the solve ended, and derivatives."""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._frame import Frame, frame_of
from clearance_jax._module import Module
from clearance_jax.analysis.measure import AbstractMetric, Reply, Request, measured
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import replace, values_of
from clearance_jax.solve.settings import Settings

# What every lane says beside its outputs.
ENDING = "ending"


class Ending(AbstractMetric):
    """How the solve ended: result code, steps, and where there are books the energy residual."""

    def request(self, mechanism, t1, options):
        return Request()

    def value(self, reply):
        solution = reply.solution
        found = {"code": solution.code, "steps": solution.steps, "rejected": solution.rejected}
        return found | ({"energy_residual": solution.energy_residual} if solution.books else {})


class Undifferentiated(AbstractMetric):
    """A metric whose derivative is not asked for, and which may have none."""

    metric: AbstractMetric

    def request(self, mechanism, t1, options):
        return self.metric.request(mechanism, t1, options)

    def value(self, reply):
        return self.metric.value(_fixed(reply))


def _fixed(reply: Reply) -> Reply:
    arrays, others = eqx.partition(reply, eqx.is_array)
    return eqx.combine(jax.tree.map(jax.lax.stop_gradient, arrays), others)


class Answer(NamedTuple):
    """Of a lane: its `values` by output, its `slopes` (the same with a last axis over parameters; empty without), and
    how it ended.
    """

    values: dict[str, Array]
    slopes: dict[str, Array]
    ending: dict[str, Array]


class Lane(Module):
    """The function of a lane's numbers that a sweep maps.

    - `mechanism`, `metrics`, `t1`, `settings`: what is solved and asked; another number is no other program.
    - `wrt`: parameters by which derivatives are asked of the outputs in `differentiated`.
    """

    mechanism: Mechanism
    metrics: dict[str, AbstractMetric]
    t1: Array
    settings: Settings
    wrt: tuple[str, ...] = eqx.field(static=True, default=())
    differentiated: tuple[str, ...] = eqx.field(static=True, default=())

    def __call__(self, numbers: dict[str, Any]) -> Answer:
        given = dict(numbers)
        t1, rtol = given.pop("t1", self.t1), given.pop("rtol", self.settings.rtol)
        settings, model = self.settings._replace(rtol=rtol), replace(self.mechanism, given)

        def of(mechanism: Mechanism, metrics: dict[str, AbstractMetric]) -> tuple[dict, dict]:
            found = measured(mechanism, {**metrics, ENDING: Ending()}, t1, settings)
            return found, found.pop(ENDING)

        if not self.wrt:
            values, ending = of(model, self.metrics)
            return Answer(values, {}, ending)
        metrics = {
            name: metric if name in self.differentiated else Undifferentiated(metric)
            for name, metric in self.metrics.items()
        }
        centre = jnp.stack([values_of(model, [name])[name] for name in self.wrt])

        def at(point):
            return of(replace(model, dict(zip(self.wrt, point, strict=True))), metrics)

        def along(direction):
            return jax.jvp(at, (centre,), (direction,), has_aux=True)

        # The rule of `flow` makes one solve of this: it sees which numbers vary, not how many directions are asked.
        values, slopes, ending = jax.vmap(along, out_axes=(None, -1, None))(jnp.eye(len(self.wrt)))
        return Answer(values, {name: slopes[name] for name in self.differentiated}, ending)


def shapes_of(function: Lane, names: Sequence[str]) -> Answer:
    """What a lane's answer is, without computing it; a function that has been asked before is not traced again."""
    return _shapes(frame_of(function), tuple(names))


@functools.lru_cache(maxsize=256)
def _shapes(frame: Frame, names: tuple[str, ...]) -> Answer:
    def answer(arrays, numbers):
        return frame.filled(arrays)(numbers)

    return jax.eval_shape(answer, frame.shapes, {name: jax.ShapeDtypeStruct((), float) for name in names})
