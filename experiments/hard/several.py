"""Several pins at once in the plane. Reference: Newton's and Euler's laws of every body, switchings located."""

from typing import NamedTuple

import numpy as np

import clearance_jax as cj
from clearance_jax import laws
from experiments.common import SCENES
from experiments.hard.amplification import amplified
from experiments.hard.case import Row, compared
from experiments.reference.loose_bodies import Body, Pin, parameters, problem_of, relative, start_of
from experiments.reference.problems import slider_crank_parameters
from experiments.reference.squeezer import START, constants

GROUND = -1


class Scene(NamedTuple):
    """Bodies, and pins by the names of the library's joints; `law`: the first eight numbers of `problems`.

    `arm` [m] and `rate` [rad/s]: the size of the machine and its speed; `limit`: the reference's longest step [s].
    """

    bodies: list[Body]
    pins: dict[str, Pin]
    law: list[float]
    arm: float
    rate: float
    limit: float
    guided: tuple[str, int] | None = None
    spring: tuple[float, ...] = (0.0,) * 7

    def places(self, y: np.ndarray) -> dict[str, np.ndarray]:
        """Of every coordinate of the library its course, and that of its rate."""
        out, of_pins = {}, relative(y, self.bodies, list(self.pins.values()))
        for name, (angle, ex, ey, rate, vx, vy) in zip(self.pins, of_pins, strict=True):
            out |= {name: (angle, rate), f"{name}.play_x": (ex, vx), f"{name}.play_y": (ey, vy)}
        if self.guided is not None:
            name, body = self.guided
            out[name] = (y[:, 3 * body], y[:, 3 * (len(self.bodies) + body)])
        return out

    def units(self) -> np.ndarray:
        """By what a start is changed to see what the scene amplifies."""
        clearance = self.law[1]
        free = np.array([body.inverse for body in self.bodies]) > 0
        place = np.array([clearance, clearance, clearance / self.arm])
        speed = np.array([self.rate * self.arm, self.rate * self.arm, self.rate])
        return np.concatenate([np.ravel(free * place), np.ravel(free * speed)])

    def examine(self, case: str, mechanism: cj.Mechanism, end: float, samples: int = 201) -> Row:
        names = [c.name for c in mechanism.free_coordinates()]

        def see(y):
            found = self.places(y)
            return np.stack([found[name][k] for k in (0, 1) for name in names], -1)

        t = np.linspace(0, end, samples)
        size = np.array([self.arm, self.arm, 1.0]), self.rate * np.array([self.arm, self.arm, 1.0])
        scale = np.concatenate([np.tile(one, len(self.bodies)) for one in size])
        # What matters of a place is a part of the clearance.
        scale *= np.repeat([self.law[1] / self.arm, 0.1], len(scale) // 2)
        p = parameters(self.law, self.bodies, list(self.pins.values()), self.spring)
        truth, amplification = amplified(problem_of(self.bodies, scale, self.limit), t, p, self.units(), see)
        play = relative(truth.y, self.bodies, list(self.pins.values()))[:, 1:3]
        bear = np.sum(np.hypot(play[:, 0], play[:, 1]) > self.law[1], axis=0)
        said = f"{len(truth.switchings)} switchings; {bear.mean():.1f} of {len(self.pins)} pins bear on average"
        start = see(start_of(self.bodies)[None])[0]
        return compared(
            case,
            mechanism,
            t,
            see(truth.y),
            lambda y: y[:, : 2 * len(names)],
            f"{said}, at most {bear.max()}",
            amplification=amplification,
            y0=start,
        )


def with_play(mechanism: cj.Mechanism, names, law: list[float]) -> cj.Mechanism:
    radius, clearance, stiffness, damping, depth, friction, transition, _ = law
    for name in names:
        normal = laws.AdamsImpact(stiffness, damping, depth)
        play = cj.RevoluteClearance(clearance, radius, normal, laws.TanhCoulomb(friction, transition))
        mechanism = mechanism.with_clearance(name, play)
    return mechanism


def law_of(clearance: float) -> list[float]:
    """That of the slider-crank."""
    return list(slider_crank_parameters(clearance)[:8])


def two(quick: bool) -> Row:
    speed, crank, conrod = 5000 * 2 * np.pi / 60, 0.05, 0.12
    bodies = [
        Body((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), speed=(0.0, 0.0, speed)),
        Body(
            (1 / 0.21, 1 / 0.21, 1 / 2.5e-4),
            (crank, 0.0, 0.0),
            (0.06, 0.0),
            (0.0, speed * crank, -speed * crank / conrod),
        ),
        Body((1 / 0.14, 0.0, 0.0), (crank + conrod, 0.0, 0.0)),
    ]
    pins = {"crankpin": Pin(0, (crank, 0.0), 1, (0.0, 0.0)), "wrist": Pin(1, (conrod, 0.0), 2, (0.0, 0.0))}
    scene = Scene(bodies, pins, law_of(2e-4), conrod, speed, 2e-6, ("guide", 2))
    m = cj.load(SCENES / "slider_crank_two_clearances.toml")
    m = with_play(m, pins, scene.law)
    return scene.examine("two clearances in contact", m, 2e-3 if quick else 12e-3)


def four(quick: bool) -> Row:
    speed = 3000 * 2 * np.pi / 60
    crank, coupler, rocker, ground = 0.05, 0.12, 0.08, 0.10
    # The triangle of coupler, rocker and the way from the crank's end to the rocker's pivot.
    base = ground - crank
    cos = (coupler**2 + base**2 - rocker**2) / (2 * coupler * base)
    angle = float(np.arccos(cos))
    tip = np.array([crank + coupler * np.cos(angle), coupler * np.sin(angle)])
    lean = float(np.arctan2(tip[1], tip[0] - ground))
    turn = np.array([[-tip[1], tip[1]], [tip[0] - crank, -(tip[0] - ground)]])
    rates = np.linalg.solve(turn, [0.0, -speed * crank])
    bodies = [
        Body((1 / 0.30, 1 / 0.30, 0.0), (0.0, 0.0, 0.0), (0.025, 0.0), (0.0, 0.0, speed)),
        Body(
            (1 / 0.21, 1 / 0.21, 1 / 2.52e-4),
            (crank, 0.0, angle),
            (0.06, 0.0),
            (0.0, speed * crank, float(rates[0])),
        ),
        Body((1 / 0.14, 1 / 0.14, 1 / 7.47e-5), (ground, 0.0, lean), (0.04, 0.0), (0.0, 0.0, float(rates[1]))),
    ]
    pins = {
        "main": Pin(GROUND, (0.0, 0.0), 0, (0.0, 0.0)),
        "crankpin": Pin(0, (crank, 0.0), 1, (0.0, 0.0)),
        "pivot": Pin(GROUND, (ground, 0.0), 2, (0.0, 0.0)),
        "knuckle": Pin(1, (coupler, 0.0), 2, (rocker, 0.0)),
    }
    scene = Scene(bodies, pins, law_of(1e-4), coupler, speed, 2e-6)
    m = cj.load(SCENES / "four_bar.toml")
    m = cj.replace(m, {"drive.main.speed": speed})
    return scene.examine("four clearances in contact", with_play(m, pins, scene.law), 1e-3 if quick else 5e-3)


def squeezer(quick: bool) -> Row:
    p = constants(float)
    beta, theta, gamma, phi, delta, omega, epsilon = (float(text) for text in START)

    def at(x, y, angle, along, across=0.0):
        c, s = np.cos(angle), np.sin(angle)
        return x + c * along - s * across, y + s * along + c * across

    a, b = (-0.06934, -0.00227), (p.xb, p.yb)
    e, z = p.e - p.ea, p.zf - p.fa
    frames = [
        (p.m1, p.i1, (0.0, 0.0, beta), (p.ra, 0.0)),
        (p.m2, p.i2, (*at(0.0, 0.0, beta, p.rr), beta + theta), (-p.da, 0.0)),
        (p.m3, p.i3, (*b, gamma), (p.sa, -p.sb)),
        (p.m4, p.i4, (*at(*a, delta, p.zt), delta + phi), (0.0, -e)),
        (p.m5, p.i5, (*a, delta), (p.ta, p.tb)),
        (p.m6, p.i6, (*at(*a, epsilon, 0.0, -p.u), epsilon + omega), (z, 0.0)),
        (p.m7, p.i7, (*a, epsilon), (p.ub, -p.ua)),
    ]
    bodies = [
        Body((1 / m, 1 / m, 1 / i), place, centre, torque=p.mom if k == 0 else 0.0)
        for k, (m, i, place, centre) in enumerate(frames)
    ]
    origin = (0.0, 0.0)
    pins = {
        "beta": Pin(GROUND, origin, 0, origin),
        "theta": Pin(0, (p.rr, 0.0), 1, origin),
        "gamma": Pin(GROUND, b, 2, origin),
        "delta": Pin(GROUND, a, 4, origin),
        "phi": Pin(4, (p.zt, 0.0), 3, origin),
        "epsilon": Pin(GROUND, a, 6, origin),
        "omega": Pin(6, (0.0, -p.u), 5, origin),
        "knot_3": Pin(1, (-p.d, 0.0), 2, (0.0, -p.ss)),
        "knot_4": Pin(1, (-p.d, 0.0), 3, (0.0, -p.e)),
        "knot_6": Pin(1, (-p.d, 0.0), 5, (p.zf, 0.0)),
    }
    law = [2e-3, 2e-5, 1e9, 100.0, 1e-5, 0.03, 0.01, np.inf]
    spring = (p.c0, p.l0, 2.0, p.sd - p.sa, -p.sc + p.sb, p.xc, p.yc)
    scene = Scene(bodies, pins, law, 0.03, 300.0, 5e-6, spring=spring)
    m = with_play(cj.load(SCENES / "squeezer.toml"), pins, law)
    return scene.examine("the squeezer with clearance in all ten joints", m, 2e-4 if quick else 2e-3)


CASES = (two, four, squeezer)
