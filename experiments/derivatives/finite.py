"""Random scenes, parameters and starts: wherever a motion is found, its derivatives must be finite numbers:
`python -m experiments.derivatives finite`.

Three quarters of the lanes start where a formula could divide by zero: with the pin at the exact centre of the sleeve,
at exact first touch (|e| = c), or in contact without slip. Derivatives are by the numbers drawn and by the start.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.mechanism.state import layout
from experiments.common import CRANK_SPEED, joint5, output, table
from experiments.derivatives.ladder import crank

RTOL = 1e-5
MAX_STEPS, MAX_STEPS_VARIED = 2000, 20_000
"""Attempts allowed to a motion (its lane is left out where it needs more: a heavy, slow impact of low restitution is
stiff) and to motion and derivatives, which must never be what fails.
"""
CHUNKS = 4
"""Batches that a scene's lanes are sorted into by steps, because a batch goes on until its slowest lane ends."""
STARTS = ("anywhere", "exact centre", "exact first touch", "no slip")
SEED = 20240611
SHOWN = 3
RADIUS, SPEED_UP = 0.01, 1.05
"""Pin radius of the drawn scenes; and the largest eccentricity over the clearance."""
CRANK_RADIUS, ROD = 0.05, 0.12
LUGRE_STIFFNESS = 1e4
K = 6.61e10


class Scene(NamedTuple):
    """A mechanism of which numbers are drawn: `ranges` by name, logarithmic (a zero range end draws exact zeros too),
    `start` the states for eccentricity over clearance, direction, rates and kind of start.
    """

    mechanism: cj.Mechanism
    ranges: dict[str, tuple[float, float]]
    start: Callable[..., np.ndarray]
    end: float


class Count(NamedTuple):
    """Outcome of one scene: lanes, motions found, derivatives not found though the motion was, not finite ones."""

    scene: str
    lanes: int
    solved: int
    stopped: int
    bad: int
    worst: str


def crank_start(values, kind, rng) -> np.ndarray:
    """At t = 0 the rod lies along the x axis: eccentric by a fraction of c along it, either way."""
    clearance = values["wrist.radial_clearance"]
    n = clearance.size
    side = rng.choice([-1.0, 1.0], n)
    share = rng.uniform(0, SPEED_UP, n)
    share = np.select([kind == 1, kind == 2, kind == 3], [0.0 * share, 1.0 + 0 * share, 1 + 0.05 * share], share)
    rate = rng.normal(0, 0.5, n) * (kind == 0)
    spin = -CRANK_SPEED * CRANK_RADIUS / ROD - CRANK_SPEED + rng.normal(0, 5.0, n) * (kind == 0)
    still = -CRANK_SPEED * CRANK_RADIUS / (ROD + side * (RADIUS + clearance)) - CRANK_SPEED
    spin = np.where(kind == 3, still, spin)
    return np.stack([0 * share, CRANK_RADIUS + ROD + side * share * clearance, spin, rate], 1)


def pin_start(joint: str):
    """The pin anywhere in its sleeve; without spin, a start without slip has no tangential velocity."""

    def start(values, kind, rng) -> np.ndarray:
        clearance = values[f"{joint}.radial_clearance"]
        n = clearance.size
        # Along an axis |e| = c holds exactly, in any direction only up to round-off.
        angle = np.where(kind >= 2, rng.integers(0, 4, n) * np.pi / 2, rng.uniform(0, 2 * np.pi, n))
        direction = np.stack([np.cos(angle), np.sin(angle)], 1)
        direction = np.where(np.abs(direction) < 1e-9, 0.0, direction)
        share = rng.uniform(0, SPEED_UP, n)
        share = np.select([kind == 1, kind == 2, kind == 3], [0.0 * share, 1.0 + 0 * share, 1 + 0.01 * share], share)
        rate = rng.normal(0, 0.1, (n, 2)) * (kind == 0)[:, None]
        radial = rng.normal(0, 0.1, n) * (kind >= 2)
        return np.concatenate([(share * clearance)[:, None] * direction, rate + radial[:, None] * direction], 1)

    return start


def with_laws(normal, friction) -> cj.Mechanism:
    return crank().with_clearance("wrist", cj.RevoluteClearance(5e-4, RADIUS, normal, friction))


def pin(friction) -> cj.Mechanism:
    joint = cj.RevoluteClearance(1e-4, RADIUS, laws.Hertz(K, 1.5), friction)
    return cj.Mechanism(
        bodies=(cj.Body("pin", 0.14),),
        joints=(
            cj.Revolute("joint", "ground", "pin", motion=cj.Motion(cj.drives.ConstantSpeed(0.0)), clearance=joint),
        ),
        gravity=cj.Gravity(y=-9.81),
    )


def scenes() -> dict[str, Scene]:
    wrist = {
        "wrist.radial_clearance": (1e-5, 1e-3),
        "wrist.normal.stiffness": (1e8, 1e11),
    }
    bodies = {"slider.mass": (0.01, 10.0)}
    mu = (0.0, 0.8)
    tanh = wrist | {"wrist.friction.coefficient": mu, "wrist.normal.damping": (0.0, 1e4)} | bodies
    cubic = wrist | {"wrist.friction.coefficient": mu, "wrist.normal.damping_factor": (0.0, 1.0)} | bodies
    mcphee = wrist | {"wrist.normal.restitution": (0.05, 0.99), "wrist.friction.dynamic_coefficient": mu} | bodies
    lugre = wrist | {"wrist.friction.kinetic_coefficient": (0.05, 0.4)} | bodies
    end = 4e-4
    return {
        "slider-crank, IMPACT, tanh": Scene(crank(), tanh, crank_start, end),
        "slider-crank, Hunt-Crossley, cubic": Scene(
            with_laws(laws.HuntCrossley(K, 0.5), laws.CubicCoulomb(0.3, 1e-2)), cubic, crank_start, end
        ),
        "slider-crank, exact restitution, Brown-McPhee": Scene(
            with_laws(laws.exact_restitution(K, 0.7), laws.BrownMcPhee(0.4, 0.3, 1e-2)), mcphee, crank_start, end
        ),
        "slider-crank, IMPACT, LuGre": Scene(
            with_laws(laws.AdamsImpact(K, 2000.0, 1e-5), laws.LuGre(0.4, 0.3, 1e-3, LUGRE_STIFFNESS, 0.0, 0.0)),
            lugre,
            crank_start,
            end,
        ),
        "joint 5": Scene(
            joint5(),
            {
                "joint5.radial_clearance": (1e-5, 1e-3),
                "joint5.friction.coefficient": mu,
                "joint5.normal.stiffness": (1e9, 1e12),
                "payload.mass": (30.0, 3000.0),
            },
            pin_start("joint5"),
            2e-3,
        ),
        "pin under gravity, Hertz, tanh": Scene(
            pin(laws.TanhCoulomb(0.3, 1e-2)),
            {
                "joint.radial_clearance": (1e-6, 1e-3),
                "joint.normal.stiffness": (1e8, 1e11),
                "joint.friction.coefficient": mu,
                "joint.normal.exponent": (1.0, 2.0),
                "drive.joint.speed": (0.0, 10.0),
            },
            pin_start("joint"),
            2e-3,
        ),
    }


def drawn(low: float, high: float, lanes: int, rng) -> np.ndarray:
    """Logarithmic between the ends; where the lower one is zero a tenth of the lanes is exactly zero."""
    if low > 0:
        return np.exp(rng.uniform(np.log(low), np.log(high), lanes))
    return np.where(rng.uniform(size=lanes) < 0.1, 0.0, rng.uniform(0, high, lanes))


def programs(scene: Scene) -> tuple[Callable, Callable]:
    """Compiled batches: (whether the motion is found, its attempts), and (whether the derivatives by numbers and start
    are found, whether they are finite).
    """
    memory = layout(scene.mechanism).remembered

    def end(point: Any, most: int):
        values, start = point
        y0 = jnp.concatenate([start, jnp.zeros(memory)])
        changed = cj.replace(scene.mechanism, values)
        s = cj.simulate(changed, scene.end, y0=y0, rtol=RTOL, energy_balance=False, max_steps=most, throw=False)
        return s.final, (s.succeeded & jnp.all(jnp.isfinite(s.final)), s.steps + s.rejected)

    def slopes(point):
        found, (succeeded, _) = jax.jacfwd(lambda p: end(p, MAX_STEPS_VARIED), has_aux=True)(point)
        finite = jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(found)])
        return succeeded, jnp.all(finite)

    return jax.jit(jax.vmap(lambda p: end(p, MAX_STEPS)[1])), jax.jit(jax.vmap(slopes))


def count(name: str, scene: Scene, lanes: int, seed: int) -> Count:
    rng = np.random.default_rng(seed)
    values = {key: drawn(*ends, lanes, rng) for key, ends in scene.ranges.items()}
    kind = np.arange(lanes) % len(STARTS)
    if "drive.joint.speed" in values:
        values["drive.joint.speed"] = values["drive.joint.speed"] * (kind != STARTS.index("no slip"))
    point = values, scene.start(values, kind, rng)
    alone, varied = programs(scene)
    found, attempts = (np.asarray(x) for x in alone(point))
    order = np.argsort(attempts)
    order = order[found[order]]
    size = lanes // CHUNKS
    stopped, bad = [], []
    for start in range(0, order.size, size):
        chosen = np.resize(order[start : start + size], size)
        # A short last chunk is filled up with its own lanes.
        reached, finite = (np.asarray(x) for x in varied(jax.tree.map(lambda x, i=chosen: x[i], point)))
        stopped += list(np.unique(chosen[~reached]))
        bad += list(np.unique(chosen[~finite]))
    worst = []
    for lane in [*bad, *stopped][:SHOWN]:
        numbers = ", ".join(f"{key} = {value[lane]:.17g}" for key, value in values.items())
        worst.append(f"{name}, {STARTS[kind[lane]]}: {numbers}, start {point[1][lane].tolist()}")
    return Count(name, lanes, int(found.sum()), len(stopped), len(bad), "\n".join(worst))


def main(quick: bool = False) -> list[Count]:
    every = scenes()
    if quick:
        every = dict(list(every.items())[-1:])
    lanes = 40 if quick else 1668  # of six scenes: ten thousand and a few
    counts = []
    for index, (name, scene) in enumerate(every.items()):
        counts.append(count(name, scene, lanes, SEED + index))
        print(counts[-1], flush=True)
    table(
        ("scene", "lanes", "motions found", "derivatives not found", "derivatives not finite"),
        [c[:-1] for c in counts],
        output(f"derivatives_finite{'_quick' if quick else ''}.md"),
    )
    for c in counts:
        if c.worst:
            print(f"FAILED: {c.worst}")
    return counts
