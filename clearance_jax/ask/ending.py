"""How a solve ended, beside what is asked of it."""

from clearance_jax.metrics.measure import AbstractMetric, Reply, Request

# What every solve says beside its metrics: a name that no metric has.
ENDING = " ending"


class Ending(AbstractMetric):
    """How the solve ended: result code, steps; with an energy balance its residual; of quasi-static poses how far they
    can be believed (`Validity.level`).
    """

    def static_bound(self):
        return self

    def request(self, mechanism, t1, options):
        return Request()

    def value(self, reply: Reply):
        solution = reply.solution
        ending = {"code": solution.code, "steps": solution.steps, "rejected": solution.rejected}
        ending |= {"energy_residual": solution.energy_residual} if solution.energy_balance else {}
        return ending | ({} if solution.validity is None else {"validity": solution.validity.level})
