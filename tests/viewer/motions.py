"""Motions made by hand, as datasets: a crank with a rod in the plane, an arm in space. Nothing is compiled for them."""

from typing import Any

import numpy as np
import xarray as xr

from clearance_jax.joints import JointOutline
from clearance_jax.results.play import outline_attributes

CLEARANCE = 1e-4
PIN = JointOutline(0.01, CLEARANCE)


def crank(
    samples: int = 201, outline: JointOutline = PIN, play: bool = True, name: str = "crank", wrist: str = "wrist"
) -> xr.Dataset:
    """A crank (joint `base` on the ground) and a rod (joint with play), whose end is the point `tip`."""
    time = np.linspace(0.0, 0.5, samples)
    turn, swing = 4 * np.pi * time, 0.3 * np.sin(9 * time)
    pin = 0.2 * np.stack([np.cos(turn), np.sin(turn)], 1)
    gap = CLEARANCE * np.stack([np.cos(31 * time), np.sin(17 * time)], 1) * play
    rod = 0.4 * np.stack([np.cos(swing), np.sin(swing)], 1)
    zero = np.zeros_like(pin)
    ideal = np.stack([zero, zero, pin, pin, pin + rod], axis=1)
    error = np.stack([zero, zero, zero, gap, 1.5 * gap], axis=1)
    marks = {"mark": ["base", "base", wrist, wrist, "tip"], "mark_body": ["ground", "crank", "crank", "rod", "rod"]}
    force = 100.0 * np.abs(np.sin(40 * time))
    data: dict[str, Any] = {"mark_position": (("time", "mark", "axis"), ideal + error)}
    data["joint_reaction"] = (("time", "any_joint", "axis"), np.stack([gap, gap], 1) / CLEARANCE * force[:, None, None])
    coords = {name: ("mark", labels) for name, labels in marks.items()}
    coords |= {"time": time, "axis": ["x", "y"], "any_joint": ["base", wrist], "point": ["tip"], "coordinate": ["base"]}
    attrs: dict[str, Any] = {"mechanism": name, "software": "clearance_jax"}
    if play:
        data["ideal_mark_position"] = (("time", "mark", "axis"), ideal)
        data["eccentricity"] = (("time", "joint", "axis"), gap[:, None])
        data["contact_force"] = (("time", "joint"), force[:, None])
        data["contact_state"] = (("time", "joint"), (force > 30).astype(int)[:, None])
        data["q"] = (("time", "coordinate"), turn[:, None])
        coords["joint"] = [wrist]
        attrs |= outline_attributes(wrist, outline)
    return xr.Dataset(data, coords, attrs)


def arm(samples: int = 1001, axes: int = 6) -> xr.Dataset:
    """An arm in space with play in all of its joints, which moves for one second."""
    rng = np.random.default_rng(7)
    time = np.linspace(0.0, 1.0, samples)
    joints, place, direction = [f"axis_{k}" for k in range(axes)], np.zeros((samples, 3)), np.zeros((samples, 3))
    at, error, names, bodies = [], [], [], []
    for k, joint in enumerate(joints):
        gap = 3e-5 * np.sin(np.outer(time, rng.uniform(5, 60, 3)) + rng.uniform(0, 6, 3))
        direction = direction + gap
        at += [place, place]
        error += [direction - gap, direction]
        names += [joint, joint]
        bodies += [f"link_{k - 1}" if k else "ground", f"link_{k}"]
        angles = np.outer(time, rng.uniform(0.5, 2, 2)) + rng.uniform(0, 3, 2)
        place = place + 0.3 * np.stack(
            [np.cos(angles[:, 0]), np.sin(angles[:, 0]) * np.cos(angles[:, 1]), np.sin(angles[:, 1])], 1
        )
    names, bodies, at, error = [*names, "tool"], [*bodies, f"link_{axes - 1}"], [*at, place], [*error, direction]
    ideal = np.stack(at, axis=1)
    shape = (samples, axes)
    data: dict[str, Any] = {"mark_position": (("time", "mark", "axis"), ideal + np.stack(error, axis=1))}
    data |= {"ideal_mark_position": (("time", "mark", "axis"), ideal)}
    data |= {"joint_reaction": (("time", "any_joint", "axis"), 50 * rng.standard_normal((*shape, 3)))}
    data |= {"eccentricity": (("time", "joint", "axis"), 3e-5 * rng.standard_normal((*shape, 3)))}
    data |= {"pin_tilt": (("time", "joint", "across"), 1e-4 * rng.standard_normal((*shape, 2)))}
    data |= {
        "contact_force": (("time", "joint"), rng.uniform(0, 90, shape)),
        "q": (("time", "coordinate"), np.zeros(shape)),
    }
    data |= {"contact_state": (("time", "joint"), rng.integers(0, 3, shape))}
    coords = {"mark": ("mark", names), "mark_body": ("mark", bodies), "time": time, "axis": ["x", "y", "z"]}
    coords |= {"any_joint": joints, "joint": joints, "point": ["tool"], "coordinate": joints, "across": ["x", "y"]}
    attrs: dict[str, Any] = {"mechanism": "arm"}
    for joint in joints:
        ends = np.array([-0.02, 0.02])
        attrs |= outline_attributes(
            joint, JointOutline(0.02, 3e-5, None, 0.04, ends, True, axial=2e-5, collar=0.025, ring=8)
        )
    return xr.Dataset(data, coords, attrs)
