"""Mechanisms in space that several files of tests use: arms, a Bennett linkage, a Delta robot."""

import numpy as np

import clearance_jax as cj


def body(name, rng, mass=1.0):
    """A body with a random inertia of a real one: of points."""
    points = 0.1 * rng.normal(size=(6, 3))
    points -= points.mean(0)
    tensor = mass / 6 * (np.sum(points**2) * np.eye(3) - points.T @ points)
    six = [tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]]
    return cj.Body(name, mass, six, cj.Position(*(0.1 * rng.normal(size=3))))


def arm(n, seed=0):
    """A serial arm of n turns about random axes, randomly placed."""
    rng = np.random.default_rng(seed)
    bodies = tuple(body(f"link{i}", rng, 1.0 + i) for i in range(n))
    joints = tuple(
        cj.Revolute(
            f"joint{i}",
            "ground" if i == 0 else f"link{i - 1}",
            f"link{i}",
            cj.Position(*(0.3 * rng.normal(size=3))),
            orientation=cj.Orientation(*rng.normal(size=3)),
            axis="xyz"[i % 3] if i % 2 else rng.normal(size=3),
        )
        for i in range(n)
    )
    tip = cj.Point("tip", f"link{n - 1}", cj.Position(0.1, 0.2, 0.3))
    return cj.Mechanism(bodies, joints, points=(tip,), gravity=cj.Gravity(z=-9.81))


def zoo():
    """Every kind of joint of the tree, driven ones and branches among them."""
    rng = np.random.default_rng(1)
    names = ["lift", "ball", "cardan", "drill", "foot", "drone", "twig", "rod"]
    bodies = tuple(body(name, rng, 1.0 + 0.3 * i) for i, name in enumerate(names))

    def at():
        return cj.Position(*(0.2 * rng.normal(size=3)))

    def turned():
        return cj.Orientation(*rng.normal(size=3))

    joints = (
        cj.Prismatic("slide", "ground", "lift", at(), orientation=turned(), axis=(1.0, 2.0, -1.0)),
        cj.Spherical("socket", "lift", "ball", at(), at(), orientation=turned()),
        cj.Universal("cross", "ball", "cardan", at(), at(), child_orientation=turned()),
        cj.Cylindrical("sleeve", "cardan", "drill", at(), at(), orientation=turned(), axis="-y"),
        cj.Planar("floor", "lift", "foot", at(), at(), orientation=turned(), axis="x"),
        cj.Free("air", "ground", "drone", at(), at(), orientation=turned()),
        cj.Revolute("bent", "ball", "twig", at(), motion=cj.Motion(cj.drives.Harmonic(0.7, 3.0)), axis=(0.3, 0.2, 1.0)),
        cj.Revolute("last", "twig", "rod", at(), at(), orientation=turned(), axis="x"),
    )
    return cj.Mechanism(bodies, joints, gravity=cj.Gravity(0.3, -1.0, -9.81))


def bennett():
    """Bennett's linkage: four bars, opposite ones alike, a / sin(alpha) = b / sin(beta). It moves, though Gruebler's
    count leaves it minus two freedoms.
    """
    a, b, alpha = 0.5, 0.3, np.deg2rad(60.0)
    beta, first = np.arcsin(0.6 * np.sin(alpha)), 0.7
    second = 2 * np.arctan(np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2) / np.tan(first / 2))

    def bar(name, length):
        return cj.Body(name, 1.0, (1e-3, length**2 / 12, length**2 / 12), cj.Position(length / 2))

    joints = (
        cj.Revolute("j1", "ground", "l1", motion=cj.Motion(position=first, velocity=2.0)),
        cj.Revolute(
            "j2", "l1", "l2", cj.Position(a), orientation=cj.Orientation(alpha), motion=cj.Motion(position=second)
        ),
        cj.Revolute(
            "j3", "l2", "l3", cj.Position(b), orientation=cj.Orientation(beta), motion=cj.Motion(position=-first)
        ),
    )
    closing = cj.Revolute(
        "j4",
        "l3",
        "ground",
        cj.Position(a),
        cj.Position(-b),
        orientation=cj.Orientation(alpha),
        child_orientation=cj.Orientation(-beta),
    )
    bodies = bar("l1", a), bar("l2", b), bar("l3", a)
    return cj.Mechanism(bodies, joints, (closing,), gravity=cj.Gravity(z=-9.81)), (alpha, beta)


BASE, ARM, ROD, FOOT, HALF = 0.2, 0.3, 0.6, 0.05, 0.06


def delta(drives):
    """A Delta robot: three driven arms, six rods between balls (on the arms: universal joints, so that no rod turns
    about itself), a platform. Five of its rods close loops.
    """
    tilt, bodies, joints, wrist, loops = np.deg2rad(20.0), [cj.Body("platform", 0.5, (1e-3, 1e-3, 2e-3))], [], [], []
    for i, drive in enumerate(drives):
        yaw = 2 * np.pi * i / 3
        outward = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        sideways = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
        bodies.append(cj.Body(f"arm{i}", 1.0, (1e-3, 8e-3, 8e-3), cj.Position(ARM / 2)))
        turned = cj.Orientation(yaw=yaw)
        at = cj.Position(*(BASE * outward))
        # Its child's axes are those of the joint's frame: x outward, y along the motor's axis.
        joints.append(
            cj.Revolute(f"motor{i}", "ground", f"arm{i}", at, orientation=turned, axis="y", motion=cj.Motion(drive))
        )
        for k, side in enumerate((HALF, -HALF)):
            rod = f"rod{i}{k}"
            bodies.append(cj.Body(rod, 0.1, (3e-3, 3e-3, 1e-5), cj.Position(z=-ROD / 2)))
            elbow = cj.Universal(
                f"elbow{i}{k}", f"arm{i}", rod, cj.Position(ARM, side), turn_2=cj.Motion(position=tilt)
            )
            joints.append(elbow)
            foot = cj.Position(*(FOOT * outward + side * sideways))
            end = cj.Position(z=-ROD)
            if (i, k) == (0, 0):
                level = cj.Orientation(pitch=-tilt)
                wrist.append(cj.Spherical("wrist", rod, "platform", end, foot, motion=cj.Ball(level)))
            else:
                loops.append(cj.Spherical(f"ball{i}{k}", rod, "platform", end, foot))
    point = cj.Point("centre", "platform")
    return cj.Mechanism(tuple(bodies), (*joints, *wrist), tuple(loops), points=(point,), gravity=cj.Gravity(z=-9.81))


def platform(angles):
    """The platform's place by the intersection of three spheres about the elbows, moved in by the platform's radius."""
    yaw = 2 * np.pi * np.arange(3) / 3
    radius = BASE - FOOT + ARM * np.cos(angles)
    centres = np.stack([radius * np.cos(yaw), radius * np.sin(yaw), -ARM * np.sin(angles)], 1)
    a, b = 2 * (centres[1:] - centres[0]), np.sum(centres[1:] ** 2, 1) - np.sum(centres[0] ** 2)
    x, y = np.linalg.inv(a[:, :2]) @ b, -np.linalg.inv(a[:, :2]) @ a[:, 2]
    off = np.array([x[0], x[1], 0.0]) - centres[0]
    slope = np.array([y[0], y[1], 1.0])
    roots = np.roots([slope @ slope, 2 * slope @ off, off @ off - ROD**2])
    z = roots.real.min()
    return np.array([*(x + y * z), z])


def four_bar(joint, out_of_plane, start=((1.0, 3.0), (-0.9, 0.0), (1.5, 0.0))):
    """A four-bar linkage closed by a joint of a kind, in the plane x y; or turned by -90 degrees about x, its pins
    along y and its y axis along -z.
    """
    turned = cj.Orientation(roll=-np.pi / 2) if out_of_plane else None

    def bar(name, length):
        i = length**2 / 12
        return cj.Body(name, 1.0, (1e-3, i, i) if out_of_plane else i, cj.Position(length / 2))

    crank, knee, rocker = (cj.Motion(position=q, velocity=v) for q, v in start)
    joints = (
        cj.Revolute("crank", "ground", "l1", orientation=turned, motion=crank),
        cj.Revolute("knee", "l1", "l2", cj.Position(0.2), motion=knee),
        cj.Revolute("rocker", "ground", "l3", cj.Position(0.5), orientation=turned, motion=rocker),
    )
    closing = joint("close", "l2", "l3", cj.Position(0.5), cj.Position(0.3))
    gravity = cj.Gravity(z=-9.81) if out_of_plane else cj.Gravity(y=9.81)
    return cj.Mechanism((bar("l1", 0.2), bar("l2", 0.5), bar("l3", 0.3)), joints, (closing,), gravity=gravity)
