"""MJCF files as MuJoCo's own compiler understands them: names, and links and joints as a URDF file has them.

The compiler resolves defaults, includes, frames and the inertia of shapes. MuJoCo moves a body by its joints one after
the other, each in the body's frame as the joints before it have moved it: between two of them lies a link without mass.
"""

import importlib
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from clearance_jax._basis.extras import require
from clearance_jax.errors import ClearanceError
from clearance_jax.io.files import read_text
from clearance_jax.io.urdf import robot as parts
from clearance_jax.io.urdf.bodies import NOTHING
from clearance_jax.io.urdf.elements import LARGEST_XML
from clearance_jax.mechanism.body import GROUND, Limits

# Range up to which a second hinge about the axis of another one is taken for the backlash of its gear [rad].
NARROW = np.radians(5.0)
# The outermost element of an XML file, behind what may stand before it.
OUTERMOST = re.compile(r"(?:\s|<\?.*?\?>|<!--.*?-->|<!DOCTYPE[^>]*>|\ufeff)*<([\w:.-]+)", re.DOTALL)


def outermost(path: str | Path) -> tuple[str, str]:
    """The text of an XML file, and the tag of its outermost element (empty: there is none)."""
    text = read_text(Path(path), "MJCF file", LARGEST_XML)
    tag = OUTERMOST.match(text)
    return text, "" if tag is None else tag[1]


class Source:
    """A compiled file: the `model`, MuJoCo itself, names of bodies, joints and sites (of those without one, names that
    no other has), and what is `left_out`, in words.
    """

    def __init__(self, path: str | Path):
        require("Reading an MJCF file", "mjcf", "mujoco")
        self.mujoco: Any = importlib.import_module("mujoco")
        try:
            self.model: Any = self.mujoco.MjModel.from_xml_path(str(path))
        except ValueError as error:
            raise ClearanceError(f"MuJoCo's compiler refuses it: {' '.join(str(error).split())}.") from None
        model = self.model
        self.bodies = [GROUND, *names_of(model.body, range(1, model.nbody), "body")]
        self.joints = names_of(model.joint, range(model.njnt), "joint")
        self.sites = names_of(model.site, range(model.nsite), "site")
        self.left_out: list[str] = []

    @property
    def name(self) -> str:
        """The model's name, which stands first among its names."""
        return self.model.names.split(b"\0", 1)[0].decode()

    def is_off(self, what: str) -> bool:
        """Whether the file switches a kind of force off."""
        return bool(self.model.opt.disableflags & int(getattr(self.mujoco.mjtDisableBit, f"mjDSBL_{what}")))

    def kind(self, joint: int) -> str:
        """FREE, BALL, SLIDE or HINGE."""
        return self.mujoco.mjtJoint(self.model.jnt_type[joint]).name.removeprefix("mjJNT_")

    def start(self, joint: int) -> np.ndarray:
        """The coordinates of a joint in the file's configuration, and of the joints after it."""
        return self.model.qpos0[self.model.jnt_qposadr[joint] :]

    def pivot(self, joint: int) -> parts.Vector3:
        """Where a joint is in its body's frame."""
        return self.model.jnt_pos[joint] if self.kind(joint) in ("HINGE", "BALL") else np.zeros(3)

    def leave_out(self, kind: str, names: Sequence[str]) -> None:
        """List what was not read; at most a few names."""
        if names:
            more = [f"... ({len(names)} in all)"] if len(names) > parts.SHOWN else []
            self.left_out.append(f"{kind} {', '.join([*(f'`{name}`' for name in names[: parts.SHOWN]), *more])}")

    def links(self) -> Iterator[parts.Link]:
        """The bodies, the ground first."""
        model = self.model
        for i, name in enumerate(self.bodies):
            turn, moments = rotation_by(model.body_iquat[i]), np.diag(model.body_inertia[i])
            inertia = parts.clean(turn @ moments @ turn.T, np.abs(moments).max())
            center = parts.clean(model.body_ipos[i], 0.0)
            yield parts.Link(name, float(model.body_mass[i]), center, (inertia + inertia.T) / 2, 0)

    def hung(self) -> Iterator[parts.Joint]:
        """What every body hangs on, parents first."""
        model, taken = self.model, {*self.bodies}
        for i, name in enumerate(self.bodies[1:], start=1):
            pose = parts.FramePose(model.body_pos[i], rotation_by(model.body_quat[i]))
            parent, first = self.bodies[model.body_parentid[i]], model.body_jntadr[i]
            numbers = range(first, first + model.body_jntnum[i])
            if not numbers:
                place = parts.triple(pose.position), parts.triple(parts.rpy_of(pose.rotation)), parts.NOWHERE
                yield parts.Joint(name, "fixed", parent, name, *place, None, None, 0.0, 0.0, 0)
            for number in numbers:
                child = name if number == numbers[-1] else f"{name}_{self.joints[number]}"
                while child != name and child in taken:
                    child += "_"
                taken.add(child)
                yield self._joint(number, pose, parent, child)
                parent, pose = child, parts.HERE

    def _joint(self, number: int, pose: parts.FramePose, parent: str, child: str) -> parts.Joint:
        """A joint that leaves its child in the `pose` on its parent while its coordinate is that of `qpos0`. A ball is
        as a floating joint here.
        """
        model, dof, kind = self.model, self.model.jnt_dofadr[number], self.kind(number)
        axis, shift, turn = parts.clean(model.jnt_axis[number]), self.pivot(number), np.eye(3)
        start = float(self.start(number)[0])
        if kind == "HINGE":
            turn = rotation_by(np.array([np.cos(start / 2), *(-np.sin(start / 2) * axis)]))
        elif kind == "SLIDE":
            shift = -start * axis
        # The coordinates of a free joint are the whole pose.
        xyz, rotation = parts.HERE if kind == "FREE" else pose.of(shift, turn)
        ends = self.joints[number], parent, child
        place = parts.triple(xyz), parts.triple(parts.rpy_of(rotation)), parts.triple(axis)
        damping = 0.0 if self.is_off("DAMPER") else float(model.dof_damping[dof])
        if kind in ("BALL", "FREE"):
            return parts.Joint(ends[0], "floating", *ends[1:], *place, None, None, damping, 0.0, 0)
        lower, upper = (float(end) if model.jnt_limited[number] else None for end in model.jnt_range[number])
        effort = float(np.abs(model.jnt_actfrcrange[number]).max()) if model.jnt_actfrclimited[number] else None
        limits = None if lower is None and effort is None else Limits(lower, upper, None, effort)
        friction = 0.0 if self.is_off("FRICTIONLOSS") else float(model.dof_frictionloss[dof])
        stiffness = 0.0 if self.is_off("SPRING") else float(model.jnt_stiffness[number])
        rest = float(model.qpos_spring[model.jnt_qposadr[number]])
        losses = damping, friction, 0, stiffness, rest, float(model.dof_armature[dof])
        word = "prismatic" if kind == "SLIDE" else "revolute"
        return parts.Joint(ends[0], word, *ends[1:], *place, limits, None, *losses)

    def check_moved(self) -> None:
        """Raise where joints move no mass, by the mass matrix at a random pose, where no axes are aligned by chance."""
        mujoco, model, data = self.mujoco, self.model, self.mujoco.MjData(self.model)
        mujoco.mj_integratePos(model, data.qpos, np.random.default_rng(0).uniform(0.3, 1.2, model.nv), 1.0)
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_crb):
            compute(model, data)
        matrix = np.zeros((model.nv, model.nv))
        for column, unit in zip(matrix, np.eye(model.nv), strict=True):
            mujoco.mj_mulM(model, data, column, unit)
        size = 1 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))  # so that metres and radians compare
        values, vectors = np.linalg.eigh(matrix * np.outer(size, size))
        if not values[0] > NOTHING:
            name = self.joints[model.dof_jntid[np.argmax(np.abs(vectors[:, 0]))]]
            raise ClearanceError(f"joint `{name}` can move without moving any mass. Give it an `armature`.").about(name)

    def list_left_out(self) -> None:
        """List what acts in MuJoCo and has no counterpart, but for equality constraints."""
        model = self.model
        self.leave_out("actuators", names_of(model.actuator, range(model.nu), "actuator"))
        self.leave_out("tendons", names_of(model.tendon, range(model.ntendon), "tendon"))
        mocap = [name for i, name in enumerate(self.bodies) if model.body_mocapid[i] >= 0]
        self.leave_out("motions of the mocap bodies", mocap)
        several = [i for i in range(model.njnt) if self.kind(i) in ("BALL", "FREE")]
        acting = np.array([model.dof_armature, model.dof_frictionloss]).max(axis=0)
        acting = [i for i in several if model.jnt_stiffness[i] > 0 or acting[model.jnt_dofadr[i]] > 0]
        self.leave_out("springs, armatures and friction losses of", [self.joints[i] for i in acting])
        counts = {"flexible bodies": model.nflex, "plugins": model.nplugin}
        # Of MuJoCo 4.
        curved = [np.any(getattr(model, key, 0.0)) for key in ("jnt_stiffnesspoly", "dof_dampingpoly")]
        counts["springs or dampers that are not linear, or yield"] = any(curved) or getattr(model, "nplastic", 0)
        counts["forces of the fluid around it"] = model.opt.density > 0 or model.opt.viscosity > 0
        self.left_out += [what for what, count in counts.items() if count]

    def backlashes(self) -> Iterator[str]:
        """Sentences about limited hinges that stand for the backlash of a gear: by their name, or by a narrow range
        beside another hinge about the same axis.
        """
        model = self.model
        hinges = [i for i in range(model.njnt) if self.kind(i) == "HINGE"]
        for i in hinges:
            here = [j for j in hinges if j != i and model.jnt_bodyid[j] == model.jnt_bodyid[i]]
            is_second = any(abs(model.jnt_axis[i] @ model.jnt_axis[j]) > 1 - 1e-9 for j in here)
            gap = np.ptp(model.jnt_range[i])
            named = "backlash" in self.joints[i].lower()
            if model.jnt_limited[i] and (named or (is_second and gap <= NARROW)):
                lower, upper = np.degrees(model.jnt_range[i])
                yield (
                    f"joint `{self.joints[i]}` stands for backlash of {np.degrees(gap):.4g} deg ({lower:.4g} to "
                    f"{upper:.4g} deg): it turns freely, and nothing holds it in this range"
                )


def names_of(part: Callable[[int], Any], which: Sequence[int], word: str) -> list[str]:
    """The names of parts; of those without one, names that no other has."""
    given = [part(i).name for i in which]
    names = []
    for i, name in zip(which, given, strict=True):
        unnamed = f"{word}_{i}"
        while unnamed in given:
            unnamed += "_"
        names.append(name or unnamed)
    return names


def rotation_by(quaternion: np.ndarray) -> parts.Matrix3:
    """The rotation of a unit quaternion (w, x, y, z)."""
    w, *axis = (float(number) for number in quaternion)
    across = np.cross(np.eye(3), axis)
    return parts.clean(np.eye(3) + 2 * w * across + 2 * across @ across)
