"""What other tools give for the slider-crank's derivatives after one revolution: `python -m ...sensitivity_baselines`.

    cvodes        CasADi's forward sensitivities in CVODES, on the model written in CasADi's expressions
    differences   central differences of an integrator that knows of no switching: compiled DOP853, or scipy's odeint
    equations     scipy's DOP853 on the variational equations, every evaluation choosing its own mode

Each returns dy (4, 3) as in `variational.py`, unscaled, and the wall time in seconds, the shortest of several. Absolute
tolerances are `rtol` times the size of each component; every tool is told the same sizes.

Tools that agree with each other are not thereby right. Behind the clip the pin moves freely, and just before it leaves
the sleeve the force comes back for about a microsecond, because K d^1.5 outlasts the damping's d^2. Most of the runs
step over that push, and all that do arrive at the same wrong derivatives (9e-3 off at 0.1 mm, 3e-4 at 0.5 mm) with
states good to 1e-5. The rows called `short` bound the step by SHORT to meet it; at 0.5 mm one push of 6e-8 s hides
from them too, and is the 2.5e-6 that remains.
"""

import time
from collections.abc import Callable
from functools import cache, partial

import numpy as np
from scipy.integrate import solve_ivp

from experiments.reference.baselines import Baseline, run_compiled, run_odeint
from experiments.reference.make import CASES, load_variation
from experiments.reference.problems import DAMPING, DEPTH, LAW, PIN_RADIUS, PROBLEMS, TRANSITION, Array
from experiments.reference.variational import COLUMNS, STATES, split, variational_rhs, variational_start

PROBLEM = PROBLEMS["slider_crank"]
REPEATS = 3
SHORT = 1e-6  # s; the push at the end of a contact lasts 1.2e-6 s at 0.1 mm, and 1.3e-6 s and 6e-8 s at 0.5 mm
Sensitivity = tuple[Array, float]


def shortest(solve: Callable[[], Array]) -> Sensitivity:
    """Result of a first run, which may compile, and the shortest of the next ones."""
    result, times = solve(), []
    for _ in range(REPEATS):
        clock = time.perf_counter()
        solve()
        times.append(time.perf_counter() - clock)
    return result, min(times)


# ---- CasADi ---------------------------------------------------------------------------------------------------------

# Neither changes a digit of the force, but both keep infinities out of the first and second derivatives:
ROUND = 1e-24  # m^2, added to |e|^2, which is zero at the start
TOUCH = 1e-30  # m, the least d that the law is asked for
MANY_STEPS = 10**7


def casadi_ode(ca, t, y, c, mu, stiffness, p: Array):
    """The right-hand side of `slider_crank_field` with all modes, in CasADi's expressions."""
    phi, x, phi_dot, x_dot = ca.vertsplit(y)
    w, r, length, rod_mass, rod_inertia, slider_mass = (float(v) for v in p[LAW : LAW + 6])
    rod_x, rod_y, rim = length * ca.cos(phi), length * ca.sin(phi), p[PIN_RADIUS] + c
    ex, ey = x - r * ca.cos(w * t) - rod_x, -r * ca.sin(w * t) - rod_y
    vx, vy = x_dot + r * w * ca.sin(w * t) + phi_dot * rod_y, -r * w * ca.cos(w * t) - phi_dot * rod_x
    distance = ca.sqrt(ex**2 + ey**2 + ROUND)
    nx, ny = ex / distance, ey / distance
    d, d_dot, slip = ca.fmax(distance - c, TOUCH), nx * vx + ny * vy, nx * vy - ny * vx - rim * phi_dot
    s = ca.fmin(d / p[DEPTH], 1)
    step = p[DAMPING] * s**2 * (3 - 2 * s)
    normal = ca.fmax(stiffness * d**1.5 + step * d_dot, 0)
    traction = -mu * ca.tanh(slip / p[TRANSITION]) * normal
    fx, fy = -normal * nx - traction * ny, -normal * ny + traction * nx
    torque = rod_mass * length / 2 * r * w**2 * ca.sin(w * t - phi) - (rod_x + rim * nx) * fy + (rod_y + rim * ny) * fx
    return ca.vertcat(phi_dot, x_dot, torque / (rod_inertia + rod_mass * length**2 / 4), fx / slider_mass)


def cvodes(p: Array, t: Array, rtol: float, size: Array, hmax: float = 0.0) -> Sensitivity | None:
    """Forward sensitivities by CVODES (BDF, exact Jacobian, sensitivities under error control); None without CasADi.

    CVODES takes one absolute tolerance, so states and parameters are scaled to make all components of size one. Without
    a bound on the step, `hmax` is zero.
    """
    try:
        import casadi as ca
    except ImportError:
        print("CasADi is not installed (pip install casadi): no sensitivities by CVODES.")
        return None
    state_size, columns = size[:STATES], size[STATES:].reshape(len(COLUMNS), STATES)
    unit = np.min(state_size / columns, axis=1)
    t_, y_, q_ = ca.SX.sym("t"), ca.SX.sym("y", STATES), ca.SX.sym("q", len(COLUMNS))
    c, mu, stiffness = (float(p[i]) + float(u) * q_[n] for n, (i, u) in enumerate(zip(COLUMNS, unit, strict=True)))
    ode = casadi_ode(ca, t_, y_ * state_size, c, mu, stiffness, p) / state_size
    options = {
        "reltol": rtol,
        "abstol": rtol,
        "max_step_size": hmax,
        "max_num_steps": MANY_STEPS,
        "fsens_err_con": True,
    }
    model = {"t": t_, "x": y_, "p": q_, "ode": ode}
    integrator = ca.integrator("slider_crank", "cvodes", model, float(t[0]), float(t[-1]), options)
    forward = integrator.forward(len(COLUMNS))
    # forward(nominal inputs, nominal outputs, seeds): all three directions in one integration.
    start, zero = PROBLEM.start(p) / state_size, np.zeros(len(COLUMNS))
    names = forward.name_in()
    seeds = {name: ca.DM.zeros(*forward.size_in(name)) for name in names}
    seeds |= {"x0": start, "p": zero, "fwd_p": np.eye(len(COLUMNS))}

    def solve() -> Array:
        return np.array(forward(**seeds)["fwd_xf"]) * state_size[:, None] / unit

    return shortest(solve)


# ---- central differences --------------------------------------------------------------------------------------------


def differences(
    solver: Callable[..., Baseline], p: Array, t: Array, rtol: float, size: Array, step: float, **bounds: float
) -> Sensitivity:
    """Six solutions, every parameter moved by the relative `step` up and down; the wall times add up."""
    columns, seconds = [], 0.0
    for i in COLUMNS:
        ends = []
        for sign in (1, -1):
            moved = p.copy()
            moved[i] *= 1 + sign * step
            run = solver("slider_crank", moved, t[[0, -1]], rtol, size[:STATES], repeats=REPEATS, **bounds)
            seconds += run.seconds
            ends.append((run.y[-1], moved[i]))
        (up, above), (down, below) = ends
        columns.append((up - down) / (above - below))
    return np.stack(columns, axis=1), seconds


# ---- variational equations without switchings -----------------------------------------------------------------------


def equations(p: Array, t: Array, rtol: float, size: Array, hmax: float = np.inf) -> Sensitivity:
    """Scipy's DOP853 on the sixteen compiled equations, stepping over all switchings."""

    def solve() -> Array:
        span, start = (t[0], t[-1]), variational_start(p)
        result = solve_ivp(
            variational_rhs, span, start, "DOP853", args=(p,), rtol=rtol, atol=rtol * size, max_step=hmax
        )
        return split(result.y[:, -1:].T)[1][0]

    return shortest(solve)


# ---- the table ------------------------------------------------------------------------------------------------------

TOLERANCES = (1e-5, 1e-7, 1e-9, 1e-11)
TOOLS: dict[str, Callable[[Array, Array, float, Array], Sensitivity | None]] = {
    "CVODES (CasADi)": cvodes,
    "CVODES (CasADi), short": partial(cvodes, hmax=SHORT),
    "DOP853 compiled, diff 1e-4": partial(differences, run_compiled, step=1e-4),
    "DOP853 compiled, diff 1e-6": partial(differences, run_compiled, step=1e-6),
    "DOP853 compiled, 1e-4, short": partial(differences, run_compiled, step=1e-4, hmax=SHORT),
    "odeint, diff 1e-4": partial(differences, run_odeint, step=1e-4),
    "odeint, diff 1e-6": partial(differences, run_odeint, step=1e-6),
    "odeint, diff 1e-4, short": partial(differences, run_odeint, step=1e-4, hmax=SHORT),
    "DOP853 equations": equations,
    "DOP853 equations, short": partial(equations, hmax=SHORT),
}


@cache
def reference(name: str) -> tuple[Array, Array]:
    """Derivatives at the end (4, 3) and every entry's largest magnitude over time (4, 3)."""
    dy = load_variation(name)["dy"]
    return dy[-1], np.max(np.abs(dy), axis=0)


def component_sizes(name: str) -> Array:
    """The problem's sizes of the four states, then the largest magnitude over time of the twelve derivatives."""
    return np.concatenate([PROBLEM.scale(CASES[name][2]), reference(name)[1].T.ravel()])


def column_errors(name: str, dy: Array) -> Array:
    """Per parameter: the largest error over the states, each over that entry's largest magnitude over time."""
    exact, largest = reference(name)
    return np.max(np.abs(dy - exact) / largest, axis=0)


def cell(name: str, answer: Sensitivity | None) -> str:
    """One entry of the table."""
    if answer is None:
        return f"{'-':>21s}"
    dy, seconds = answer
    return f"{max(column_errors(name, dy)):11.1e} {seconds * 1e3:9.1f}"


def main() -> None:
    """Worst column and wall time of every tool, for both clearances."""
    for name in ("slider_crank_0.5mm", "slider_crank_0.1mm"):
        _, t, p = CASES[name]
        header = "".join(f"{'rtol':>15s} {rtol:.0e}" for rtol in TOLERANCES)
        print(f"\n{name}: worst column error, ms\n{'':28s}{header}")
        for label, tool in TOOLS.items():
            cells = [cell(name, tool(p, t, rtol, component_sizes(name))) for rtol in TOLERANCES]
            print(f"{label:28s}{''.join(cells)}", flush=True)


if __name__ == "__main__":
    main()
