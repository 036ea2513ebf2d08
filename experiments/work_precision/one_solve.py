"""One solve of the slider-cranks to its end, without samples: the library beside hand-written C and other tools.

Errors are those of the two positions at the end of a revolution, relative to their largest magnitudes. The C program is
Tsit5 with steps that end where the force law changes (`experiments/reference/scalar.c`, -O3 -march=native). Its time is
the CPU time of its fastest round; all other times are wall times, the shortest of several. Tools that know of no events
run with a bound of their steps of 1 us as well: without it most of them reach no error below 1e-6.
"""

import subprocess
import tempfile
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

import clearance_jax as cj
from clearance_jax.solve.settings import SOLVERS
from experiments.common import output, table
from experiments.publish import say
from experiments.scalar import compiled, read, words
from experiments.work_precision import peers
from experiments.work_precision.points import GaveUp, Point, best, cheapest
from experiments.work_precision.points import of as points_of
from experiments.work_precision.scenes import Case

BOUNDS = (1e-6, 1e-9)
MOST_OVER_C, LEAST_OVER_PEERS = 1.3, 4.0
SHORT = 1e-6
"""The step [s] that finds every touch of these scenes."""
RTOLS = tuple(10.0 ** (-k / 2) for k in range(8, 25))
QUICK = (1e-5, 1e-8)
PEER_RTOLS = tuple(10.0**-k for k in range(4, 13))
C, C_SECONDS = "C, Tsit5, located events", 0.3
End = Callable[[float], tuple[np.ndarray, float]]
"""From rtol to the states at the end (n,), as the hand-written twin has them, and the time [s]."""


def ours(case: Case, solver: str) -> End:
    """The library's single solve, compiled for whatever rtol and clearance."""

    @jax.jit
    def run(clearance, rtol):
        mechanism = cj.replace(case.mechanism, {case.scene.clearance: clearance})
        return cj.simulate(mechanism, case.scene.t1, rtol=rtol, solver=solver, energy_balance=False).final

    def end(rtol):
        y, took = best(lambda: jax.block_until_ready(run(case.clearance, rtol)), 30)
        return np.asarray(y) + case.turned[-1], took

    end(1e-4)
    return end


def by_c(case: Case, program: Any) -> End:
    """The C program with this clearance alone."""

    def end(rtol):
        command = [*words(program, 1, rtol, C_SECONDS, 1), repr(case.clearance)]
        answer = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        _, took, _ = read(answer)
        return np.array(answer.splitlines()[0].split(), float), took

    return end


def by_peers(case: Case, hmax: float) -> dict[str, End]:
    """By odeint and CVODE with numba's right-hand side, and CasADi; `hmax`: the longest step [s], 0: any."""
    from scipy.integrate import odeint

    field, bounded = peers.Field(case), ", steps <= 1 us" if hmax else ""
    last = np.array([case.times[0], case.times[-1]])

    def by_odeint(rtol):
        options = {"rtol": rtol, "atol": rtol * field.unit, "mxstep": 10**7, "hmax": hmax, "tfirst": True}
        y, took = best(lambda: odeint(field.compiled, field.start, last, field.arguments, **options))
        return y[-1], took

    found: dict[str, End] = {f"odeint + numba{bounded}": by_odeint}
    if peers.installed("CVODE"):
        from sksundae.cvode import CVODE

        (p,) = field.arguments

        def rhs(t, y, out):
            out[:] = field.compiled(t, y, p)

        def by_cvode(rtol, method):
            options = {"rtol": rtol, "atol": rtol * field.unit, "max_num_steps": 10**7, "max_step": hmax}
            found, took = best(lambda: CVODE(rhs, method=method, **options).solve(last, field.start))
            return np.asarray(found.y)[-1], took

        for method in ("Adams", "BDF"):
            found[f"CVODE {method} + numba{bounded}"] = lambda rtol, m=method: by_cvode(rtol, m)
    if peers.installed("CasADi"):
        model = peers.CasADi(case, field)

        def by_casadi(rtol):
            integrate = model.integrator(last[1:], rtol, hmax)
            try:
                found, took = best(lambda: integrate(x0=field.start / field.unit, p=0))
            except RuntimeError:
                raise GaveUp from None
            return np.array(found["xf"]).ravel() * field.unit, took

        found[f"CVODES (CasADi){bounded}"] = by_casadi
    return found


def by_exudyn(case: Case) -> End:
    """Exudyn's DOPRI5 on the same two equations: a mass matrix and a user function of the force, compiled by numba."""
    import exudyn as exu
    from exudyn.itemInterface import NodeGenericODE2, ObjectGenericODE2

    from experiments.reference.problems import PROBLEMS

    rhs, p = PROBLEMS["slider_crank"].rhs, case.stored["params"]
    start = PROBLEMS["slider_crank"].start(p)

    def force(mbs, t, number, q, q_t):
        return rhs(t, np.array([*q, *q_t]), p)[2:]

    container = exu.SystemContainer()
    system = container.AddSystem()
    first = {"initialCoordinates": [0.0, 0.0], "initialCoordinates_t": list(start[2:])}
    node = system.AddNode(NodeGenericODE2(referenceCoordinates=list(start[:2]), numberOfODE2Coordinates=2, **first))
    # Accelerations are the force of a unit mass; coordinates are counted from the reference.
    shifted = np.array(start[:2])

    def moved(mbs, t, number, q, q_t):
        return force(mbs, t, number, np.asarray(q) + shifted, q_t)

    system.AddObject(ObjectGenericODE2(nodeNumbers=[node], massMatrix=np.eye(2), forceUserFunction=moved))
    system.Assemble()

    def end(rtol):
        settings = exu.SimulationSettings()
        integration = settings.timeIntegration
        integration.endTime, integration.numberOfSteps = float(case.times[-1]), 200
        integration.automaticStepSize, integration.verboseMode = True, 0
        integration.relativeTolerance, integration.absoluteTolerance = rtol, rtol * 1e-2
        integration.minimumStepSize = 1e-14
        settings.solutionSettings.writeSolutionToFile = False

        def solve():
            if not system.SolveDynamic(settings, solverType=exu.DynamicSolverType.DOPRI5, showHints=False):
                raise GaveUp
            data = system.systemData
            return np.concatenate([np.asarray(data.GetODE2Coordinates()) + shifted, data.GetODE2Coordinates_t()])

        return best(solve)

    return end


def tools(case: Case, program: Any, quick: bool) -> dict[str, tuple[End, tuple[float, ...]]]:
    """By name: what solves a case to its end, and the tolerances that are tried."""
    found: dict[str, tuple[End, tuple[float, ...]]] = {
        f"clearance_jax, {solver}": (ours(case, solver), RTOLS) for solver in list(SOLVERS)[: 1 if quick else None]
    }
    if program is not None:
        found[C] = by_c(case, program), RTOLS
    if peers.installed("numba"):
        for hmax in (0.0,) if quick else (0.0, SHORT):
            found |= {name: (end, PEER_RTOLS) for name, end in by_peers(case, hmax).items()}
        if peers.installed("Exudyn") and not quick:
            found["Exudyn DOPRI5, user function"] = by_exudyn(case), PEER_RTOLS
    return found


def measure(case: Case, quick: bool = False) -> list[Point]:
    """Every tool on a case: points with the error of the positions at the end."""
    points, (truth, size) = [], (case.stored["y"][len(case.times) - 1], np.abs(case.stored["y"]).max(0))
    with tempfile.TemporaryDirectory() as folder:
        for tool, (end, usual) in tools(case, compiled(folder), quick).items():
            for rtol in QUICK if quick else usual:
                try:
                    y, took = end(rtol)
                except GaveUp:
                    break
                errors = np.abs(y - truth) / size
                points.append(
                    Point(
                        case.scene.name,
                        tool,
                        rtol,
                        float(errors[:2].max()),
                        float(errors.max()),
                        *[np.nan] * 2,
                        -1,
                        took,
                        np.nan,
                    )
                )
                if took > 1.0:
                    break
    return points


def tabulate(points: list[Point], suffix: str) -> None:
    """The least times, and what was wanted of them: met or missed."""
    scenes, names = (list(dict.fromkeys(getattr(p, k) for p in points)) for k in ("scene", "tool"))
    rows, verdicts = [], []
    for scene in scenes:
        least = {tool: [cheapest(points_of(points, scene, tool), bound) for bound in BOUNDS] for tool in names}
        rows += [(scene, tool, *map(_time, found)) for tool, found in least.items()]
        verdicts += [line for i, bound in enumerate(BOUNDS) for line in _verdicts(scene, bound, i, least)]
    table(
        ("scene", "tool", *(f"ms to {bound:.0e}" for bound in BOUNDS)), rows, output(f"work_precision_one{suffix}.md")
    )
    say(*verdicts)


def _time(point: Point | None) -> str:
    return "none" if point is None else f"{1e3 * point.seconds:.2f} (rtol {point.rtol:.0e})"


def _verdicts(scene: str, bound: float, i: int, least: dict[str, list[Point | None]]) -> list[str]:
    reached = {tool: found[i].seconds for tool, found in least.items() if found[i] is not None}  # type: ignore[union-attr]
    mine = {tool: took for tool, took in reached.items() if tool.startswith("clearance_jax")}
    others = {t: took for t, took in reached.items() if t not in mine and t != C and not t.startswith("Exudyn")}
    label = f"{scene}, positions within {bound:.0e}:"
    if not mine:
        return [f"{label} not reached by the library: missed"]
    best_tool, took = min(mine.items(), key=lambda item: item[1])
    lines = []
    if C in reached:
        ratio = took / reached[C]
        lines.append(
            f"{label} {best_tool} takes {ratio:.2f} x the time of C (wanted: <= {MOST_OVER_C:g}): "
            f"{_word(ratio <= MOST_OVER_C)}"
        )
    else:
        lines.append(f"{label} C does not reach it, or there is no C compiler: nothing to compare with")
    if others:
        rival, other = min(others.items(), key=lambda item: item[1])
        held = _word(other / took >= LEAST_OVER_PEERS)
        lines.append(f"{label} {other / took:.1f} x faster than {rival} (wanted: >= {LEAST_OVER_PEERS:g}): {held}")
    else:
        lines.append(f"{label} no other tool reaches it (wanted: >= {LEAST_OVER_PEERS:g} x faster): {_word(True)}")
    return lines


def _word(held: bool) -> str:
    return "met" if held else "MISSED"
