"""Published numbers and other programs beside the library: `python -m experiments.published` writes its tables to out/.

**The same slider-crank in other programs.** It has one pin with 0.5 mm of play, between conrod and slider, and its
crank turns at 5000 rpm. *Exudyn* has bodies, joints and steps of its own, and the library's contact law as a function
(ADAMS IMPACT with a tanh friction). So the motions must agree, and they do as Exudyn's step falls. *MuJoCo* has another
law: its joints and limits are soft constraints, whose stiffness follows from the step. Its ideal slider-crank is
compared with the closed form of the slider's position. Its slider-crank with play is compared only in kind: the pin is
held to the sleeve by a limit of the distance, which has no Hertz stiffness and no friction. A soft limit rests at the
play itself, so how often its distance crosses the play (*touches*) says little.
Exudyn and MuJoCo are no dependencies (`pip install exudyn mujoco`); one that is missing is left out.

**Published numbers.** *Siconos*: free motion of a slider-crank before its slider touches the guide. The source makes
steps of 1e-4 s by a scheme of first order. The same scheme, for equations written by hand, gives the effect of this
step, which is most of the uncertainty. *Less its step* are the published numbers without this effect; their uncertainty
is twice what the hand-written scheme differs from the source. *From memory* marks numbers of Flores and Ambrosio (2004)
that no source at hand confirms: they are compared, and prove nothing. Their slider-crank has the law of Lankarani and
Nikravesh, a restitution of 0.9 and no friction; its peaks are those of the second revolution.

**The IFToMM library of computational benchmarks.** `experiments/iftomm.py` has the mechanisms and the sources of the
reference numbers. A curve has six digits; that of A05 is taken to be as good as that of A02, whose motion is known (the
pose of a parallelogram is one angle). The number of A02 comes from Exudyn, and its uncertainty is twice its difference
from the same parallelograms. Several times in this motion all bars lie level: a singular pose, in which the conditions
of the loops repeat each other. The flexible rod of the slider-crank of the Test Set for IVP Solvers cannot be set up,
because all bodies of the library are rigid.
"""

import dataclasses
import importlib.util
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import clearance_jax as cj
from experiments import iftomm
from experiments.common import CRANK_SPEED, as_reference, output, slider_crank, table
from experiments.publish import command, say, write
from experiments.reference import exudyn_slider_crank, mujoco_slider_crank, siconos_slider_crank

PLAY = 5e-4
REVOLUTION = 0.012
CRANK, ROD = 0.05, 0.12


class Peer(NamedTuple):
    """Another program's slider-crank: its step [s], and its largest difference from what it is compared with."""

    program: str
    compared: str
    step: float
    angle: float | None
    position: float
    cpu: float


class Number(NamedTuple):
    """A published number beside ours."""

    source: str
    quantity: str
    published: float | str
    uncertainty: float | None
    ours: float

    @property
    def verdict(self) -> str:
        """Whether ours is as near as the published number is known."""
        if self.uncertainty is None or isinstance(self.published, str):
            return "from memory"
        return "agrees" if abs(self.ours - self.published) <= self.uncertainty else "differs"


def is_installed(name: str) -> bool:
    """Whether a program is there; said where it is not."""
    there = importlib.util.find_spec(name) is not None
    if not there:
        say(f"{name} is not installed.")
    return there


# Other programs ------------------------------------------------------------------------------------------------------


def ideal_position(times: np.ndarray) -> np.ndarray:
    """Where the slider of the ideal mechanism is [m]."""
    turned = CRANK_SPEED * times
    return CRANK * np.cos(turned) + np.sqrt(ROD**2 - (CRANK * np.sin(turned)) ** 2)


def with_exudyn(t1: float, steps: tuple[float, ...]) -> list[Peer]:
    """Exudyn's slider-crank with play at `t1` against ours, for several of its steps."""
    options: dict[str, Any] = {"rtol": 1e-11, "solver": "dopri8", "energy_balance": False}
    angle, position = as_reference("slider_crank", cj.simulate(slider_crank(), t1, **options).final, t1)[:2]
    found = []
    for step in steps:
        clock = time.process_time()
        end = exudyn_slider_crank.simulate(PLAY, t1, round(t1 / step))
        cpu = time.process_time() - clock
        found.append(Peer("Exudyn", "with play, at the end", step, abs(end[0] - angle), abs(end[1] - position), cpu))
    return found


def with_mujoco(t1: float, steps: tuple[float, ...]) -> list[Peer]:
    """MuJoCo's ideal slider-crank against the closed form, for several of its steps."""
    found = []
    for step in steps:
        clock = time.process_time()
        times, positions, _ = mujoco_slider_crank.simulate(0.0, t1, step, 200)
        cpu = time.process_time() - clock
        error = float(np.abs(positions - ideal_position(times)).max())
        found.append(Peer("MuJoCo", "ideal, closed form, all times", step, None, error, cpu))
    return found


class Kind(NamedTuple):
    """How a motion with play looks: the share of times in contact, how often contact begins, the largest penetration
    [m], and the largest deviation of the slider from the ideal one [m].
    """

    program: str
    contact: float
    touches: int
    penetration: float
    deviation: float


def kind_of(program: str, times: np.ndarray, positions: np.ndarray, eccentricities: np.ndarray) -> Kind:
    touching = eccentricities >= PLAY
    begins = int(np.sum(np.diff(touching.astype(int)) == 1))
    deviation = float(np.abs(positions - ideal_position(times)).max())
    return Kind(program, float(touching.mean()), begins, float(eccentricities.max() - PLAY), deviation)


def kinds(t1: float, samples: int) -> list[Kind]:
    """Ours without friction, and MuJoCo's with two of its steps."""
    joint = slider_crank().joint("wrist")
    smooth = slider_crank().with_clearance("wrist", dataclasses.replace(joint.clearance, friction=None))
    times = np.linspace(0.0, t1, samples + 1)[1:]
    motion = cj.simulate(smooth, t1, save_at=times, rtol=1e-9)
    far = np.linalg.norm(np.asarray(motion["wrist.eccentricity"]), axis=-1)
    found = [kind_of("clearance_jax, no friction", times, np.asarray(motion["piston.position"])[:, 0], far)]
    for step in (2e-6, 5e-7):
        found.append(kind_of(f"MuJoCo, step {step:.0e} s", *mujoco_slider_crank.simulate(PLAY, t1, step, samples)))
    return found


# Published numbers ---------------------------------------------------------------------------------------------------


def thrown_slider_crank() -> cj.Mechanism:
    """The slider-crank of Siconos before its slider touches the guide."""
    s = siconos_slider_crank
    crank, rod = s.START
    bodies = (
        cj.Body("crank", s.M1, s.J1, cj.Position(s.L1 / 2, 0.0)),
        cj.Body("rod", s.M2, s.J2, cj.Position(s.L2 / 2, 0.0)),
        cj.Body("slider", s.M3, s.J3),
    )
    joints = (
        cj.Revolute("main", "ground", "crank", motion=cj.Motion(velocity=crank)),
        cj.Revolute("pin", "crank", "rod", cj.Position(s.L1, 0.0), motion=cj.Motion(velocity=rod - crank)),
        cj.Revolute("wrist", "rod", "slider", cj.Position(s.L2, 0.0), motion=cj.Motion(velocity=-rod)),
    )
    points = (cj.Point("middle", "slider"),)
    return cj.Mechanism(bodies, joints, points=points, gravity=cj.Gravity(y=-s.GRAVITY))


def of_siconos() -> list[Number]:
    s, found = siconos_slider_crank, []
    times = np.array(list(s.PUBLISHED))
    motion = cj.simulate(thrown_slider_crank(), float(times[-1]), save_at=times, rtol=1e-11)
    turned, swung, fast, slow = (
        np.asarray(motion[f"{name}.{what}"]) for what in ("position", "velocity") for name in ("main", "pin")
    )
    height = np.asarray(motion["middle.position"])[:, 1] / s.CLEARANCE
    ours = np.stack([turned / (2 * np.pi), turned + swung, fast, fast + slow, height], 1)
    names = ("crank [turns]", "rod [rad]", "speed of the crank [rad/s]", "speed of the rod [rad/s]", "height / play")
    for at, mine in zip(s.PUBLISHED, ours, strict=True):
        published, at_its_step = np.array(s.PUBLISHED[at]), s.scheme(at, s.STEP)
        step, rest = at_its_step - s.without_step(at), np.abs(published - at_its_step)
        for k, name in enumerate(names):
            what = f"{name}, {at:g} s"
            unsure = float(abs(step[k]) + 2 * rest[k])
            found.append(Number("Siconos", what, float(published[k]), unsure, float(mine[k])))
            less = float(published[k] - step[k])
            found.append(Number("Siconos, less its step", what, less, float(2 * rest[k]), float(mine[k])))
    return found


def of_flores() -> list[Number]:
    """What is remembered of the slider-crank of Flores and Ambrosio, 5000 rpm: peaks after the first revolution."""
    stiffness = 4 / 3 * 207e9 / (2 * (1 - 0.3**2)) * np.sqrt(0.01 * 0.0095 / 0.0005)
    law = cj.laws.lankarani_nikravesh(stiffness=stiffness, restitution=0.9)
    joint = slider_crank().joint("wrist")
    mechanism = slider_crank().with_clearance("wrist", dataclasses.replace(joint.clearance, normal=law, friction=None))
    peak = cj.metrics.Peak(cj.metrics.Acceleration("piston"), since=REVOLUTION)
    found = [Number("Flores, Ambrosio", "stiffness of Hertz, 0.5 mm [N/m^1.5]", 6.61e10, None, float(stiffness))]
    for play in (5e-4, 1e-4):
        changed = cj.replace(mechanism, {"wrist.radial_clearance": play})
        value = float(cj.measure(changed, {"peak": peak}, 2 * REVOLUTION, rtol=1e-9)["peak"])
        name = f"largest acceleration of the slider, {1e3 * play:g} mm [m/s^2]"
        found.append(Number("Flores, Ambrosio", name, "several 1e5" if play == PLAY else "less", None, value))
    return found


# All together --------------------------------------------------------------------------------------------------------


def show_peers(peers: list[Peer], path: str) -> None:
    table(
        ("program", "what is compared", "step [s]", "conrod [rad]", "slider [m]", "CPU [s]"),
        [
            (p.program, p.compared, f"{p.step:.1e}", "" if p.angle is None else f"{p.angle:.1e}", f"{p.position:.1e}",
             f"{p.cpu:.1f}")
            for p in peers
        ],
        output(path),
    )  # fmt: skip


def show_numbers(numbers: list[Number], path: str) -> None:
    table(
        ("source", "quantity", "published", "uncertainty", "ours", "verdict"),
        [
            (n.source, n.quantity, text_of(n.published), text_of(n.uncertainty, ".1e"), text_of(n.ours), n.verdict)
            for n in numbers
        ],
        output(path),
    )


def text_of(value: float | str | None, digits: str = ".7g") -> str:
    """A number in a table."""
    return "unknown" if value is None else value if isinstance(value, str) else f"{value:{digits}}"


def show_problems(rows: list[iftomm.Compared], path: str) -> None:
    table(
        ("problem", "quantity", "difference", "uncertainty", "energy residual", "ended", "verdict"),
        [
            (r.problem, r.quantity, f"{r.error:.1e}", f"{r.digits:.1e}", f"{r.energy:.0e}", r.ended, r.verdict)
            for r in rows
        ],
        output(path),
    )


def main(quick: bool = False) -> tuple[list[Peer], list[Number], list[iftomm.Compared]]:
    """Write the tables; returns their rows."""
    name = f"published{'_quick' if quick else ''}"
    peers: list[Peer] = []
    write("## The same slider-crank in other programs\n")
    if is_installed("exudyn"):
        peers += with_exudyn(5e-4, (1e-6, 2.5e-7)) if quick else with_exudyn(REVOLUTION, (1e-6, 5e-7, 2.5e-7, 1.25e-7))
    if is_installed("mujoco"):
        peers += with_mujoco(REVOLUTION, (4e-6,) if quick else (4e-6, 2e-6, 1e-6))
    show_peers(peers, f"{name}_peers.md")
    if is_installed("mujoco") and not quick:
        table(
            ("program", "in contact", "touches", "penetration [um]", "deviation [mm]"),
            [
                (k.program, f"{k.contact:.3f}", k.touches, f"{1e6 * k.penetration:.1f}", f"{1e3 * k.deviation:.4f}")
                for k in kinds(REVOLUTION, 2000)
            ],
            output(f"{name}_play.md"),
        )
    write("## Published numbers\n")
    numbers = of_siconos() + ([] if quick else of_flores())
    show_numbers(numbers, f"{name}_numbers.md")
    write("## The IFToMM library of computational benchmarks\n")
    problems: tuple[Callable, ...] = iftomm.PROBLEMS[:1] if quick else iftomm.PROBLEMS
    rows = [row for problem in problems for row in problem()]
    show_problems(rows, f"{name}_problems.md")
    return peers, numbers, rows


if __name__ == "__main__":
    command(main, __doc__, quick="half a millisecond in Exudyn, one step in MuJoCo, and A01")
