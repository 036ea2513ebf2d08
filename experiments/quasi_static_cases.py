"""The cases of `experiments.quasi_static`: five mechanisms with random designs, payloads, moves and damping."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from clearance_jax.mechanism.motion.motion_laws import DriveSum
from experiments.common import SCENES

Random = np.random.Generator


class Case(NamedTuple):
    """A mechanism, the end of its motion [s], whether its joints are damped, and what is random of it, in words."""

    mechanism: cj.Mechanism
    end: float
    damped: bool
    said: str


def between(rng: Random, low: float, high: float) -> float:
    """A number, log-uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def smooth_or_not(rng: Random, took: float, at: float, rise: float, smooth: bool) -> DriveSum:
    """A move by a quintic, or by a trapezoid of accelerations; both in one program."""
    quintic = cj.drives.Quintic([0.0, took], [at, at + (rise if smooth else 0.0)])
    trapezoid = cj.drives.Trapezoid([0.0], [0.0 if smooth else rise], duration=[took])
    return DriveSum((quintic, trapezoid))


def filled(mechanism: cj.Mechanism, damping: dict[str, tuple[float, float]]) -> cj.Mechanism:
    """The mechanism with dampers over the play of joints: by name [N s/m] and [N m s/rad]."""
    for joint in mechanism.clearance_joints():
        radial, tilt = damping[joint.name]
        damper = cj.joints.PlayDamper(radial, radial, tilt)
        mechanism = mechanism.with_clearance(joint.name, dataclasses.replace(joint.clearance, element=damper))
    return mechanism


def held(arm: cj.Mechanism, point: str, payload: float) -> cj.Mechanism:
    """An arm with a payload [kg], a lump of 60 mm, at one of its points."""
    tool = next(one for one in arm.points if one.name == point)
    inertia = 0.4 * payload * 0.03**2
    body = cj.Body("payload", payload, cj.Inertia(inertia, inertia, inertia))
    joint = cj.Fixed("payload_held", tool.body, "payload", tool.at)
    return dataclasses.replace(arm, bodies=(*arm.bodies, body), joints=(*arm.joints, joint))


def loaded_crank(rng: Random, damped: bool) -> Case:
    speed, load = between(rng, 10, 150), between(rng, 30, 600)
    c = [between(rng, 5e-6, 2e-4) for _ in range(2)]
    mechanism = cj.replace(
        cj.load(SCENES / "slider_crank_loaded.toml"),
        {
            "drive.main.speed": speed,
            "guide.actuator.load.effort": -load,
            "crankpin.radial_clearance": c[0],
            "wrist.radial_clearance": c[1],
        },
    )
    damping = between(rng, 30, 3000) if damped else 0.0
    mechanism = filled(mechanism, {name: (damping, 0.0) for name in ("crankpin", "wrist")})
    said = f"{speed:.0f} rad/s, {load:.0f} N, {um(c)}, {damping:.0f} N s/m"
    return Case(mechanism, 2 * np.pi / speed, damped, said)


def joint5(rng: Random, damped: bool) -> Case:
    took, mass, c = between(rng, 0.15, 1.5), between(rng, 30, 300), between(rng, 5e-6, 3e-4)
    at, rise, smooth = rng.uniform(-0.5, 0.5), rng.uniform(0.3, 1.5) * rng.choice([-1, 1]), bool(rng.integers(2))
    rubs, damping = float(rng.choice([0.0, 0.05, 0.15])), between(rng, 300, 3e4) if damped else 0.0
    mechanism = cj.load(SCENES / "joint5_velocity_1.toml").with_drives(
        {"joint5": smooth_or_not(rng, took, at, rise, smooth)}
    )
    numbers = {"payload.mass": mass, "payload.inertia": 7.0 * mass / 300, "joint5.radial_clearance": c}
    mechanism = cj.replace(mechanism, numbers | {"joint5.friction.coefficient": rubs})
    mechanism = filled(mechanism, {"joint5": (damping, 0.0)})
    said = f"{kind(smooth)} of {took:.2g} s, {mass:.0f} kg, {um([c])}, friction {rubs}, {damping:.0f} N s/m"
    return Case(mechanism, took, damped, said)


def tool_changer(rng: Random, damped: bool) -> Case:
    took, mass, c = between(rng, 0.25, 2.0), between(rng, 50, 300), between(rng, 5e-6, 3e-4)
    at, rise, smooth = rng.uniform(-0.5, 0.5), rng.uniform(0.3, 1.5) * rng.choice([-1, 1]), bool(rng.integers(2))
    rubs, damping = float(rng.choice([0.0, 0.05, 0.15])), between(rng, 300, 3e4) if damped else 0.0
    turn = smooth_or_not(rng, took, at, rise, smooth)
    yaw = smooth_or_not(rng, took, 0.0, rng.uniform(-0.3, 0.3), smooth)
    mechanism = cj.load(SCENES / "tool_changer.toml").with_drives({"joint5": turn, "yaw": yaw})
    part = mass / 300
    numbers = {"cutter.mass": mass, "joint5.radial_clearance": c, "joint5.axial_clearance": between(rng, 2e-5, 2e-4)}
    numbers |= {f"cutter.inertia.{axis}{axis}": part * value for axis, value in zip("xyz", (8, 4.5, 4.5), strict=True)}
    mechanism = cj.replace(mechanism, numbers | {"joint5.friction.coefficient": rubs})
    mechanism = filled(mechanism, {"joint5": (damping, damping * 0.06**2 / 12)})
    said = f"{kind(smooth)} of {took:.2g} s, {mass:.0f} kg, {um([c])}, friction {rubs}, {damping:.0f} N s/m"
    return Case(mechanism, took, damped, said)


def _arm(
    rng: Random, damped: bool, arm: cj.Mechanism, axes: Sequence[str], ranges: list[float], still: Sequence[str]
) -> Case:
    """An arm of six axes whose second, third and fifth have sleeves."""
    took, payload, smooth = between(rng, 0.25, 2.0), between(rng, 0.1, 5.0), bool(rng.integers(2))
    at = rng.uniform(-1, 1, 6) * np.radians(ranges)
    rises = -np.sign(at) * rng.uniform(0.05, 0.6, 6) * np.minimum(took, 1.0)
    axes_at = zip(axes, at, rises, strict=True)
    drives = {name: smooth_or_not(rng, took, x, rise, smooth) for name, x, rise in axes_at}
    arm = held(arm, "tcp" if still else "tool", payload).with_drives(
        drives | {name: cj.drives.Constant(0.02) for name in still}
    )
    damping, c = {}, []
    for name, size, length in zip([axes[k] for k in (1, 2, 4)], (0.030, 0.025, 0.015), (0.08, 0.06, 0.04), strict=True):
        c.append(between(rng, 5e-6, 1e-4))
        arm = arm.with_clearance(name, kind="sleeve", radial_clearance=c[-1], pin_radius=size, length=length)
        radial = between(rng, 100, 1e4) if damped else 0.0
        damping[name] = radial, radial * length**2 / 12
    said = f"{kind(smooth)} of {took:.2g} s, {payload:.2g} kg, {um(c)}, "
    said += ", ".join(f"{radial:.0f}" for radial, _ in damping.values()) + " N s/m"
    return Case(filled(arm, damping), took, damped, said)


def six_axes(rng: Random, damped: bool) -> Case:
    arm = cj.load_urdf(SCENES / "six_axes.urdf", end_effector="tcp")
    axes = [f"axis_{k + 1}" for k in range(6)]
    return _arm(rng, damped, arm, axes, [170, 60, 120, 180, 110, 180], ("finger_left", "finger_right"))


def ur5(rng: Random, damped: bool) -> Case:
    arm = cj.load_urdf(SCENES / "ur5_layout.urdf", end_effector="tool")
    axes = ["pan", "lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
    return _arm(rng, damped, arm, axes, [170, 90, 140, 170, 170, 170], ())


def um(clearances: Sequence[float]) -> str:
    return ", ".join(f"{1e6 * c:.0f}" for c in clearances) + " um"


def kind(smooth: bool) -> str:
    return "quintic" if smooth else "trapezoid"


MECHANISMS: dict[str, tuple[Callable[[Random, bool], Case], str]] = {
    "loaded slider-crank": (loaded_crank, "piston"),
    "joint 5 in the plane": (joint5, "end"),
    "tool changer": (tool_changer, "end"),
    "arm of six axes": (six_axes, "tcp"),
    "arm of the UR5's layout": (ur5, "tool"),
}
"""By what a case is made, and the point whose error is compared."""


def cases(name: str, count: int, seed: int) -> list[Case]:
    """Random cases; every second one is damped."""
    rng = np.random.default_rng([seed, list(MECHANISMS).index(name)])
    return [MECHANISMS[name][0](rng, k % 2 == 1) for k in range(count)]


def stacked(found: Sequence[Case]) -> tuple[cj.Mechanism, jax.Array]:
    """The mechanisms of cases as lanes, and the ends of their motions."""
    mechanisms = jax.tree.map(
        lambda *leaves: jnp.stack([jnp.asarray(x) for x in leaves]), *(c.mechanism for c in found)
    )
    return mechanisms, jnp.asarray([case.end for case in found])
