"""What fills the play of a joint and acts without touch, by `docs/joints.md`: force and moment on the pin."""

import numpy as np

from .quantities import cross, number

NODES, WEIGHTS = np.polynomial.legendre.leggauss(200)


def filling(table, geometry, held):
    """The wrench of an element over the pose of the pin, and what it stores. `held`: directions without play, in which
    nothing acts.
    """
    return KINDS[table["type"]](table, geometry, held)


def _free(held):
    """Which slides, and which tilts, are play."""
    slides = np.array([0.0 if name in held else 1.0 for name in ("x", "y", "z")])
    tilts = np.array([0.0 if name in held else 1.0 for name in ("turn x", "turn y")] + [0.0])
    return slides, tilts


ACROSS, ALONG = np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def _damper(table, geometry, held):
    slides, tilts = _free(held)
    factors = (ACROSS * number(table["radial"]) + ALONG * number(table.get("axial", 0.0))) * slides
    tilt = number(table.get("tilt", 0.0)) * tilts
    return lambda pose: (-factors * pose.velocity, -tilt * pose.spin), lambda pose: 0.0


def _preloaded(table, geometry, held):
    slides, tilts = _free(held)
    time = number(table.get("damping_time", 1e-5))

    def of(direction):
        stiffness = number(table.get(f"{direction}_stiffness", 0.0))
        return stiffness, number(table.get(f"{direction}_preload", np.inf))

    parts = [(of("radial"), ACROSS * slides), (of("axial"), ALONG * slides)]
    tilt = of("tilt")

    def deflected(pose):
        a = pose.rotation[:, 2]
        angle = np.arctan2(np.hypot(a[0], a[1]), a[2])
        axis = cross(ALONG, a)
        sine = np.sqrt(axis @ axis)
        return angle, 2 * np.sin(angle / 2) * (axis / sine if sine > 0 else axis) * tilts

    def borne(x, v, stiffness, preload):
        return -stiffness * x / np.sqrt(1 + (stiffness / preload) ** 2 * (x @ x)) - time * stiffness * v

    def wrench(pose):
        force = sum(borne(pose.place * where, pose.velocity * where, *of) for of, where in parts)
        angle, x = deflected(pose)
        stiffness, preload = tilt
        spring = -stiffness * x / np.sqrt(1 + (stiffness / preload) ** 2 * (x @ x))
        return force, np.cos(angle / 2) * spring - time * stiffness * pose.spin * tilts

    def held_by(x, stiffness, preload):
        """The integral of k x / sqrt(1 + (k x / P)^2)."""
        if not np.isfinite(preload):
            return 0.5 * stiffness * x @ x
        ratio = (stiffness / preload) ** 2 * (x @ x)
        # sqrt(1 + ratio) - 1 without cancellation.
        return preload**2 / stiffness * ratio / (1 + np.sqrt(1 + ratio)) if stiffness else 0.0

    def stores(pose):
        return sum(held_by(pose.place * where, *of) for of, where in parts) + held_by(deflected(pose)[1], *tilt)

    return wrench, stores


def _film(table, geometry, held):
    """The pressures of the film, integrated by Gauss over the half of its circumference where they are positive."""
    viscosity, least = number(table["viscosity"]), number(table["roughness"]) / geometry.clearance
    c, r, length = geometry.clearance, geometry.pin_radius, geometry.length

    def wrench(pose):
        p, v, turning = pose.place[:2], pose.velocity[:2], pose.spin[2]
        distance = np.sqrt(p @ p)
        n = p / distance if distance > 0 else np.array([1.0, 0.0])
        # The height is held above the roughness: from twice the roughness on, the eccentricity grows less than the pin
        # goes, by the factor 1 - STEP5.
        ratio = distance / c
        s = np.clip((ratio - 1 + 2 * least) / (2 * least), 0, 1)
        e = c * (min(ratio, 1 - 2 * least) + 2 * least * (s - s**4 * (2.5 + s * (s - 3))))
        # Line load over the angle t from n: mu L^3 / h^3 (-h' - w/2 dh/dt), h = c - e cos t.
        ahead, beside = v @ n, v @ np.array([-n[1], n[0]]) - 0.5 * turning * e
        begin = np.arctan2(beside, ahead) - np.pi / 2  # -h' - w/2 h_t = ahead cos t + beside sin t > 0 from here on
        angles = begin + np.pi / 2 * (NODES + 1)
        height = c - e * np.cos(angles)
        load = viscosity * length**3 / height**3 * (ahead * np.cos(angles) + beside * np.sin(angles))
        along, around = (np.pi / 2 * WEIGHTS @ (load * f(angles)) * -r for f in (np.cos, np.sin))
        shear = 2 * np.pi * viscosity * r**3 * length * turning / (c * np.sqrt(1 - (e / c) ** 2))
        force = np.array([along * n[0] - around * n[1], along * n[1] + around * n[0], 0.0])
        return force, np.array([0.0, 0.0, -0.5 * e * around - shear])

    return wrench, lambda pose: 0.0


KINDS = {"damper": _damper, "preloaded-bearing": _preloaded, "short-bearing": _film}
