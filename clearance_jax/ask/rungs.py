"""By which model a question is answered."""

import abc
from collections.abc import Mapping
from typing import Any

from jaxtyping import Array

from clearance_jax._module import Module
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMetric, Reply, Request, measured
from clearance_jax.solve.settings import Settings


class AbstractRung(Module):
    """A model of a mechanism's motion, as fine as a question needs it."""

    @abc.abstractmethod
    def measured(
        self, mechanism: Mechanism, metrics: Mapping[str, AbstractMetric], t1: Any, settings: Settings
    ) -> tuple[dict[str, Any], dict[str, Array]]:
        """The metrics' values by name, and how it ended: "code" (see `Result`), and whatever numbers there are."""


class Dynamics(AbstractRung):
    """The equations of motion, solved."""

    def measured(self, mechanism, metrics, t1, settings):
        found = measured(mechanism, {**metrics, ENDING: Ending()}, t1, settings)
        return found, found.pop(ENDING)


# What every solve says beside its metrics: a name that no metric has.
ENDING = " ending"


class Ending(AbstractMetric):
    """How the solve ended: result code, steps, where there are books the energy residual, and of quasi-static poses how
    far they can be believed (`Validity.level`).
    """

    def request(self, mechanism, t1, options):
        return Request()

    def value(self, reply: Reply):
        solution = reply.solution
        found = {"code": solution.code, "steps": solution.steps, "rejected": solution.rejected}
        found |= {"energy_residual": solution.energy_residual} if solution.books else {}
        return found | ({} if solution.validity is None else {"validity": solution.validity.level})
