"""A pin in one sleeve: impacts, rest, friction. Reference: the hand-written equations of joint 5, whose drive stands
still here, with every switching located; or a closed form.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

import clearance_jax as cj
from clearance_jax import laws
from experiments.hard.amplification import amplified
from experiments.hard.case import RTOLS, Row, Solved, compared, examine, options
from experiments.reference.located import Solution, dop853
from experiments.reference.problems import CONTACT, PROBLEMS, Problem

MASS, RADIUS, GRAVITY, HERTZ = 0.14, 0.01, 9.81, 6.61e10
WEIGHT = MASS * GRAVITY
ALL, UPRIGHT = (0, 1, 2, 3), (1, 3)
"""The states of a pin that moves up and down only."""


class Scene(NamedTuple):
    """A pin of the mass `MASS` in a sleeve at rest, under gravity; its law is that of ADAMS with the cubic friction.

    `start`: eccentricity [m] and velocity [m/s]; `limit`: the longest step of the reference [s].
    """

    clearance: float
    stiffness: float
    damping: float
    depth: float
    start: tuple[float, float, float, float]
    limit: float
    friction: float = 0.0
    transition: float = 1e-2
    arm: float = 0.0
    drive: tuple[float, ...] = ()
    radius: float = RADIUS

    def parameters(self) -> np.ndarray:
        corner = self.transition if self.friction else np.inf
        law = [self.radius, self.clearance, self.stiffness, self.damping, self.depth, self.friction, self.transition]
        return np.array([*law, corner, MASS, self.arm, 0.0, GRAVITY, *self.drive])

    @property
    def problem(self) -> Problem:
        return PROBLEMS["joint5"]._replace(start=lambda p: np.array(self.start))

    def truth(self, t: np.ndarray) -> Solution:
        return dop853(self.problem, t, self.parameters(), limit=self.limit)

    def mechanism(self) -> cj.Mechanism:
        friction = laws.CubicCoulomb(self.friction, self.transition) if self.friction else None
        law = laws.AdamsImpact(self.stiffness, self.damping, self.depth)
        if not self.drive:
            return pin(law, self.clearance, friction, radius=self.radius)
        begin, end, rise = self.drive
        step = cj.drives.StepSum(np.array([begin]), np.array([end]), np.array([rise]))
        return pin(law, self.clearance, friction, step, self.arm, self.radius)

    def examine(self, case: str, end: float, remark: str = "", columns: Sequence[int] = ALL, **given: Any) -> Row:
        """Examine the `columns` of the states."""
        t = np.linspace(0, end, 201)
        p = self.parameters()

        def see(y):
            return y[:, list(columns)]

        truth, amplification = amplified(self.problem, t, p, self.problem.scale(p), see, self.limit)
        said = f"{len(truth.switchings)} switchings{'; ' if remark else ''}{remark}"
        return compared(
            case,
            self.mechanism(),
            t,
            see(truth.y),
            see,
            said,
            amplification=amplification,
            y0=np.array(self.start),
            **given,
        )


def traced(rtol: float) -> dict[str, Any]:
    """The options of a solve that `trace` takes."""
    return {name: value for name, value in options(rtol).items() if name != "throw"}


def pin(law, clearance: float, friction=None, drive=None, arm: float = 0.0, radius: float = RADIUS) -> cj.Mechanism:
    """A pin in a sleeve at rest; with a drive it turns, and carries a mass at the end of an arm."""
    joint = cj.RevoluteClearance(clearance, radius, law, friction)
    motion = cj.Motion(cj.drives.ConstantSpeed(0.0) if drive is None else drive)
    body = cj.Body("pin", MASS, None, cj.Position(arm, 0.0))
    return cj.Mechanism(
        bodies=(body,),
        joints=(cj.Revolute("joint", "ground", "pin", motion=motion, clearance=joint),),
        gravity=cj.Gravity(y=-GRAVITY),
    )


# Impacts --------------------------------------------------------------------------------------------------------------


def plastic(quick: bool) -> Row:
    scene = Scene(1e-3, HERTZ, 3e5, 1e-6, (1e-4, 0.0, 0.0, 0.0), 2e-5)
    return scene.examine("plastic impact", 0.02 if quick else 0.05, "a fall of 1 mm")


def chattering(quick: bool) -> Row:
    scene = Scene(1e-3, HERTZ, 1500.0, 1e-6, (1e-4, 0.0, 0.0, 0.0), 2e-5)
    end = 0.1 if quick else 0.3
    touches = int(np.sum(scene.truth(np.linspace(0, end, 201)).switchings[:, 1] == 0) + 1) // 2
    return scene.examine("chattering to rest", end, f"{touches} impacts, each weaker than the one before")


def grazing_throw(quick: bool) -> Row:
    """A throw whose top lies a nanometre beyond the wall: a millionth of the clearance."""
    return _thrown(1e-6)


def bare_touch(quick: bool) -> Row:
    """A throw whose top lies a picometre beyond the wall: less than what a loose tolerance resolves."""
    return _thrown(1e-9)


def _thrown(beyond: float) -> Row:
    """`beyond`: how far the top lies beyond the wall, in parts of the clearance."""
    c = 1e-3
    up = float(np.sqrt(2 * GRAVITY * c * (1 + beyond)))
    scene = Scene(c, HERTZ, 2000.0, 1e-5, (0.0, 0.0, 0.0, up), 1e-4)
    end = 1.5 * up / GRAVITY
    m, counts = scene.mechanism(), []
    for rtol in RTOLS:
        trace = cj.trace(m, end, y0=np.array(scene.start), save_at=11, **traced(rtol))
        counts.append(int(np.sum(np.diff((trace.y[:, 1] > c).astype(int)) == 1)))
    said = f"top {c * beyond:.0e} m beyond the wall; contacts seen: {', '.join(map(str, counts))} of 1"
    due = [count for count, rtol in zip(counts, RTOLS, strict=True) if beyond >= rtol]
    checks = [("a contact as deep as rtol times the clearance is not seen", all(count == 1 for count in due))]
    return scene.examine(f"grazing throw, {c * beyond:.0e} m deep", end, said, UPRIGHT, checks=checks)


def deep_overlap(quick: bool) -> Row:
    c = 1e-4
    scene = Scene(c, 1e8, 50.0, 1e-5, (0.3 * c, -1.5 * c, 0.0, 0.0), 1e-5)
    return scene.examine("start in deep overlap", 2e-3 if quick else 0.02, "overlaps by half the clearance")


def bouncing(quick: bool) -> Row:
    impacts, clearance = (5 if quick else 1000), 1e-3
    m = pin(laws.Hertz(HERTZ), clearance)
    # From the centre the pin falls through the clearance and comes back; Hertz's impact lasts 2.943 d / v.
    speed = np.sqrt(2 * GRAVITY * clearance)
    deepest = (5 * MASS * speed**2 / (4 * HERTZ)) ** 0.4
    end = (2 * speed / GRAVITY + 2.943 * deepest / speed) * (impacts + 0.25)
    counts = []

    def drift(solution):
        y = np.asarray(solution.y)
        d = np.maximum(-y[:, 1] - clearance, 0)
        total = MASS * (0.5 * y[:, 3] ** 2 + GRAVITY * y[:, 1]) + HERTZ * d**2.5 / 2.5
        return float(np.abs(total - total[0]).max() / (WEIGHT * clearance))

    def solve(rtol):
        trace = cj.trace(m, end, save_at=101, **traced(rtol))
        counts.append(cj.to_dataset(m, trace).sizes["episode"])
        return Solved(trace.solution, drift(trace.solution))

    row = examine(
        f"undamped bouncing, {impacts} impacts",
        4,
        solve,
        "change of energy over m g c, at the tightest tolerance below 1e-8",
        rtols=(1e-8, 1e-10, 1e-12),
        bound=lambda rtol: 3000 * rtol if rtol > 1e-12 else 1e-8,
    )
    lost = tuple(f"{n} impacts counted" for n in counts if n != impacts)
    return row._replace(broken=row.broken + lost)


def jumps(quick: bool) -> Row:
    """A force that jumps at touch: linear spring and damper that may pull. Its reference is the closed form."""
    clearance, k, b = 1e-3, 1e7, 300.0
    m = pin(laws.LinearKelvinVoigt(k, b, clipped=False), clearance)
    t = np.linspace(0, 0.03 if quick else 0.06, 201)
    fall, count = kelvin_voigt(t, clearance, k, b)
    return compared(
        "acceleration jumps at contact",
        m,
        t,
        fall,
        lambda y: y[:, list(UPRIGHT)],
        f"linear damper, {count} touches; closed form",
    )


def kelvin_voigt(t: np.ndarray, c: float, k: float, b: float) -> tuple[np.ndarray, int]:
    """Height and speed of a pin that falls from the centre, by closed forms from touch to touch, and how many."""
    decay, omega = b / (2 * MASS), np.sqrt(k / MASS - (b / (2 * MASS)) ** 2)
    sag = WEIGHT / k
    out, now, y, v, count = np.empty((len(t), 2)), 0.0, 0.0, 0.0, 0

    def flight(s):
        return y + v * s - GRAVITY * s * s / 2, v - GRAVITY * s

    def contact(s):
        # The overlap less its value at rest is a damped oscillation; it begins with -sag and the speed -v.
        start, fast = -sag, -v
        other = (fast + decay * start) / omega
        damp, cos, sin = np.exp(-decay * s), np.cos(omega * s), np.sin(omega * s)
        x = damp * (start * cos + other * sin)
        rate = damp * ((omega * other - decay * start) * cos - (omega * start + decay * other) * sin)
        return -c - (x + sag), -rate

    while True:
        ends = now + (v + np.sqrt(v * v + 2 * GRAVITY * (y + c))) / GRAVITY
        inside = (t >= now) & (t <= ends)
        out[inside] = np.transpose(flight(t[inside] - now))
        if ends >= t[-1]:
            return out, count
        y, v = flight(ends - now)
        now, count = ends, count + 1
        duration = separation(contact, np.pi / omega, c)
        inside = (t >= now) & (t <= now + duration)
        out[inside] = np.transpose(contact(t[inside] - now))
        if now + duration >= t[-1]:
            return out, count
        y, v = -c, contact(duration)[1]
        now += duration


def separation(contact, half: float, c: float) -> float:
    """When a contact that lasts about half a period ends, by Newton's method from there."""
    s = half
    for _ in range(50):
        height, speed = contact(s)
        s -= (height + c) / speed
    return s


# Rest and friction ----------------------------------------------------------------------------------------------------


def resting(quick: bool) -> Row:
    m, exact = pin(laws.HuntCrossley(HERTZ, 100.0), 1e-4), (WEIGHT / HERTZ) ** (2 / 3)
    end = 2.0 if quick else 60.0

    def solve(rtol):
        solution = cj.simulate(m, end, **options(rtol))
        return Solved(solution, abs((-float(solution["joint.play_y"]) - 1e-4) / exact - 1))

    return examine(f"pin resting in the sleeve for {end:g} s", 4, solve, "penetration against (W/K)^(2/3)")


def slow_hour(quick: bool) -> Row:
    end = 36.0 if quick else 3600.0
    c = 1e-4
    stiffness = 1.4e6
    low = c + (WEIGHT / stiffness) ** (2 / 3)
    scene = Scene(
        c,
        stiffness,
        20.0,
        1e-5,
        (0.0, -low, 0.0, 0.0),
        0.1,
        0.3,
        1e-2,
        0.17662,
        (0.0, end, 2 * np.pi),
    )
    said = "one turn of an arm in a sleeve of plastic; error of places"
    return scene.examine(f"{end / 3600:g} h of slow motion", end, said, (0, 1))


def lift_off(quick: bool) -> Row:
    """The arm is turned so that the pin is drawn off the wall before it slips."""
    c = 1e-4
    low = c + (WEIGHT / HERTZ) ** (2 / 3)
    scene = Scene(c, HERTZ, 2000.0, 1e-5, (0.0, -low, 0.0, 0.0), 2e-5, 0.3, 1e-2, 0.17662, (0.0, 0.02, 0.02), 1e-3)
    end = 0.02
    first = scene.truth(np.linspace(0, end, 201)).switchings[0]
    stuck = first[1] in (0, 1) and first[2] != CONTACT
    return scene.examine(
        "loss of contact while stuck", end, "", checks=(("the pin slips before it leaves the wall", bool(stuck)),)
    )


CASES = (plastic, chattering, grazing_throw, bare_touch, deep_overlap, bouncing, jumps, resting, slow_hour, lift_off)
