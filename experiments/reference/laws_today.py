"""What every law of the catalogue answers today: `python -m experiments.reference.laws_today` (half a minute).

It writes tests/data/laws_reference.npz, against which a rewrite of the laws can be compared to 1e-14. README of that
file: `normal` holds the rows penetration [m], penetration rate [m/s], memory (impact speed [m/s]); `friction` the rows
slip velocity [m/s], normal force [N], memory (bristle, as a fraction of its scale); the first columns are the grids of
tests/test_laws.py, the others random (seeded). Of a law of tests/catalogue.py, made ready for a pin of 10 mm and a
clearance of 0.5 mm, `LAW.force` is the force or traction in these columns, `LAW.force.NUMBER` its derivative by an
argument (`penetration`, `penetration_rate`, `slip_velocity`, `normal_force`, `memory`) or by one of the law's own
numbers, as its user gives them; `LAW.unclipped`, `LAW.energy`, `LAW.elastic` (the energy's derivative: a force near
zero is a difference of terms of this size), `LAW.memory_rate` with its derivatives, and `LAW.regime` are what they say.
"""

import runpy
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax
from clearance_jax._types import follow, physical_leaves

TESTS = Path(__file__).parents[2] / "tests"
CATALOGUE, FILE = TESTS / "catalogue.py", TESTS / "data" / "laws_reference.npz"
PIN_RADIUS, CLEARANCE = 0.01, 5e-4
RANDOM = 500
NORMAL_ARGUMENTS = ("penetration", "penetration_rate", "memory")
FRICTION_ARGUMENTS = ("slip_velocity", "normal_force", "memory")


def spread(rng: np.random.Generator, low: float, high: float) -> np.ndarray:
    """Random magnitudes, as many in every decade."""
    return np.exp(rng.uniform(np.log(low), np.log(high), RANDOM))


def samples() -> dict[str, np.ndarray]:
    """The rows of arguments: grids first, then random ones."""
    rng = np.random.default_rng(20)
    depths, rates = [-1e-3, -1e-12, 0.0, 1e-12, 1e-9, 1e-6, 1e-5, 3e-5], [-1.0, -1e-3, 0.0, 1e-9, 1.0]
    slips, forces = [-3.0, -1e-2, -1e-5, -1e-12, 0.0, 1e-12, 1e-5, 1e-2, 3.0], [100.0, 0.0]
    d, v = (x.ravel() for x in np.meshgrid(depths, rates))
    s, n = (x.ravel() for x in np.meshgrid(slips, forces))

    def signs(positive: float):
        return np.where(rng.uniform(size=RANDOM) < positive, 1.0, -1.0)

    normal = [signs(0.9) * spread(rng, 1e-12, 1e-4), signs(0.5) * spread(rng, 1e-6, 5.0), spread(rng, 1e-4, 3.0)]
    friction = [signs(0.5) * spread(rng, 1e-12, 10.0), spread(rng, 1e-3, 1e5), rng.uniform(-1, 1, RANDOM)]
    return {
        "normal": np.hstack([[d, v, np.full_like(d, 0.3)], normal]),
        "friction": np.hstack([[s, n, np.zeros_like(s)], friction]),
    }


def with_derivatives(of: Callable, law, names: tuple[str, ...], arguments, quantity: str) -> dict[str, np.ndarray]:
    """`of(law, *arguments)` in every column, and its derivatives by each argument and each number of the law."""
    numbers = {leaf.name: leaf for leaf in physical_leaves(law)}

    def of_numbers(values, *columns):
        leaves, tree = jax.tree.flatten(law)
        places = {id(follow(law, leaf.path)): name for name, leaf in numbers.items()}
        return of(jax.tree.unflatten(tree, [values[places[id(leaf)]] for leaf in leaves]), *columns)

    values = {name: jnp.asarray(leaf.value) for name, leaf in numbers.items()}
    of_columns = jax.vmap(jax.value_and_grad(of_numbers, (0, 1, 2, 3)), (None, 0, 0, 0))
    value, (by_numbers, *by_arguments) = jax.jit(of_columns)(values, *arguments)
    slopes = dict(zip(names, by_arguments, strict=True)) | by_numbers
    if not law.remembers:
        del slopes["memory"]
    return {quantity: value} | {f"{quantity}.{name}": slope for name, slope in slopes.items()}


def normal_law(law, columns: np.ndarray) -> dict[str, np.ndarray]:
    remembers = len(law.remembers)

    def ready(law):
        return law.prepared(jnp.asarray(PIN_RADIUS), jnp.asarray(CLEARANCE))

    def force(law, d, v, memory):
        return ready(law)(d, v, memory[None][:remembers])

    arguments = [jnp.asarray(row) for row in columns]
    d, v, memory = arguments
    out = with_derivatives(force, law, NORMAL_ARGUMENTS, arguments, "force")
    now, held = ready(law), memory[:, None][:, :remembers]
    out["unclipped"] = jax.vmap(now.unclipped)(d, v, held)
    out["energy"], out["elastic"] = jax.vmap(jax.value_and_grad(now.energy))(d)
    out["regime"] = jax.vmap(now.regime)(d, v, held)
    return out


def friction_law(law, columns: np.ndarray) -> dict[str, np.ndarray]:
    remembers = len(law.remembers)
    scale = law.memory_scale()[0] if remembers else jnp.asarray(1.0)

    def ready(law):
        return law.prepared(jnp.asarray(PIN_RADIUS), jnp.asarray(CLEARANCE))

    def traction(law, s, n, memory):
        return ready(law)(s, n, memory[None][:remembers])

    def memory_rate(law, s, n, memory):
        return ready(law).memory_rate(s, n, memory[None])[0]

    s, n, fraction = (jnp.asarray(row) for row in columns)
    arguments = s, n, fraction * scale
    out = with_derivatives(traction, law, FRICTION_ARGUMENTS, arguments, "force")
    if remembers:
        out |= with_derivatives(memory_rate, law, FRICTION_ARGUMENTS, arguments, "memory_rate")
    if law.regime(s[0]) is not None:
        out["regime"] = jax.vmap(law.regime)(s)
    return out


def answers(columns) -> dict[str, np.ndarray]:
    """Every law's values in the given columns (`samples()`, or an opened file that has them)."""
    laws = runpy.run_path(str(CATALOGUE))
    groups = (laws["NORMAL"], normal_law, "normal"), (laws["FRICTION"], friction_law, "friction")
    return {
        f"{name}.{quantity}": np.asarray(values)
        for members, answer, rows in groups
        for name, law in members.items()
        for quantity, values in answer(law, columns[rows]).items()
    }


def main(quick: bool = False) -> None:
    columns = samples()
    found = answers(columns)
    if not quick:
        FILE.parent.mkdir(exist_ok=True)
        np.savez_compressed(FILE, **columns, **found)
        print(f"{len(found)} arrays, {FILE.stat().st_size / 1024:.0f} KiB")


if __name__ == "__main__":
    clearance_jax.configure()
    main()
