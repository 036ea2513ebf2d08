"""Composite bodies compared with articulated bodies (two algorithms of forward dynamics): `python -m
experiments.forward_dynamics` writes out/forward_dynamics.md.

The programs compute accelerations of free arms of 3 to 54 revolute joints, under gravity, in random positions with
random loads. The library uses composite bodies and a factored mass matrix: a program with one operation for each number
up to 16 coordinates, and loops over the links above. Articulated bodies (Featherstone 2008, section 7.3) are written
here in the world's axes, as one program for two kinds of numbers: single numbers, as in the library, up to eight
coordinates, and arrays of 3 by 3 in loops over the links. All programs take the numbers of the arm as arguments.
Evaluations are timed in a loop inside one program, as in a solve: each starts from the state to which the last one
leads. They are timed *alone*, and as *a lane of N*: one motion of a batch of N. *Compile* is the compile time of one
evaluation of 64 lanes. *Operations* is the compiler's count of the operations for one lane, if the program has no
loops. *Error* is the largest difference from the library's accelerations, relative to the largest acceleration.

MuJoCo and pinocchio evaluate the same arms, read from URDF text, with one call from Python for each state.
`PINOCCHIO_PYTHON` names the interpreter of an environment with the packages `pin` and `mujoco`, which are no
dependencies of this project (`python -m venv there; there/bin/pip install pin mujoco`). A missing package is left out
of the comparison.
"""

import functools
import json
import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.compilation_cache import compilation_cache

import clearance_jax as cj
from clearance_jax._compile.barriers import sharing, with_barriers
from clearance_jax._compile.one_function import one_function
from clearance_jax.dynamics.field import rate
from clearance_jax.mechanism.prepared import PreparedMechanism
from experiments.common import output, seconds, table
from experiments.publish import command, say

WORKER = Path(__file__).parent / "reference" / "arms_of_others.py"
GRAVITY = 9.81
# Evaluations of a loop: some milliseconds.
EVALUATIONS, ROUNDS = 16384, 30
SIZES = 3, 6, 7, 12, 30, 54
# More unrolled links than this take the compiler minutes.
MOST_UNROLLED = 8


class Link(NamedTuple):
    """A link's joint in its parent (turned by `orientation`, about its z axis), and its inertia about its centre."""

    place: Any
    orientation: Any
    mass: Any
    centre: Any
    inertia: Any


class Row(NamedTuple):
    """What an evaluation costs [s], alone and a lane, and how far it is from ours."""

    coordinates: int
    program: str
    compiled: float
    alone: float
    lanes: dict[int, float]
    operations: float | None
    error: float


# Arms -----------------------------------------------------------------------------------------------------------------


def rotation(rpy) -> np.ndarray:
    """Of roll, pitch and yaw."""
    (a, b, c), (d, e, f) = np.cos(rpy), np.sin(rpy)
    x = np.array([[1, 0, 0], [0, a, -d], [0, d, a]])
    y = np.array([[b, 0, e], [0, 1, 0], [-e, 0, b]])
    return np.array([[c, -f, 0], [f, c, 0], [0, 0, 1]]) @ y @ x


def arm(n: int) -> tuple[str, Link]:
    """An arm as URDF text, and as arrays with the links along their first axis."""
    rng, links, text = np.random.default_rng(n), [], ['<robot name="arm"><link name="base"/>']
    for i in range(n):
        place, rpy, centre = 0.3 * rng.normal(size=3), rng.uniform(-1.5, 1.5, 3), 0.1 * rng.normal(size=3)
        points, mass = 0.1 * rng.normal(size=(6, 3)), rng.uniform(1.0, 5.0)
        points -= points.mean(0)
        inertia = mass / 6 * (np.sum(points**2) * np.eye(3) - points.T @ points)
        links.append(Link(place, rotation(rpy), mass, centre, inertia))
        six = zip(("xx", "yy", "zz", "xy", "xz", "yz"), inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], strict=True)
        text.append(
            f'<link name="link{i}"><inertial><origin xyz="{written(centre)}"/><mass value="{float(mass)!r}"/><inertia '
            + " ".join(f'i{key}="{float(value)!r}"' for key, value in six)
            + f'/></inertial></link><joint name="joint{i}" type="continuous">'
            f'<origin xyz="{written(place)}" rpy="{written(rpy)}"/>'
            f'<parent link="{f"link{i - 1}" if i else "base"}"/><child link="link{i}"/><axis xyz="0 0 1"/></joint>'
        )
    return "".join([*text, "</robot>"]), Link(*(jnp.asarray(np.stack(part)) for part in zip(*links, strict=True)))


def written(numbers) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def loaded(text: str) -> cj.Mechanism:
    """The arm by URDF."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text(text, encoding="utf-8")
        return cj.load_urdf(path)


# Articulated bodies ---------------------------------------------------------------------------------------------------


class Motion(NamedTuple):
    """Of a link in the world's axes, without the accelerations of the coordinates: its rotation, its pivot, the axis of
    its joint; spin, its rate, and the pivot's acceleration (at rest it is that of free fall, upwards).
    """

    rotation: Any
    pivot: Any
    axis: Any
    spin: Any
    spin_rate: Any
    acceleration: Any


class Articulated(NamedTuple):
    """Inertia of a link and what hangs on it, about its pivot: (torque, force) = ((turning, coupling), (coupling^T,
    mass)) (spin rate, acceleration); and the torque and force on it.
    """

    turning: Any
    coupling: Any
    mass: Any
    torque: Any
    force: Any


def stacked(xp, rows):
    """Along a new first axis."""
    if xp is jnp:
        return jnp.stack(rows)
    out = np.empty((len(rows), *np.shape(rows[0])), dtype=object)
    for i, row in enumerate(rows):
        out[i] = row
    return out


def times(vector, number):
    """A vector or matrix times a number, which numpy would not multiply with objects."""
    return number * vector if isinstance(vector, jax.Array) else np.frompyfunc(lambda x: number * x, 1, 1)(vector)


def cross(xp, a, b):
    """A cross product; of each column, where b is a matrix."""
    pairs = ((1, 2), (2, 0), (0, 1))
    return stacked(xp, [times(b[j], a[i]) - times(b[i], a[j]) for i, j in pairs])


def moved(xp, link: Link, before: Motion, q, v) -> Motion:
    """A link's motion by that of the link before it."""
    arm_ = before.rotation @ link.place
    x, y, z = (before.rotation @ link.orientation).T
    cosine, sine = jnp.cos(q), jnp.sin(q)
    turned = stacked(xp, [times(x, cosine) + times(y, sine), times(y, cosine) - times(x, sine), z]).T
    carried = cross(xp, before.spin_rate, arm_) + cross(xp, before.spin, cross(xp, before.spin, arm_))
    return Motion(
        turned,
        before.pivot + arm_,
        z,
        before.spin + times(z, v),
        before.spin_rate + times(cross(xp, before.spin, z), v),
        before.acceleration + carried,
    )


def own(xp, link: Link, at: Motion) -> Articulated:
    """What a link alone adds."""
    centre, unit = at.rotation @ link.centre, xp.eye(3)
    inertia = at.rotation @ link.inertia @ at.rotation.T
    acceleration = at.acceleration + cross(xp, at.spin_rate, centre)
    acceleration = acceleration + cross(xp, at.spin, cross(xp, at.spin, centre))
    force = times(acceleration, -link.mass)
    torque = cross(xp, centre, force) - inertia @ at.spin_rate - cross(xp, at.spin, inertia @ at.spin)
    coupling = times(cross(xp, centre, unit), link.mass)
    return Articulated(inertia - cross(xp, centre, coupling), coupling, times(unit, link.mass), torque, force)


def reduced(xp, whole: Articulated, axis):
    """What of a link its joint hands on; its column U, one over its inertia about the axis, and the torque about it."""
    turning, coupling = whole.turning @ axis, axis @ whole.coupling
    inverse, load = 1.0 / (axis @ turning), axis @ whole.torque
    handed = Articulated(
        whole.turning - xp.outer(turning, times(turning, inverse)),
        whole.coupling - xp.outer(turning, times(coupling, inverse)),
        whole.mass - xp.outer(coupling, times(coupling, inverse)),
        whole.torque - times(turning, inverse * load),
        whole.force - times(coupling, inverse * load),
    )
    return handed, (turning, coupling, inverse, load)


def shifted(xp, part: Articulated, by) -> Articulated:
    """The same about a pivot from which `by` leads to the old one."""
    coupling = part.coupling + cross(xp, by, part.mass)
    turning = part.turning + cross(xp, by, part.coupling.T).T + cross(xp, by, coupling.T)
    return Articulated(turning, coupling, part.mass, part.torque + cross(xp, by, part.force), part.force)


def accelerated(xp, column, axis, spin_rate, acceleration):
    """A joint's acceleration by those that its parent gives its link, and the link's spin rate."""
    turning, coupling, inverse, load = column
    rate = inverse * (load - turning @ spin_rate - coupling @ acceleration)
    return rate, spin_rate + times(axis, rate)


def ground(xp) -> Motion:
    """Accelerated upwards: its weight then acts on whatever stands on it."""
    nothing, up = np.zeros(3), np.array([0.0, 0.0, GRAVITY])
    made = (np.eye(3), nothing, np.array([0.0, 0.0, 1.0]), nothing, nothing, up)
    return Motion(*(part if xp is np else jnp.asarray(part) for part in made))


def once(tree):
    """The same numbers, computed once each (see `clearance_jax._compile.barriers`), in arrays of objects too."""
    return jax.tree.map(
        lambda x: np.frompyfunc(with_barriers, 1, 1)(x) if isinstance(x, np.ndarray) else with_barriers(x), tree
    )


def by_numbers(links: Link, q, v):
    """Articulated bodies, every number for itself."""

    def taken(array):
        out = np.empty(array.shape, dtype=object)
        for place in np.ndindex(*array.shape):
            out[place] = array[place]
        return out

    n, every = len(q), Link(*(taken(part) for part in links))
    chain, motions, at = [Link(*(part[i] for part in every)) for i in range(n)], [], ground(np)
    for link, qi, vi in zip(chain, q, v, strict=True):
        at = once(moved(np, link, at, qi, vi))
        motions.append(at)
    handed, columns = None, [()] * n
    for i in reversed(range(n)):
        whole = once(own(np, chain[i], motions[i]))
        if handed is not None:
            beyond = once(shifted(np, handed, motions[i + 1].pivot - motions[i].pivot))
            whole = once(Articulated(*(a + b for a, b in zip(whole, beyond, strict=True))))
        handed, columns[i] = once(reduced(np, whole, motions[i].axis))
    spin_rate, acceleration, pivot, rates = np.zeros(3), np.zeros(3), np.zeros(3), []
    for i, at in enumerate(motions):
        acceleration = acceleration + cross(np, spin_rate, at.pivot - pivot)
        found, spin_rate = once(accelerated(np, columns[i], at.axis, spin_rate, acceleration))
        pivot = at.pivot
        rates.append(found)
    return rates


def by_arrays(links: Link, q, v):
    """Articulated bodies, vectors and matrices as arrays, links in loops."""

    def outward(before, given):
        link, qi, vi = given
        at = moved(jnp, link, before, qi, vi)
        return at, (at, at.pivot - before.pivot)

    _, (motions, arms) = jax.lax.scan(outward, ground(jnp), (links, jnp.stack(q), jnp.stack(v)))
    parts = jax.vmap(functools.partial(own, jnp))(links, motions)

    def inward(beyond, given):
        part, axis, arm_ = given
        handed, column = reduced(jnp, jax.tree.map(jnp.add, part, beyond), axis)
        return shifted(jnp, handed, arm_), column

    nothing = jax.tree.map(lambda part: jnp.zeros(part.shape[1:]), parts)
    _, columns = jax.lax.scan(inward, nothing, (parts, motions.axis, arms), reverse=True)

    def last(carry, given):
        column, axis, arm_ = given
        spin_rate, acceleration = carry
        acceleration = acceleration + cross(jnp, spin_rate, arm_)
        rate, spin_rate = accelerated(jnp, column, axis, spin_rate, acceleration)
        return (spin_rate, acceleration), rate

    found = jax.lax.scan(last, (jnp.zeros(3), jnp.zeros(3)), (columns, motions.axis, arms))[1]
    return [found[i] for i in range(len(q))]


# Measured -------------------------------------------------------------------------------------------------------------


def by_field(mechanism: PreparedMechanism, q, v):
    """Ours."""
    return list(rate(jnp.zeros(()), (*q, *v), mechanism)[len(q) :])


def random_states(n: int, count: int) -> tuple[Any, Any]:
    """Positions and rates, rows of lanes: (n, count) each."""
    rng = np.random.default_rng(1)
    return jnp.asarray(rng.uniform(-3.0, 3.0, (n, count))), jnp.asarray(rng.normal(size=(n, count)))


def over_lanes(accelerations: Callable) -> Any:
    """As a solve of a batch maps it: rows in, rows out, what is shared is computed once."""

    def rows(numbers, q, v):
        with sharing():
            return accelerations(numbers, q, v)

    return jax.jit(jax.vmap(rows, (None, 0, 0)))


def measured(program: str, accelerations: Callable, numbers: Any, n: int, batches: tuple[int, ...], known) -> Row:
    """An implementation's costs; `known`: the accelerations of the first batch."""
    over, lanes, found, compiled, operations = over_lanes(accelerations), {}, known, 0.0, None
    for count in batches:
        states = [list(part) for part in random_states(n, count)]
        if count == batches[0]:
            ready, compiled = compiled_anew(over.lower(numbers, *states))
            found = np.stack(ready(numbers, *states))
            counted: Any = ready.cost_analysis()
            operations = None if " while(" in ready.as_text() else float(counted["flops"]) / count
        lanes[count] = one_after_the_other(over, numbers, states, EVALUATIONS // count) / count
    single = [list(part[:, 0]) for part in random_states(n, 1)]
    alone = one_after_the_other(accelerations, numbers, single, EVALUATIONS // 10)
    return Row(n, program, compiled, alone, lanes, operations, off(found, known))


def compiled_anew(lowered) -> tuple[Any, float]:
    """A compiled program, and how long that takes [s] where no cache knows it."""
    settings: Any = jax.config
    cached = settings.jax_enable_compilation_cache
    settings.update("jax_enable_compilation_cache", False)
    compilation_cache.reset_cache()
    clock = time.perf_counter()
    ready = lowered.compile()
    clock = time.perf_counter() - clock
    settings.update("jax_enable_compilation_cache", cached)
    compilation_cache.reset_cache()
    return ready, clock


def one_after_the_other(accelerations: Callable, numbers: Any, state: Any, count: int) -> float:
    """What an evaluation takes [s], of many."""

    @jax.jit
    @one_function
    def all_of_them(numbers, q, v):
        def following(_, q):
            # The next state hangs on this evaluation, and stays where it was.
            return [a + 1e-12 * b for a, b in zip(q, accelerations(numbers, q, v), strict=True)]

        return jax.lax.fori_loop(0, count, following, q)

    return seconds(functools.partial(all_of_them, numbers, *state), ROUNDS) / count


def off(found: np.ndarray, known: np.ndarray) -> float:
    """The largest difference, relative to the largest number."""
    return float(np.max(np.abs(found - known)) / np.max(np.abs(known)))


def of_others(text: str, n: int) -> list[tuple[str, float, np.ndarray]]:
    """What MuJoCo and pinocchio take for an evaluation [s], and their accelerations of the batch of 64."""
    interpreter = os.environ["PINOCCHIO_PYTHON"]
    q, v = (np.asarray(part).T.tolist() for part in random_states(n, 64))
    given = json.dumps({"urdf": text, "q": q, "v": v})
    ended = subprocess.run([interpreter, str(WORKER)], input=given, capture_output=True, text=True, check=False)
    if ended.returncode:
        raise RuntimeError(f"{interpreter} could not evaluate the arm: {ended.stderr[-2000:]}")
    found = json.loads(ended.stdout)
    for name in found["missing"] if n == SIZES[0] else ():
        say(f"{name} is left out: `{interpreter} -m pip install {name}` installs it.")
    return [(one["program"], one["seconds"], np.array(one["accelerations"]).T) for one in found["measured"]]


def main(quick: bool = False) -> list[Row]:
    """Write the table."""
    batches, rows, cells = (64,) if quick else (64, 4096), [], []
    interpreter = os.environ.get("PINOCCHIO_PYTHON")
    if not interpreter:
        say("MuJoCo and pinocchio are left out: name an interpreter that has `mujoco` and `pin` by PINOCCHIO_PYTHON.")
    for n in (3,) if quick else SIZES:
        text, links = arm(n)
        ready = loaded(text).prepare()
        known = np.stack(over_lanes(by_field)(ready, *(list(part) for part in random_states(n, batches[0]))))
        programs: list[tuple[str, Callable, Any]] = [("composite bodies (ours)", by_field, ready)]
        if n <= MOST_UNROLLED:
            programs.append(("articulated bodies, numbers", by_numbers, links))
        programs.append(("articulated bodies, arrays", by_arrays, links))
        for name, accelerations, numbers in programs:
            rows.append(measured(name, accelerations, numbers, n, batches, known))
            print(rows[-1], flush=True)
            row = rows[-1]
            each = [f"{1e6 * row.lanes[count]:.3g}" for count in batches]
            counted = "" if row.operations is None else f"{row.operations:.0f}"
            shown = f"{row.compiled:.1f}", f"{1e6 * row.alone:.3g}", *each, counted, f"{row.error:.0e}"
            cells.append((n, name, *shown))
        for name, cost, found in of_others(text, n) if interpreter and not quick else ():
            cells.append((n, name, "", f"{1e6 * cost:.3g}", *("" for _ in batches), "", f"{off(found, known):.0e}"))
    lanes = [f"a lane of {count} [us]" for count in batches]
    head = ("coordinates", "program", "compile [s]", "alone [us]", *lanes, "operations", "error")
    table(head, cells, output(f"forward_dynamics{'_quick' if quick else ''}.md"))
    return rows


if __name__ == "__main__":
    command(main, __doc__)
