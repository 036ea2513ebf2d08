"""Models in MJCF files, compared with MuJoCo: `python -m experiments.mjcf` writes out/mjcf.md.

The accelerations of three random states of each model are compared with MuJoCo's own. Contacts, limits, friction loss,
actuators, forces of a fluid, springs and dampers of tendons and closed loops are left out of both. Equalities of joints
hold exactly: MuJoCo's mass matrix and forces are reduced to the rates that they leave. The error in a state is the
largest difference of an acceleration, divided by the largest acceleration. The table has the largest error of the
states, and what of the model the library says that it does not read.

`MENAGERIE` names a folder. Every MJCF file in it that has joints is compared, but only one of several models that have
the same accelerations. Packages with such files make a folder by `pip install --no-deps --target there dm_control
gymnasium gymnasium-robotics robosuite gym-aloha myo-sim playground`. A file that MuJoCo refuses is no model: most are
parts of another file. Without `MENAGERIE`, and in quick mode, three small models are compared.
"""

import dataclasses
import importlib
import os
import re
import tempfile
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax.dynamics.field import slope
from clearance_jax.errors import ClearanceError
from clearance_jax.io.mjcf.source import outermost
from clearance_jax.io.urdf.mechanism import NotReadWarning
from clearance_jax.mechanism.state import layout
from experiments.common import is_same, output, packages, table
from experiments.publish import command, say

mujoco: Any = importlib.import_module("mujoco")

OFF = ("CONTACT", "LIMIT", "FRICTIONLOSS", "ACTUATION", "EQUALITY")
# What is not in the library's equations, or has a constant there: set to zero in MuJoCo's.
ABSENT = ("tendon_stiffness", "tendon_damping", "tendon_armature", "jnt_stiffnesspoly", "dof_dampingpoly")
ABSENT += ("tendon_stiffnesspoly", "tendon_dampingpoly", "jnt_actgravcomp")
STATES = 3
SMALL = {
    "pendulums": '<body><joint damping="0.1" armature="0.01"/><geom size="0.1" pos="0.3 0 0"/>'
    '<body pos="0.5 0 0"><joint type="ball"/><geom type="capsule" fromto="0 0 0 0.2 0.1 0.3" size="0.05"/>'
    "</body></body>",
    "floating": '<body pos="0 0 1"><freejoint/><geom type="box" size="0.1 0.2 0.3"/>'
    '<body gravcomp="0.6"><joint type="slide" axis="1 2 0" stiffness="30"/><geom size="0.1"/></body></body>',
    "gripper": '<body><joint name="wrist" axis="1 0 0"/><geom size="0.1"/>'
    '<body pos="0 0 0.1"><joint name="left" type="slide" axis="0 1 0"/><geom size="0.02" pos="0 0.1 0"/></body>'
    '<body pos="0 0 0.1"><joint name="right" axis="1 1 0"/><geom size="0.03" pos="0 0 0.1"/></body></body>',
}
FOLLOWING = '<equality><joint joint1="right" joint2="left" polycoef="0.1 -3"/></equality>'


class Row(NamedTuple):
    """A model: its file, the coordinates that are left to it, what was not read, the error, and for telling models
    apart its accelerations.
    """

    model: str
    coordinates: int
    left_out: str
    error: float
    accelerations: np.ndarray


def bare(path: Path) -> Any:
    """MuJoCo's model without what is not compared."""
    model = mujoco.MjModel.from_xml_path(str(path))
    for what in OFF:
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{what}"))
    model.opt.density = model.opt.viscosity = 0.0
    for name in ABSENT:
        if hasattr(model, name):
            getattr(model, name)[:] = 0
    for i in range(model.njnt):
        if model.jnt_type[i] in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
            first = model.jnt_dofadr[i]
            count = 6 if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_FREE else 3
            model.jnt_stiffness[i], model.dof_armature[first : first + count] = 0.0, 0.0
    return model


def places(model: Any, mechanism: cj.Mechanism) -> tuple[list[int], list[int]]:
    """Where each position and each velocity of the mechanism's state is in MuJoCo's."""
    q: list[int] = []
    v: list[int] = []
    numbers = {(model.joint(i).name or f"joint_{i}").replace(".", "_"): i for i in range(model.njnt)}
    for c in mechanism.free_coordinates():
        name = c.name.split(".")[0]
        i = numbers[name if name in numbers else name.removesuffix("_joint")]
        first_q, first_v = int(model.jnt_qposadr[i]), int(model.jnt_dofadr[i])
        is_free = model.jnt_type[i] == mujoco.mjtJoint.mjJNT_FREE
        if c.is_ball:
            q += range(first_q + 3 * is_free, first_q + 3 * is_free + 4)
            v += range(first_v + 3 * is_free, first_v + 3 * is_free + 3)
        else:
            further = "xyz".index(c.name[-1]) if is_free else 0
            q, v = [*q, first_q + further], [*v, first_v + further]
    return q, v


class Followers(NamedTuple):
    """The linear equalities of joints, A v = 0 and A (q - q_0) = c, solved for the joints that follow."""

    followers: list[int]
    rates: np.ndarray
    """All velocities by those that are left, shape (nv, left)."""
    shift: np.ndarray
    """What the followers have beyond that, shape (followers,)."""

    def impose(self, model: Any, data: Any, free: list[int]) -> None:
        """Give the followers their places and velocities."""
        q = [int(model.jnt_qposadr[model.dof_jntid[i]]) for i in range(model.nv)]
        for row, i in enumerate(self.followers):
            leaders = [j for j, dof in enumerate(free) if self.rates[i, j] != 0]
            moved = sum(self.rates[i, j] * (data.qpos[q[free[j]]] - model.qpos0[q[free[j]]]) for j in leaders)
            data.qpos[q[i]] = model.qpos0[q[i]] + self.shift[row] + moved
        data.qvel[:] = self.rates @ data.qvel[free]


def followers(model: Any, free: list[int]) -> Followers:
    """Of a model of which `free` are the velocities that are left."""
    lines, constants = [], []
    for i in range(model.neq):
        first, second = model.eq_obj1id[i], model.eq_obj2id[i]
        constant, ratio, *higher = model.eq_data[i][:5]
        if model.eq_type[i] != mujoco.mjtEq.mjEQ_JOINT or not model.eq_active0[i] or second < 0:
            continue
        if ratio and not any(higher):
            line = np.zeros(model.nv)
            line[model.jnt_dofadr[first]], line[model.jnt_dofadr[second]] = 1.0, -ratio
            lines, constants = [*lines, line], [*constants, constant]
    bound = [i for i in range(model.nv) if i not in free]
    rates = np.zeros((model.nv, len(free)))
    rates[free, range(len(free))] = 1.0
    a = np.array(lines).reshape(-1, model.nv)
    solved = np.linalg.lstsq(a[:, bound], np.column_stack([-a[:, free], constants]), rcond=None)[0]
    rates[bound] = solved[:, :-1]
    return Followers(bound, rates, solved[:, -1])


def states(model: Any, seed: int = 0) -> Iterator[Any]:
    """Random states of a model."""
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    for _ in range(STATES):
        data.qpos[:] = model.qpos0
        mujoco.mj_integratePos(model, data.qpos, rng.uniform(-0.7, 0.7, model.nv), 1.0)
        data.qvel[:] = rng.uniform(-1, 1, model.nv)
        yield data


def theirs(model: Any, data: Any, rates: np.ndarray) -> np.ndarray:
    """MuJoCo's accelerations of the velocities that are left."""
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    for column, unit in zip(mass, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    found = np.linalg.solve(rates.T @ mass @ rates, rates.T @ (data.qfrc_passive - data.qfrc_bias))
    if rates.shape[1] == model.nv and not is_same(found, rates.T @ data.qacc, 1e-6):
        raise RuntimeError(f"MuJoCo has other accelerations than its own mass matrix: {found}, {data.qacc}.")
    return found


def compared(path: Path, name: str) -> Row:
    """A model's row."""
    model = bare(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotReadWarning)
        mechanism = cj.load_mjcf(path)
    notes = [note.removeprefix("not read: ") for note in mechanism.notes if note.startswith("not read: ")]
    loops = [f"{len(mechanism.loops)} loops"] if mechanism.loops else []
    losses = {n: 0.0 for n in cj.parameters(mechanism) if n.endswith(".effort")}
    mechanism = dataclasses.replace(cj.replace(mechanism, losses), loops=())
    at_q, at_v = places(model, mechanism)
    bound = followers(model, at_v)
    plan, ready = layout(mechanism), mechanism.prepare().as_table()
    ours = jax.jit(lambda y, ready: slope(jnp.zeros(()), y, ready)[plan.v])
    known, worst = [], 0.0
    for data in states(model):
        bound.impose(model, data, at_v)
        known.append(theirs(model, data, bound.rates))
        y = jnp.asarray(np.concatenate([data.qpos[at_q], data.qvel[at_v]]))
        worst = max(worst, float(np.abs(np.asarray(ours(y, ready)) - known[-1]).max() / np.abs(known[-1]).max()))
    return Row(name, len(at_v), kinds([*notes, *loops]), worst, np.array(known))


def kinds(notes: list[str]) -> str:
    """What was not read, without the names of the parts and their number."""
    words = [part.strip(" :").removesuffix(" of") for note in notes for part in re.sub(r"`[^`]*`", "", note).split(",")]
    return ", ".join(word for word in words if word and not word.startswith("..."))


def files(folder: Path) -> Iterator[Path]:
    """The MJCF files below a folder."""
    for path in sorted(folder.rglob("*.xml")):
        try:
            if outermost(path)[1] == "mujoco":
                yield path
        except ClearanceError:
            continue


def models(folder: Path) -> Iterator[Path]:
    """The files that MuJoCo reads as a model with joints."""
    for path in files(folder):
        try:
            if mujoco.MjModel.from_xml_path(str(path)).njnt:
                yield path
        except ValueError:
            continue


def collect(folder: Path) -> tuple[list[Row], list[tuple[str, str]]]:
    """A row for every model of its own, and the models that the library refuses, in its words."""
    rows: list[Row] = []
    refused = []
    for path in models(folder):
        name = str(path.relative_to(folder).with_suffix(""))
        try:
            row = compared(path, name)
        except ClearanceError as error:
            refused.append((name, str(error).replace(str(path), path.name)))
            continue
        if not any(is_same(row.accelerations, other.accelerations) for other in rows):
            rows.append(row)
            print(f"{row.model}: {row.coordinates}, {row.error:.1e}", flush=True)
    return rows, refused


def main(quick: bool = False) -> list[Row]:
    """Write the table."""
    folder = os.environ.get("MENAGERIE")
    with tempfile.TemporaryDirectory() as here:
        if quick or not folder:
            say("Small models; name a folder with MJCF files by MENAGERIE for more.")
            for name, world in SMALL.items():
                rest = FOLLOWING if "right" in world else ""
                text = f"<mujoco><worldbody>{world}</worldbody>{rest}</mujoco>"
                (Path(here) / f"{name}.xml").write_text(text, encoding="utf-8")
        used = Path(here if quick or not folder else folder)
        rows, refused = collect(used)
    counts = Counter(row.model.split("/")[0] for row in rows)
    shares = ", ".join(f"{count} of {name}" for name, count in counts.items())
    say(
        f"MuJoCo {mujoco.__version__}; {len(rows)} models: {shares}",
        packages(used),
        f"largest relative difference: {max(row.error for row in rows):.1e}",
    )
    cells = [(row.model, row.coordinates, row.left_out or "-", f"{row.error:.1e}") for row in rows]
    head = ("model", "coordinates", "not read", "acceleration")
    table(head, cells, output(f"mjcf{'_quick' if quick else ''}.md"))
    if refused:
        table(("refused", "why"), refused, output("mjcf_refused.md"))
    return rows


if __name__ == "__main__":
    command(main, __doc__)
