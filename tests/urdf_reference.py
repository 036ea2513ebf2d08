"""A robot's kinematics and energies straight from what its file says, with matrices of four rows; and random robots."""

import numpy as np


def origin(rng):
    def three(scale):
        return " ".join(repr(float(v)) for v in rng.uniform(-scale, scale, 3))

    return f'<origin xyz="{three(1)}" rpy="{three(3)}"/>'


def random_link(name, rng):
    half = rng.normal(size=(3, 5))
    spread = half @ half.T
    inertia = np.trace(spread) * np.eye(3) - spread  # of masses in space, so that there is such a body
    keys = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    words = " ".join(f'{key}="{float(inertia[at])!r}"' for key, at in keys.items())
    mass = f'<mass value="{float(rng.uniform(0.1, 3))!r}"/>'
    return f'<link name="{name}"><inertial>{origin(rng)}{mass}<inertia {words}/></inertial></link>'


def tree(seed, count=12, bare=0.3):
    """A random tree: half of its joints are fixed, a share `bare` of its links weigh nothing."""
    rng = np.random.default_rng(seed)
    links, joints = [], []
    for i in range(count):
        links.append(random_link(f"l{i}", rng) if rng.random() >= bare or i == 0 else f'<link name="l{i}"/>')
    for i in range(1, count):
        kind = rng.choice(["fixed", "revolute", "prismatic"], p=[0.5, 0.3, 0.2])
        joints.append(
            f'<joint name="j{i}" type="{kind}">{origin(rng)}<parent link="l{rng.integers(i)}"/><child link="l{i}"/>'
            f'<axis xyz="{rng.normal():.3f} 1 {rng.normal():.3f}"/></joint>'
        )
    rng.shuffle(links)
    return f"<robot name='r'>{''.join(links)}{''.join(joints)}</robot>"


def homogeneous(xyz, rpy):
    out = np.eye(4)
    roll, pitch, yaw = rpy
    for angle, i, j in ((yaw, 0, 1), (pitch, 2, 0), (roll, 1, 2)):
        turn = np.eye(4)
        turn[i, i] = turn[j, j] = np.cos(angle)
        turn[j, i], turn[i, j] = np.sin(angle), -np.sin(angle)
        out = out @ turn
    out[:3, 3] = xyz
    return out


def turned(axis, angle):
    """Rodrigues, of a unit axis."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    out = np.eye(4)
    out[:3, :3] = np.cos(angle) * np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * np.outer(axis, axis)
    return out


def slid(by):
    return homogeneous(by, (0, 0, 0))


def moved(joint, q):
    """The pose of a joint's child in its parent; `q`: of a planar joint two slides (along axes that are given) and a
    turn, of a floating one a place and a rotation matrix.
    """
    out, axis = homogeneous(joint.xyz, joint.rpy), np.array(joint.axis)
    if joint.kind == "fixed":
        return out
    if joint.kind == "prismatic":
        return out @ slid(q * axis)
    if joint.kind == "planar":
        slide, angle = q
        return out @ slid(slide) @ turned(axis, angle)
    if joint.kind == "floating":
        place, rotation = q
        own = np.eye(4)
        own[:3, :3] = rotation
        return out @ slid(place) @ own
    return out @ turned(axis, q)


def poses(root, joints, q):
    found = {root: np.eye(4)}
    for joint in joints:
        found[joint.child] = found[joint.parent] @ moved(joint, q.get(joint.name))
    return found


def energies(robot, q, ahead, behind, step, gravity):
    """Kinetic and potential energy of all links [J], the velocity by a central difference over two steps of time."""
    now, later, before = (poses(robot.root, robot.joints, at) for at in (q, ahead, behind))
    kinetic = potential = 0.0
    for link in robot.links:
        rate = (later[link.name] - before[link.name]) / (2 * step)
        kinetic += np.trace(rate @ pseudo_inertia(link.mass, link.center, link.inertia) @ rate.T) / 2
        potential -= link.mass * np.dot(gravity, (now[link.name] @ [*link.center, 1.0])[:3])
    return kinetic, potential


def pseudo_inertia(mass, center, inertia):
    """Mass, first and second moments of a body in its frame, 4 by 4: linear in what it is made of."""
    second = np.trace(inertia) / 2 * np.eye(3) - inertia + mass * np.outer(center, center)
    return np.block([[second, mass * center[:, None]], [mass * center[None, :], np.array([[mass]])]])
