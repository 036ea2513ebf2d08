"""The five problems of the IFToMM library of computational benchmarks (A01 to A05), and how far they are solved.

Gonzalez, Dopico, Lugris, Cuadrado (2006): A benchmarking system for MBS simulation software: problem standardization
and performance measurement. Multibody System Dynamics 16, 179-190. What the mechanisms are made of stands in their
specifications (A01 to A05) and in github.com/RehabEngGroup/MBSbenchmarksInOpenSim; the reference curves are those of
its figures (help/images/*Plot*.pdf: vector graphics, six digits), in `experiments/reference/data`. The figure of A02
shows 40 windows, not 2, over a time that is drawn a hundredth too short: so read, it is the motion of parallelograms.
"""

import itertools
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

import clearance_jax as cj
from experiments.common import SCENES
from experiments.reference import squeezer

DATA = SCENES.parent / "reference" / "data"
DOWN = -9.81
# The corners at which the rods of A04 meet; the joint there turns about the axis.
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1]], float)
AXES = "yzxyzx"


class Compared(NamedTuple):
    """A quantity of a problem: the largest difference from the reference, how far that one is known, the energy
    residual of the solve, and how it ended.
    """

    problem: str
    quantity: str
    error: float
    digits: float
    energy: float
    ended: str

    @property
    def verdict(self) -> str:
        """Whether the two agree as far as the reference is known."""
        return "agrees" if self.error <= self.digits else "differs"


def curve(name: str) -> np.ndarray:
    """A reference curve, by columns."""
    return np.loadtxt(DATA / f"{name}.csv", delimiter=",", skiprows=1, unpack=True)


def pendulum() -> cj.Mechanism:
    """A01: a point of 1 kg at 1 m, released level with its pivot."""
    body = cj.Body("bob", 1.0, center_of_mass=cj.Position(1.0, 0.0))
    joint = cj.Revolute("pivot", "ground", "bob", motion=cj.Motion(position=np.pi))
    return cj.Mechanism(
        (body,), (joint,), points=(cj.Point("P1", "bob", cj.Position(1.0, 0.0)),), gravity=cj.Gravity(y=DOWN)
    )


def four_bars(windows: int = 2) -> cj.Mechanism:
    """A02: upright bars on the ground 1 m apart, level ones between their upper ends, all of 1 m and 1 kg; the upper
    ends move at 1 m/s to the right. When all bars lie level, the conditions of the loops repeat each other.
    """
    inertia, middle, end = 1 / 12, cj.Position(0.5, 0.0), cj.Position(1.0, 0.0)
    up, turning = np.pi / 2, -1.0
    names, loops = ["bar0"], []
    joints = [cj.Revolute("A0", "ground", "bar0", motion=cj.Motion(position=up, velocity=turning))]
    for k in range(1, windows + 1):
        level, bar = f"level{k}", f"bar{k}"
        names += [level, bar]
        # The first bar stands on the ground; the others hang from a level one, upside down.
        before, at, turned = ("bar0", end, -up) if k == 1 else (f"bar{k - 1}", cj.Position(), up)
        joints += [
            cj.Revolute(f"B{k}", before, level, at, motion=cj.Motion(position=turned, velocity=-turning)),
            cj.Revolute(f"C{k}", level, bar, end, motion=cj.Motion(position=-up, velocity=turning)),
        ]
        loops.append(cj.Revolute(f"A{k}", "ground", bar, cj.Position(float(k), 0.0), end))
    bodies = tuple(cj.Body(name, 1.0, inertia, middle) for name in names)
    return cj.Mechanism(
        bodies, tuple(joints), tuple(loops), points=(cj.Point("B0", "bar0", end),), gravity=cj.Gravity(y=DOWN)
    )


def bricard(cut: int = 5) -> cj.Mechanism:
    """A04: five slender rods of 1 m and 1 kg and the ground along edges of a cube, six revolute joints, each square to
    both rods that meet in it; one of the loop's conditions repeats others.

    The loop is closed by one of its joints, from 0 at A to 5 at F (`cut`): the rods before it hang on the ground by A,
    those after it by F. All frames lie along the world's axes at the start.
    """
    bodies, joints = [], []
    for i, (a, b) in enumerate(itertools.pairwise(CORNERS)):
        start, end = (a, b) if i < cut else (b, a)
        # A rod has next to no inertia about itself.
        inertia = np.where(a == b, 1 / 12, 1e-9)
        bodies.append(cj.Body(f"rod{i}", 1.0, inertia.tolist(), cj.Position(*((end - start) / 2))))

    def at(corner, i):
        """A corner as rod i, or the ground, has it, which hangs on the corner nearer to the ground."""
        return cj.Position(*(CORNERS[corner] - (CORNERS[i if i < cut else i + 1] if 0 <= i < 5 else 0.0)))

    def named(i):
        return f"rod{i}" if 0 <= i < 5 else "ground"

    for i in range(cut):
        joints.append(cj.Revolute(f"j{i}", named(i - 1), named(i), at(i, i - 1), axis=AXES[i]))
    for i in range(5, cut, -1):
        joints.append(cj.Revolute(f"j{i}", named(i), named(i - 1), at(i, i), axis=AXES[i]))
    loop = cj.Revolute(f"j{cut}", named(cut - 1), named(cut), at(cut, cut - 1), at(cut, cut), axis=AXES[cut])
    p3 = 1 if cut >= 2 else 2
    points = (cj.Point("P3", f"rod{p3}", at(2, p3)),)
    return cj.Mechanism(tuple(bodies), tuple(joints), (loop,), points=points, gravity=cj.Gravity(y=DOWN))


def governor() -> cj.Mechanism:
    """A05: a shaft that turns freely, two rods hinged at its top with 5 kg at their ends, and a slider on the shaft,
    which hangs on the middles of the rods by springs (8e5 N/m, 4e4 N s/m) in place of couplers.
    """
    density, section, edge = 3000.0, 0.01, 0.1
    rod = density * section**2
    across, along = rod * (1 + section**2) / 12, rod * section**2 / 6
    block = density * edge**3
    turned = np.pi / 3
    bodies = [
        cj.Body("shaft", rod, [across, across, along]),
        cj.Body("slider", block, [block * edge**2 / 6] * 3),
    ]
    joints = [
        cj.Revolute("turn", "ground", "shaft", axis="z", motion=cj.Motion(velocity=2 * np.pi)),
        cj.Prismatic("s", "shaft", "slider", axis="z", motion=cj.Motion(position=0.5)),
    ]
    springs = []
    for side, sign in (("left", -1.0), ("right", 1.0)):
        # A rod hangs from its hinge along -z: one body with the 5 kg at its end.
        mass = rod + 5.0
        centre = -(rod * 0.5 + 5.0) / mass
        heavy = across + rod * (centre + 0.5) ** 2 + 5.0 * (centre + 1.0) ** 2
        bodies.append(cj.Body(side, mass, [heavy, heavy, along], cj.Position(0.0, 0.0, centre)))
        hinge = cj.Position(sign * edge / 2, 0.0, 1.0)
        hung = cj.Motion(position=-sign * turned)
        joints.append(cj.Revolute(f"{side}_hinge", "shaft", side, hinge, axis="y", motion=hung))
        ends = cj.Position(sign * edge / 2, 0.0, 0.0), cj.Position(0.0, 0.0, -0.5)
        springs.append(cj.Spring(f"{side}_coupler", "slider", side, 8e5, 4e4, 0.5, *ends))
    gravity = cj.Gravity(z=DOWN)
    return cj.Mechanism(tuple(bodies), tuple(joints), springs=tuple(springs), gravity=gravity)


# Compared ------------------------------------------------------------------------------------------------------------

# Half of the sixth digit.
SIX = 5e-7
# B0 at 10 s as Exudyn's example of A02 prints it (fourBarMechanismIftomm.py), by steps of 1.25e-4 s.
FOUR_BARS_END = np.array([0.32845738, 0.94451879])


def parallelograms(times: np.ndarray, windows: int) -> np.ndarray:
    """The first bar's angle in A02 [rad], if every window stays a parallelogram: then the mechanism has one freedom."""
    upright, level = windows + 1, windows
    pull = 9.81 * (upright / 2 + level) / (upright / 3 + level)
    begin, until = [np.pi / 2, -1.0], (0.0, float(times[-1]))
    options: Any = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    return solve_ivp(lambda t, y: [y[1], -pull * np.cos(y[0])], until, begin, t_eval=times, **options).y[0]


def error_of_curves() -> float:
    """How far the reference curves are right: that of A02 against the same motion, computed to 1e-12 [m]."""
    times, known = curve("forty_four_bars_x")
    return float(np.abs(np.cos(parallelograms(times, 40)) - known).max())


def compare_pendulum() -> list[Compared]:
    times, *known = curve("pendulum_p1")
    found = cj.simulate(pendulum(), 10.0, save_at=times, rtol=1e-10)
    error = np.abs(np.asarray(found["P1.position"]) - np.stack(known, 1)).max()
    return [comparison("A01 simple pendulum", "P1, 10 s [m]", error, SIX, found)]


def compare_four_bars() -> list[Compared]:
    times = np.linspace(0.0, 10.0, 201)
    found = cj.simulate(four_bars(), 10.0, save_at=times, rtol=1e-8)
    position, angle = np.asarray(found["B0.position"]), parallelograms(times, 2)
    exact = np.stack([np.cos(angle), np.sin(angle)], 1)
    published = np.abs(exact[-1] - FOUR_BARS_END).max()
    end, whole = np.abs(position[-1] - FOUR_BARS_END).max(), np.abs(position - exact).max()
    title = "A02 two four-bars"
    return [
        comparison(title, "B0 at 10 s, by Exudyn [m]", end, 2 * published, found),
        comparison(title, "B0, 10 s, as parallelograms [m]", whole, 1e-6, found),
    ]


def compare_squeezer() -> list[Compared]:
    found = cj.simulate(cj.load(SCENES / "squeezer.toml"), float(squeezer.T1), rtol=1e-11, solver="dopri8")
    end = np.array([float(found[f"{name}.position"]) for name in squeezer.NAMES])
    title = "A03 Andrews' squeezer"
    return [
        comparison(title, "angles at 0.03 s, as published [rad]", np.abs(end - squeezer.PUBLISHED).max(), 2e-9, found),
        comparison(title, "angles at 0.03 s, recomputed [rad]", np.abs(end - squeezer.COMPUTED).max(), 1e-11, found),
    ]


def compare_bricard() -> list[Compared]:
    times, *known = curve("bricard_p3")
    found = cj.simulate(bricard(), 10.0, save_at=times, rtol=1e-10)
    position, velocity = (np.asarray(found[f"P3.{name}"]) for name in ("position", "velocity"))
    # One time has no more digits than the places have: the places at it are known so much less well.
    late = np.where(np.isclose(np.round(times / 0.2) * 0.2, times, atol=1e-9), 0.0, 5e-6)
    error = np.max(np.abs(position - np.stack(known, 1)) - late[:, None] * np.abs(velocity))
    return [comparison("A04 Bricard's mechanism", "P3, 10 s [m]", error, SIX, found)]


def compare_governor() -> list[Compared]:
    times, known = curve("governor_s")
    found = cj.simulate(governor(), float(times[-1]), save_at=times, rtol=1e-8)
    error = np.abs(np.asarray(found["s.position"]) - known).max()
    return [comparison("A05 flyball governor", "s, 3 s [m]", error, max(SIX, error_of_curves()), found)]


def comparison(problem: str, quantity: str, error: float, digits: float, found: cj.Solution) -> Compared:
    """A row, of the solve that it is about."""
    return Compared(
        problem, quantity, float(error), digits, float(found.energy_residual), str(found.message) or "reached t1"
    )


PROBLEMS = (compare_pendulum, compare_four_bars, compare_squeezer, compare_bricard, compare_governor)
