"""From a solution to a labelled dataset: variables with units, provenance, contact episodes."""

from importlib.metadata import version
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from clearance_jax.dynamics.field import observe, rate
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism, parameters
from clearance_jax.results.variables import EPISODES, STEPS, VARIABLES, Variable, attributes, labels
from clearance_jax.solve.flow import Solution
from clearance_jax.solve.trace import Trace

_observe = eqx.filter_jit(
    lambda mechanism, time, y: jax.vmap(lambda t, y: observe(t, y, mechanism.prepared()))(time, y)
)


@eqx.filter_jit
def _force_rate(mechanism, time, y):
    """Time derivative of every contact force along the motion [N/s]."""
    ready = mechanism.prepared()

    def at(t, y):
        along = jnp.ones_like(t), rate(t, y, ready)
        return jax.jvp(lambda t, y: observe(t, y, ready)["contact_force"], (t, y), along)[1]

    return jax.vmap(at)(time, y)


def to_dataset(mechanism: Mechanism, solution: Solution | Trace, **provenance: Any) -> xr.Dataset:
    """Everything observable of a solution as an `xarray.Dataset`.

    A `Trace` also gives contact episodes and the three contact states (an impact is recognised by its episode).

    **Arguments:** `provenance`: anything to be kept as attributes beside version, result and counts.
    """
    traced = solution if isinstance(solution, Trace) else None
    solved = traced.solution if traced else solution
    assert isinstance(solved, Solution)
    if solved.time.ndim != 1:
        raise ClearanceError(
            f"A dataset holds one solve, but this is a batch of shape {solved.time.shape[:-1]}. Take one lane: "
            "`jax.tree.map(lambda x: x[i], solution)`."
        )
    reached = np.isfinite(np.asarray(solved.time))
    if not reached.all():  # a solve that stopped early: keep what it computed
        solved = eqx.tree_at(lambda s: (s.time, s.y), solved, (solved.time[reached], solved.y[reached]))
    seen = {k: np.asarray(v) for k, v in _observe(mechanism, solved.time, solved.y).items()}
    joints = mechanism.clearance_joints()
    labelled = labels(mechanism)
    episodes: dict[str, Any] = {}
    steps: dict[str, Any] = {}
    if joints:
        impacts = []
        if traced is not None and traced.time.size > 1:
            at_steps = {k: np.asarray(v) for k, v in _observe(mechanism, traced.time, traced.y).items()}
            episodes, impacts = contact_episodes(mechanism, traced, at_steps)
            steps = {
                "step_time": traced.time,
                "step_eccentricity": at_steps["eccentricity"],
                "step_force": at_steps["contact_force"],
                "step_state": contact_states(traced.time, at_steps["penetration"], impacts),
            }
        seen["contact_state"] = contact_states(np.asarray(solved.time), seen["penetration"], impacts)
    data = _variables("time", seen, VARIABLES, labelled)
    data |= _variables("step", steps, STEPS, labelled) | _variables("episode", episodes, EPISODES, labelled)
    used = {dim for dims, _, _ in data.values() for dim in dims}
    coords: dict[str, Any] = {"time": ("time", np.asarray(solved.time), {"units": "s"})}
    coords |= {name: label for name, label in labelled.items() if label[0] in used}
    attrs = {
        "software": f"clearance_jax {version('clearance-jax')}",
        "mechanism": mechanism.name,
        "result": (traced.message if traced else solved.message) or "successful",
        "accepted_steps": int(solved.steps),
        "rejected_steps": int(solved.rejected),
        "energy_residual": float(solved.energy_residual),
        **{f"parameter.{n}": np.asarray(leaf.value) for n, leaf in parameters(mechanism).items()},
        **provenance,
    }
    return xr.Dataset(data, coords, attrs)


def _variables(first: str, values: dict[str, Any], described: dict[str, Variable], labelled) -> dict[str, tuple]:
    """Xarray's (dimensions, values, attributes) of every value; `first` is the leading dimension."""
    out = {}
    for name, value in values.items():
        variable = described[name]
        out[name] = ((first, *variable.dims), np.asarray(value), attributes(variable, labelled))
    return out


def contact_states(time, penetration, impacts: list[tuple[int, float, float]]) -> np.ndarray:
    """0 free, 1 contact, 2 impact, for times and penetrations (time, joint)."""
    touching = penetration > 0
    states = touching.astype(np.int8)
    for joint, begin, end in impacts:
        states[(time >= begin) & (time <= end) & touching[:, joint], joint] = 2
    return states


def contact_episodes(mechanism: Mechanism, trace: Trace, seen: dict[str, np.ndarray]) -> tuple[dict[str, list], list]:
    """The table of contact episodes from what was `seen` at the step ends, and for each the interval in which it is an
    impact, (joint, begin, end).

    Step ends lie on every touch and separation. A peak is the top of the cubic through force and rate at the step ends
    around it. An impact lasts until separation, or, where contact goes on, until the penetration has been
    through one compression and restitution (the second change of sign of its rate), or the rate has died away.
    """
    rates = np.asarray(_force_rate(mechanism, trace.time, trace.y))
    table: dict[str, list] = {name: [] for name in EPISODES}
    impacts = []
    for joint in range(seen["penetration"].shape[1]):
        touching = np.concatenate([[False], seen["penetration"][:, joint] > 0, [False]])
        begins = np.flatnonzero(touching[1:] & ~touching[:-1])
        ends = np.flatnonzero(~touching[1:] & touching[:-1])
        # A touch within round-off of the sleeve's surface may read as apart at one step end: not a separation.
        for begin, end in _merged(trace.time, begins, ends):
            part = slice(begin, min(end + 1, trace.time.size))
            t, force, speed = (
                trace.time[part],
                seen["contact_force"][part, joint],
                seen["penetration_rate"][part, joint],
            )
            open_ended = bool(end >= trace.time.size)
            peak_time, peak = _peak(t, force, rates[part, joint])
            table["episode_joint"].append(joint)
            table["episode_start"].append(t[0])
            table["episode_end"].append(np.nan if open_ended else t[-1])
            table["impact_speed"].append(speed[0])
            table["peak_force"].append(peak)
            table["peak_time"].append(peak_time)
            table["restitution"].append(np.nan if open_ended or speed[0] <= 0 else -speed[-1] / speed[0])
            impacts.append((joint, t[0], _impact_end(t, speed, open_ended)))
    return table, impacts


def _merged(time, begins, ends):
    """Episodes with gaps and lengths below 1e-12 s taken away."""
    out: list[list[int]] = []
    for begin, end in zip(begins, ends, strict=True):
        if out and time[begin] - time[min(out[-1][1], time.size - 1)] < 1e-12:
            out[-1][1] = end
        else:
            out.append([begin, end])
    return [(b, e) for b, e in out if e >= time.size or time[e] - time[b] > 1e-12]


def _peak(t, force, rate) -> tuple[float, float]:
    """Time and height of the largest force: over the step ends, and the tops of the cubic Hermite pieces between."""
    rising = (rate[:-1] > 0) & (rate[1:] < 0)
    h, a, b = np.diff(t)[rising], (rate[:-1] * np.diff(t))[rising], (rate[1:] * np.diff(t))[rising]
    rise = np.diff(force)[rising]
    # p(s) = f0 + a s + (3 rise - 2a - b) s^2 + (a + b - 2 rise) s^3; p' changes sign once, from a > 0 to b < 0.
    cubic, square = a + b - 2 * rise, 3 * rise - 2 * a - b
    s = a / (-square + np.sqrt(square * square - 3 * cubic * a))
    tops = force[:-1][rising] + s * (a + s * (square + s * cubic))
    times, heights = np.concatenate([t, t[:-1][rising] + s * h]), np.concatenate([force, tops])
    k = int(np.argmax(heights))
    return float(times[k]), float(heights[k])


def _impact_end(t, rate, open_ended: bool) -> float:
    """Second change of sign of the rate, or where it has fallen below 5 % of the impact speed for as long as the impact
    had lasted until then; separation at the latest.
    """
    end = t[-1]
    turns = np.flatnonzero(np.sign(rate[1:]) != np.sign(rate[:-1]))
    if turns.size >= 2:
        end = min(end, t[turns[1] + 1])
    lively = np.flatnonzero(np.abs(rate) >= 0.05 * abs(rate[0]))
    pauses = np.flatnonzero(np.diff(lively) > 1)
    for last, following in zip(lively[pauses], lively[pauses + 1], strict=True):
        if t[following] - t[last] >= t[last] - t[0]:
            return float(min(end, t[last]))
    return float(min(end, t[lively[-1]] if open_ended else end))
