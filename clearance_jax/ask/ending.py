"""A metric for how a solve ended, solved together with the metrics of a question."""

from clearance_jax.metrics.measure import AbstractMetric, Reply, Request

# The name under which it stands beside the metrics; no metric of a user can have it.
ENDING = " ending"


class Ending(AbstractMetric):
    """How the solve ended: result code, steps, rejected steps; the residual of an energy balance; the `Validity.level`
    of quasi-static poses.
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
