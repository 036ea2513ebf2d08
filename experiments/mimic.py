"""Robots whose joints follow others, compared with pinocchio: `python -m experiments.mimic` writes out/mimic.md.

The accelerations of 20 random states of each robot are compared: its base is fixed, and gravity and the joints' damping
and dry friction act (-f tanh(q' / v) with the f that pinocchio reads), also in the joints that follow by `<mimic>`. The
error in a state is the largest difference of an acceleration, divided by the largest acceleration. The table has the
largest error of the states.

`PINOCCHIO_PYTHON` names the interpreter of an environment with the packages `pin` and `example-robot-data` (`python -m
venv there; there/bin/pip install pin example-robot-data`). `URDF_FILES` names a folder with further URDF files. Every
file in it with `<mimic>` is compared, but only one of several robots that have the same accelerations. Packages with
such files make a folder by `pip install --no-deps --target there airo-models dexmate-urdf jvrc-description`; others are
in the repositories dexsuite/dex-urdf and Daniella1/urdf_files_dataset. The table says by what pinocchio's accelerations
are: `mimic=True` makes its own model with followers. That refuses a joint that follows a later one, or one that itself
follows. Then the followers are eliminated from its model of free joints. Without an interpreter, and in quick mode,
a gripper is compared with the sum of what its fingers weigh.
"""

import os
import subprocess
import tempfile
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.dynamics.field import slope
from clearance_jax.errors import ClearanceError
from clearance_jax.io.urdf.bodies import merge
from clearance_jax.io.urdf.file import read_urdf
from clearance_jax.io.urdf.mechanism import read_robot
from experiments.common import is_same, output, packages, table
from experiments.publish import command, say
from experiments.robots import Known, known_by, worst

WORKER = Path(__file__).parent / "reference" / "pinocchio_mimic.py"
# Where the robots of `example-robot-data` are, asked of the interpreter that has them.
DATA = "import sys, pathlib as p; print(*p.Path(sys.prefix).glob('lib*/**/share/example-robot-data/robots'), sep='\\n')"
STATES = 20
FINGER = """
  <link name="{0}"><inertial><mass value="{1}"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/>
  </inertial></link>
  <joint name="{0}_joint" type="prismatic"><parent link="hand"/><child link="{0}"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/>{2}</joint>"""
MASSES, RATIO = (0.2, 0.3), -0.5


class Row(NamedTuple):
    """A robot: its file, the coordinates that are left, how many joints follow, by what the reference is, the error."""

    robot: str
    coordinates: int
    followers: int
    by: str
    error: float


def of_gripper(folder: Path) -> Known:
    """Two fingers, of which one follows, that fall: (m + k^2 M) q'' = -g (m + k M)."""
    follows = f'<mimic joint="left_joint" multiplier="{RATIO}" offset="0.1"/>'
    fingers = FINGER.format("left", MASSES[0], ""), FINGER.format("right", MASSES[1], follows)
    path = folder / "gripper.urdf"
    path.write_text(f'<robot name="gripper"><link name="hand"/>{"".join(fingers)}</robot>', encoding="utf-8")
    falls = -9.81 * (MASSES[0] + RATIO * MASSES[1]) / (MASSES[0] + RATIO**2 * MASSES[1])
    values = {"q": np.linspace(-0.1, 0.1, 3)[:, None], "rate": np.ones((3, 1)), "acceleration": np.full((3, 1), falls)}
    more = {"by": np.array("hand"), "followers": np.array(1), "apart": np.array(0.0), "version": np.array("none")}
    return Known(path, ["left_joint"], [], values | more)


def compared(known: Known, name: str) -> Row:
    """A robot's row."""
    _, mechanism = read_robot(known.path)
    following = {coupling.follower for coupling in mechanism.couplings}
    joints = zip(merge(read_urdf(known.path)[1]).joints, mechanism.joints, strict=True)
    own = [joint.name for joint, made in joints if made.name not in following]
    order = [known.names.index(joint) for joint in own]
    ready = mechanism.prepare().as_table()
    states = jnp.asarray(np.concatenate([known.values["q"][:, order], known.values["rate"][:, order]], axis=1))
    run = jax.jit(jax.vmap(lambda y, ready: slope(jnp.zeros(()), y, ready)[len(order) :], in_axes=(0, None)))
    error = worst(np.asarray(run(states, ready)), known.values["acceleration"][:, order])
    return Row(name, len(order), int(known.values["followers"]), str(known.values["by"]), error)


def files(interpreter: str) -> list[tuple[str, Path]]:
    """The files with followers, each with a name."""
    asked = subprocess.run([interpreter, "-c", DATA], capture_output=True, text=True, check=True).stdout.split("\n")
    folders = {"example-robot-data": Path(asked[0])} if asked[0] else {}
    if given := os.environ.get("URDF_FILES"):
        folders[""] = Path(given)
    out = []
    for prefix, folder in folders.items():
        for path in sorted(path for path in folder.rglob("*") if path.suffix.lower() == ".urdf"):
            if b"<mimic" in path.read_bytes():
                place = Path(prefix) / path.relative_to(folder)
                out.append((f"{place.parts[0]}/{path.stem if path.stem != 'robot' else path.parent.name}", path))
    return out


def collect(interpreter: str) -> tuple[list[Row], list[tuple[str, str, str]], str]:
    """A row for every robot of its own, files that one of both refuses, and what is said of pinocchio."""
    rows, refused, seen, apart, version = [], [], [], 0.0, ""
    for name, path in files(interpreter):
        try:
            known = known_by([interpreter, str(WORKER), str(path), str(STATES), "0"])
        except RuntimeError as error:
            refused.append((name, "pinocchio", first_words(str(error), path)))
            continue
        accelerations = known.values["acceleration"]
        if not known.values["followers"] or any(is_same(accelerations, other) for other in seen):
            continue
        seen.append(accelerations)
        try:
            rows.append(compared(known, name))
        except ClearanceError as error:
            refused.append((name, "this library", first_words(str(error), path)))
            continue
        version, apart = str(known.values["version"]), max(apart, float(known.values["apart"]))
        print(rows[-1], flush=True)
    whose = f"pinocchio {version}; where it has both models, they differ by {apart:.1e} at most"
    return rows, refused, f"{whose}\n{packages(Path(os.environ.get('URDF_FILES', '')))}"


def first_words(error: str, path: Path) -> str:
    """The first sentence of what stands last in an error, without the file."""
    return error.strip().splitlines()[-1].replace(f"`{path}`: ", "").replace(str(path), path.name).split(". ")[0]


def main(quick: bool = False) -> list[Row]:
    """Write the table."""
    interpreter = os.environ.get("PINOCCHIO_PYTHON")
    if quick or not interpreter:
        say("A gripper by hand; name an interpreter by PINOCCHIO_PYTHON for robots by pinocchio.")
        with tempfile.TemporaryDirectory() as folder:
            rows, refused, whose = [compared(of_gripper(Path(folder)), "gripper")], [], "by hand"
    else:
        rows, refused, whose = collect(interpreter)
    ways = ", ".join(f"{count} by {way}" for way, count in Counter(row.by for row in rows).items())
    say(whose, f"{len(rows)} robots ({ways}); largest relative difference: {max(row.error for row in rows):.1e}")
    cells = [(*row[:-1], f"{row.error:.1e}") for row in rows]
    head = ("robot", "coordinates", "followers", "by", "acceleration")
    table(head, cells, output(f"mimic{'_quick' if quick else ''}.md"))
    if refused:
        table(("file", "refused by", "why"), refused, output("mimic_refused.md"))
    return rows


if __name__ == "__main__":
    command(main, __doc__)
