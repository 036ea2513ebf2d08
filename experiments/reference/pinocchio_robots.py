"""Robots by pinocchio, in the coordinates of this library: run by an interpreter that has `pin` and, for robots by
name, `example-robot-data`, not by this project's.

`PYTHON pinocchio_robots.py FILE BASE STATES SEED OUT`: FILE is a path, or one below the robots of `example-robot-data`;
BASE is fixed or free. OUT (.npz) says where the file is, and of random states what the dynamics are. A free base is at
its place in the world with a quaternion (w, x, y, z); its rates are those of its place, and its spin in its own axes.
"""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

# Pinocchio's accelerations know no friction. The speed at which it turns round is this library's default [rad/s, m/s].
TURNING = 0.01


def located(name):
    if Path(name).is_file():
        return Path(name)
    for folder in sys.path:
        for root in (Path(folder), *Path(folder).parents[:3]):
            path = root / "share" / "example-robot-data" / "robots" / name
            if path.is_file():
                return path
    raise SystemExit(f"There is no robot {name} here.")


def rates_of_base(rotation, n):
    """The matrix T of pinocchio's velocities (a free base's in its own axes) by this library's, v = T u."""
    out = np.eye(n)
    out[:3, :3] = rotation.T
    return out


def of_state(model, data, q, v, free, frames):
    """Everything compared, of one state."""
    nv = model.nv
    effort = -np.asarray(model.damping) * v - np.asarray(model.friction) * np.tanh(v / TURNING)
    acceleration = pin.aba(model, data, q, v, effort).copy()
    bias = pin.nonLinearEffects(model, data, q, v).copy()
    gravity = pin.computeGeneralizedGravity(model, data, q).copy()
    mass = pin.crba(model, data, q).copy()
    mass = np.triu(mass) + np.triu(mass, 1).T
    change, rate, turned = np.eye(nv), v.copy(), np.zeros(nv)
    if free:
        rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
        change = rates_of_base(rotation, nv)
        turned[:3] = -np.cross(v[3:6], v[:3])  # the rate of T, on u
        rate[:3] = rotation @ v[:3]
        acceleration[:3] = rotation @ (acceleration[:3] - turned[:3])
    bias = change.T @ (bias + mass @ turned)
    gravity = change.T @ gravity
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    poses = [data.oMf[i].homogeneous[:3] for i in frames]
    jacobians = [pin.getFrameJacobian(model, data, i, pin.LOCAL_WORLD_ALIGNED) @ change for i in frames]
    return {
        "rate": rate,
        "acceleration": acceleration,
        "gravity": gravity,
        "coriolis": bias - gravity,
        "mass": change.T @ mass @ change,
        "poses": np.array(poses),
        "jacobians": np.array(jacobians),
    }


def places(model, q, free):
    """Positions as this library has them: a quaternion begins with its real part, an endless turn is an angle."""
    out = []
    for joint, name in list(zip(model.joints, model.names, strict=True))[1:]:
        own = q[joint.idx_q : joint.idx_q + joint.nq]
        if free and name == "root_joint":
            out += [*own[:3], own[6], *own[3:6]]
        else:
            out.append(np.arctan2(own[1], own[0]) if joint.nq == 2 else own[0])
    return np.array(out)


def main(name, base, states, seed, out):
    path, free = located(name), base == "free"
    model = pin.buildModelFromUrdf(str(path), *([pin.JointModelFreeFlyer()] if free else []))
    data, rng = model.createData(), np.random.default_rng(int(seed))
    frames = [i for i, frame in enumerate(model.frames) if frame.type == pin.FrameType.BODY]
    # Any place will do, within the limits or not; of joints that slide a metre either way.
    model.lowerPositionLimit = -np.where(np.isfinite(model.lowerPositionLimit), np.pi, 1.0)
    model.upperPositionLimit = -model.lowerPositionLimit
    pin.seed(int(seed))
    rows = {"q": []}
    for _ in range(int(states)):
        q = pin.randomConfiguration(model)
        found = of_state(model, data, q, rng.normal(size=model.nv), free, frames)
        rows["q"].append(places(model, q, free))
        for key, value in found.items():
            rows.setdefault(key, []).append(value)
    names = [name for name in model.names[1:] if not (free and name == "root_joint")]
    np.savez(
        out,
        path=str(path),
        version=pin.__version__,
        names=np.array(names),
        frames=np.array([model.frames[i].name for i in frames]),
        **{key: np.array(value) for key, value in rows.items()},
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
