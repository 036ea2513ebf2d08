"""Scenes by the library and by the second simulator: states, extremes, energies, contacts and a derivative.

Tolerances follow from the library's `rtol`: a quantity may be off by `AMPLIFIED * rtol` of its size and of what a
number of the scene changes in it (contacts amplify errors, and the derivative by a number tells how much).
"""

from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj

from . import trains
from .ingredients import JUMPING
from .motion import Motion, Solution
from .scenes import RESTART, Scene, changed, toml, value

RTOL, AMPLIFIED = 1e-9, 1e3
# The library smooths a worn bore over its sectors; the second simulator takes the profile as it is.
WORN = 300.0
# Relative steps of two central differences: noise shows in the short one, curvature and kinks in the long one. What
# they differ by may be the error of the short one, but no more of the derivative's largest value than `BLURRED`.
STEPS, DIFFERENCE, BLURRED = (1e-4, 4e-4), 1e-4, 0.02
# What is next to nothing beside others of its kind counts as so much of these.
LITTLE = 1e-3
OPTIONS = {"rtol": RTOL, "solver": "dopri8"}
ENERGIES = ("kinetic_energy", "potential_energy", "elastic_energy", "drive_work", "friction_loss", "damping_loss")


class Finding(NamedTuple):
    """A comparison: what, the difference over what is allowed (1 is the limit), and both values where it is largest."""

    what: str
    ratio: float
    library: float
    second: float


class Truth(NamedTuple):
    """The second simulator's motion, and the change of its quantities with the relative change of a number; `errors`:
    of these changes, where they were measured by central differences.
    """

    motion: Solution
    senses: dict[str, np.ndarray]
    errors: dict[str, np.ndarray] | None = None


def truth(scene: Scene, like: Truth | None = None) -> Truth:
    """The second simulator's answer; where a scene is `like` another, a number changes as much as there, over its size:
    this is good enough for a tolerance.
    """

    def motion(number):
        return Motion(changed(scene.tables, scene.keys, number), scene.t1).run(scene.times)

    p = value(scene.tables, scene.keys)
    if like is not None:
        here = motion(p)
        sizes, changes, others = _largest(here.values), _largest(like.senses), _largest(like.motion.values)
        shares = {kind: changes[kind] / others[kind] if others[kind] else 1.0 for kind in sizes}
        typical = {kind: shares[kind] * size for kind, size in sizes.items()}
        return Truth(here, {name: np.full(one.shape, typical[_kind(name)]) for name, one in here.values.items()})

    def difference(step):
        low, high = (motion(p * (1 + k * step)).values for k in (-1, 1))
        return {name: (high[name] - low[name]) / (2 * step) for name in low}

    short, long = map(difference, STEPS)
    return Truth(motion(p), short, {name: np.abs(short[name] - long[name]).max() for name in short})


def compare(scenes: list[Scene], folder: Path, contacts: bool = True, derivatives: int = 10**6) -> list[Finding]:
    """All comparisons of scenes that differ in their numbers alone, the worst first; `contacts`: also of episodes;
    `derivatives`: of so many of the scenes.
    """
    out, first = [], None
    mechanisms = [_load(scene, folder) for scene in scenes]
    answers = library(mechanisms, scenes)
    for lane, (scene, mechanism) in enumerate(zip(scenes, mechanisms, strict=True)):
        exact = truth(scene, first if lane >= derivatives else None)
        first = first or exact
        values, slopes = (jax.tree.map(lambda leaf, lane=lane: np.asarray(leaf[lane]), answer) for answer in answers)
        out += [*_values(scene, values, slopes, exact), balance(exact.motion)]
        if contacts:
            out += episodes(mechanism, scene, exact)
    if scenes[0].case["bore"] == "worn":
        out = [one._replace(ratio=one.ratio / (1.0 if one.what.startswith("number") else WORN)) for one in out]
    return sorted(out, key=lambda one: -one.ratio)


def _load(scene: Scene, folder: Path):
    path = folder / "scene.toml"
    path.write_text(toml(scene.tables))
    return cj.load(path)


def _values(scene: Scene, values, slopes, exact: Truth) -> list[Finding]:
    out, sizes, changes = [], _largest(exact.motion.values), _largest(exact.senses)
    for name, found in values.items():
        right, sense = (_alike(these[name], found) for these in (exact.motion.values, exact.senses))
        size, change = (
            max(np.abs(one).max(), LITTLE * largest[_kind(name)]) for one, largest in ((right, sizes), (sense, changes))
        )
        room = AMPLIFIED * RTOL * (size + change) + 1e-14
        out.append(_worst(name, found, right, room))
        if slopes and exact.errors:
            blur = min(exact.errors[name], BLURRED * change)
            # The amount of a friction has a kink where its sign changes: no difference across it tells a slope.
            across = name.endswith("friction_force") & (np.abs(right) < 2 * STEPS[1] * np.abs(sense))
            slope = np.where(across & np.isfinite(slopes[name]), sense, slopes[name])
            out.append(_worst(f"d {name} / d {scene.name}", slope, sense, room + DIFFERENCE * change + blur))
    return out


def _kind(name: str) -> str:
    """What a quantity is: velocities are one kind, and energies."""
    return name.rpartition(".")[2] if "." in name else "energy"


def _largest(values: dict) -> dict[str, float]:
    out: dict[str, float] = {}
    for name, one in values.items():
        out[_kind(name)] = max(out.get(_kind(name), 0.0), float(np.abs(one).max()))
    return out


def balance(motion: Solution) -> Finding:
    """The energies of the second simulator itself: what is gained is work minus losses."""
    v = motion.values
    total = v["kinetic_energy"] + v["potential_energy"] + v["elastic_energy"]
    total = total - v["drive_work"] + v["friction_loss"] + v["damping_loss"]
    size = max(np.abs(v[name]).max() for name in ENERGIES)
    return _worst("the second simulator's balance", np.ptp(total), 0.0, 1e-7 * size)


def _alike(exact: np.ndarray, found: np.ndarray) -> np.ndarray:
    """With as many components as the library's: two in the plane."""
    return exact[..., : found.shape[-1]] if found.ndim == 2 else exact


def _worst(what: str, found, exact, room) -> Finding:
    found, exact = np.atleast_1d(found), np.atleast_1d(exact)
    off = np.where(np.isfinite(found), np.abs(found - exact), np.inf)
    at = np.unravel_index(off.argmax(), off.shape)
    return Finding(what, float(off[at] / room), float(found[at]), float(exact[at]))


# The library ---------------------------------------------------------------------------------------------------------


def library(mechanisms, scenes: list[Scene]):
    """Quantities of every scene, and their derivatives by the relative change of a number (none of laws that jump)."""
    first = scenes[0]
    kinds = {name: table["type"] for name, table in first.tables["joint"].items() if "normal" in table}
    smooth = first.case["normal"] not in JUMPING and "limited" not in str(first.tables)

    def both(lane):
        mechanism, number = lane

        def quantities(factor):
            return _read(_motion(cj.replace(mechanism, {first.name: factor * number}), first), kinds, first)

        if not smooth:
            return quantities(1.0), {}
        return jax.jvp(quantities, (jnp.ones(()),), (jnp.ones(()),))

    numbers = jnp.array([value(scene.tables, scene.keys) for scene in scenes])
    solved = first.case["solved"]
    if solved in ("vmap", "batch"):
        lanes = eqx.filter(mechanisms[0], eqx.is_array, inverse=True)
        stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(eqx.filter(m, eqx.is_array) for m in mechanisms))
        every = eqx.combine(stacked, lanes), numbers
        return jax.jit(jax.vmap(both))(every) if solved == "vmap" else cj.batch(both, every)
    ask = jax.jit(both) if solved == "jit" else both
    answers = [ask(lane) for lane in zip(mechanisms, numbers, strict=True)]
    return jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves]), *answers)


def _motion(mechanism, scene: Scene):
    if scene.case["start"] != "restarted":
        return cj.simulate(mechanism, scene.t1, save_at=scene.times, **OPTIONS)
    half = RESTART * scene.t1
    saved = cj.simulate(mechanism, half, **OPTIONS)
    return cj.simulate(mechanism, scene.t1, t0=half, y0=saved.final, save_at=scene.times, **OPTIONS)


def _read(solution, kinds, scene: Scene) -> dict:
    """Quantities by the names that the second simulator has for them."""
    out = {name: solution[name] for name in ENERGIES}
    for point in scene.tables["point"]:
        out |= {name: solution[name] for name in (f"{point}.position", f"{point}.velocity")}
    out |= {name: solution[other] for name, other in trains.told(scene.tables).items()}
    for joint, kind in kinds.items():
        place = solution[f"{joint}.eccentricity"]
        out[f"{joint}.play"] = place[:, :2] if kind == "prismatic" else place
        out[f"{joint}.contact_force"] = solution[f"{joint}.contact_force"]
        out[f"{joint}.friction_force"] = jnp.abs(solution[f"{joint}.friction_force"])
    return out


def episodes(mechanism, scene: Scene, exact: Truth) -> list[Finding]:
    """Every contact of the motion: when, how fast, and its largest force; and that there are no more."""
    dataset = cj.to_dataset(mechanism, cj.trace(mechanism, scene.t1, **OPTIONS))
    fields, rows = ("episode_start", "episode_end", "impact_speed", "peak_force"), []
    for begin, kind in (("", "joint"), ("gap_", "gap")):
        if f"{begin}episode_{kind}" in dataset:
            joints = [str(dataset[kind].values[int(i)]) for i in dataset[f"{begin}episode_{kind}"].values]
            rows += zip(joints, *(dataset[begin + name].values for name in fields), strict=True)
    found = sorted(rows, key=lambda row: (row[0], row[1]))
    right = sorted(exact.motion.episodes, key=lambda one: (one.joint, one.begin))
    out = [_worst("number of contacts", len(found), len(right), 0.5)]
    # What a relative error changes of forces it may change of contacts.
    changes = [1.0]
    for joint in {row[0] for row in rows}:
        name = f"{joint}.contact_force" if f"{joint}.contact_force" in exact.motion.values else f"{joint}.torque"
        size, sense = (np.abs(these[name]).max() for these in (exact.motion.values, exact.senses))
        changes.append(sense / size if size else 1.0)
    amplified = max(changes)
    for (joint, *values), (other, *rights) in zip(found, right, strict=False):
        if joint != other:
            break
        for field, one, two in zip(fields, values, rights, strict=True):
            if np.isnan(one) and np.isnan(two):
                continue
            size = scene.t1 if field.startswith("episode") else abs(two)
            out.append(_worst(f"{joint} {field}", one, two, AMPLIFIED * RTOL * size * amplified + 1e-13))
    return out
