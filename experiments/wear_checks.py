"""Wear compared with closed forms and with published findings, its orders of convergence, and its maps: `python -m
experiments.wear_checks`.

*Over sectors*: an elastic foundation is compared with its closed form, for 64 patches that begin anywhere between
sectors. Two results are compared: the integral of the pressures (the volume of a linear law), and the mean pressures of
the sectors. The errors of the sectors are largest at the two edges of a patch.

*Over time*: the integral of force times slip for a swinging, unbalanced disc, computed on equal steps of one accurate
solve.

*Running in*: a pin held by a force turns in its sleeve, which wears. If the pin is rigid, the depth d to which it has
moved into the sleeve follows from the load per length F': p = (d' / k) cos t on |t| < a, cos a = c / (c + d), so that
F' = (R / k) (a + sin a cos a) dd/ds. The foundation makes the contact elastic. This has an effect at the beginning,
which is smaller for a stiffer foundation.

*Maps*: joint 5 of the tool changer (`tool_changer.toml`), whose cutter hangs 20 mm beside the arm and tilts the pin.
"""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import clearance_jax as cj
from clearance_jax import laws, wear
from clearance_jax.joints import Sections
from clearance_jax.laws import Geometry, Material
from clearance_jax.report.wear_figures import wear_map
from clearance_jax.wear import Contacts, Section, SectionLoad
from experiments.common import SCENES, compact, slider_crank, table
from experiments.publish import command, picture, write

PIN, CLEARANCE, LENGTH, STIFFNESS = 25e-3, 1e-4, 50e-3, 2e13
RADIUS = PIN + CLEARANCE
SECTORS = np.array([90, 180, 360, 720])
STEPS = np.array([100, 200, 400, 800])
COEFFICIENT = "6e-14 1/Pa"
END = 0.25
"""How long the tool changer moves [s]."""


def steel() -> Material:
    return Material(2.06e11)


def geometry() -> Geometry:
    pin, bore, clearance, length = (jnp.asarray(x) for x in (PIN, RADIUS, CLEARANCE, LENGTH))
    return Geometry(pin, bore, clearance, length, steel(), steel(), "line")


def order(sizes: Any, errors: Any) -> float:
    """The slope of errors by resolution, over all of it."""
    return float(-np.polyfit(np.log(sizes), np.log(errors), 1)[0])


# Resolution ----------------------------------------------------------------------------------------------------------


class Resolved(NamedTuple):
    """Errors by resolution: of volumes and of profiles."""

    volumes: np.ndarray
    profiles: np.ndarray


def over_sectors() -> Resolved:
    """Root mean squares over patches of the errors of volume, and of the worst sector over the largest pressure."""
    halves, middles = np.meshgrid(np.linspace(0.2, 0.5, 8), np.linspace(0.0, np.pi / 45, 8, endpoint=False))
    halves, middles = halves.ravel(), middles.ravel()
    far = CLEARANCE / np.cos(halves)
    forces = STIFFNESS * RADIUS * far * (halves - np.sin(halves) * np.cos(halves))
    volumes = 2 * STIFFNESS * RADIUS * far * (np.sin(halves) - halves * np.cos(halves))
    found = []
    for count in SECTORS:
        spread = wear.Foundation(STIFFNESS).prepare(Section(geometry(), jnp.zeros(count)))
        means = np.asarray(
            jax.vmap(lambda f, a, spread=spread: spread(SectionLoad(f, a, (0 * f, 0 * f))).means)(
                jnp.asarray(forces), jnp.asarray(middles)
            )
        )
        width = 2 * np.pi / count
        fine = (np.arange(count)[:, None] + (np.arange(64) + 0.5) / 64 - 0.5) * width
        exact = np.maximum(far[:, None, None] * np.cos(fine - middles[:, None, None]) - CLEARANCE, 0).mean(axis=2)
        off = np.abs(means / STIFFNESS - exact).max(axis=1) / exact.max(axis=1)
        found.append([np.sqrt(np.mean(e**2)) for e in (means.sum(axis=1) * RADIUS * width / volumes - 1, off)])
    return Resolved(*np.array(found).T)


def rotor() -> cj.Mechanism:
    """A disc out of balance that a drive swings in its sleeve: the load changes all the time, contact does not end."""
    play = cj.RevoluteClearance(CLEARANCE, PIN, laws.HuntCrossley(1e9, 1.0), length=LENGTH)
    return cj.Mechanism(
        bodies=(cj.Body("disc", 20.0, 0.1, cj.Position(0.05)),),
        joints=(
            cj.Revolute("pin", "ground", "disc", motion=cj.Motion(cj.drives.Harmonic(0.6, 4 * np.pi)), clearance=play),
        ),
        gravity=cj.Gravity(y=-9.81),
    )


def over_time() -> np.ndarray:
    """Errors of the integral of force times slip by the number of steps; slips change their sign twice."""
    most = 2 * STEPS[-1]
    times = np.linspace(0.0, 0.5, most + 1)
    # By the solver of order 5, whose short steps are interpolated to the last digit; in long ones of the other it is
    # 1e-13, more than the error of the finest steps here.
    best = cj.trace(rotor(), 0.5, rtol=1e-12, solver="tsit5", start="settled", save_at=times)
    if best.message:
        raise RuntimeError(best.message)

    def rubbed(every: int) -> float:
        y = np.asarray(best.solution.y)[::every]
        seen = wear.contacts(dataclasses.replace(best, time=times[::every], y=y), "pin")
        return float(seen.weight @ (seen.force * seen.speed)[:, 0])

    return np.array([abs(rubbed(int(most // n)) / rubbed(1) - 1) for n in STEPS])


# Running in ----------------------------------------------------------------------------------------------------------


class Run(NamedTuple):
    """A pin that runs in: how far it has slid [m], its way in and that of a rigid one [m], over the clearance; half
    angle of the patch in the end [rad].
    """

    slid: np.ndarray
    deep: np.ndarray
    rigid: np.ndarray


def slid_by(deep: np.ndarray, force: float, coefficient: float) -> np.ndarray:
    """How far a rigid pin slides until it is so deep in its sleeve [m]; force per length."""
    way = np.linspace(0.0, deep.max(), 200_001)
    half = np.arccos(CLEARANCE / (CLEARANCE + way))
    rate = RADIUS * (half + np.sin(half) * np.cos(half)) / (coefficient * force)
    whole = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(way))])
    return np.interp(deep, way, whole)


def running_in(stiffness: float, steps: int, force: float = 3000.0, coefficient: float = 1e-13) -> Run:
    """So many stretches, each half as long as depths would need to run away from one sector to the next."""
    sleeve, one = Sections(geometry(), jnp.zeros(1), jnp.asarray([LENGTH])), jnp.ones((1, 1))
    stretch = 0.5 / (coefficient * stiffness)
    seen = Contacts(one[0], stretch * one[0], force * one, 0.7 * one, one, 0 * one, jnp.zeros((1, 1, 2)))
    law, foundation, depth, deep = wear.Archard(coefficient), wear.Foundation(stiffness), jnp.zeros(360), []
    for _ in range(steps):
        depth = depth + wear.wear_of(seen, sleeve, law, foundation, depth=depth).depth[0]
        deep.append(float(depth.max()))
    slid, deep = stretch * np.arange(1, steps + 1), np.array(deep)
    way = np.linspace(0.0, 1.5 * deep[-1], 20_001)
    rigid = np.interp(slid, slid_by(way, force / LENGTH, coefficient), way)
    return Run(slid, deep / CLEARANCE, rigid / CLEARANCE)


# Maps ----------------------------------------------------------------------------------------------------------------


def tool_changer(end: float) -> dict[str, wear.Wear]:
    """Wear of joint 5 of the tool changer, of sleeve and pin."""
    mechanism = cj.load(SCENES / "tool_changer.toml")
    play: Any = mechanism.joint("joint5")
    play = dataclasses.replace(play.clearance, pin_material=steel(), sleeve_material=steel())
    trace = cj.trace(mechanism.with_clearance("joint5", play), end, rtol=1e-6, start="settled", save_at=None)
    if trace.message:
        raise RuntimeError(trace.message)
    return {of: wear.wear(trace, "joint5", wear.archard(COEFFICIENT), of=of) for of in ("sleeve", "pin")}


def at_edges(worn: wear.Wear) -> tuple[float, float]:
    """The deepest of either edge over the deepest in the middle third of the sleeve."""
    deepest, heights = np.asarray(worn.depth.max(axis=1)), np.asarray(worn.heights)
    inner = deepest[np.abs(heights) < heights[-1] / 3].max()
    return float(deepest[0] / inner), float(deepest[-1] / inner)


# Published -----------------------------------------------------------------------------------------------------------


class Published(NamedTuple):
    """What is known of a slider-crank's wrist pin after a turn of the crank: volumes and depths by two pressures."""

    volumes: float
    depths: float
    uneven: float
    unworn: float
    away: float


def crank_turn() -> Published:
    """By an elastic foundation over Hertz's line contact; depths of the latter, and where they are."""
    mechanism = slider_crank()
    play: Any = mechanism.joint("wrist")
    play = dataclasses.replace(play.clearance, length=jnp.asarray(20e-3), pin_material=steel(), sleeve_material=steel())
    trace = cj.trace(mechanism.with_clearance("wrist", play), 24e-3, rtol=1e-6, start="settled", save_at=None)
    if trace.message:
        raise RuntimeError(trace.message)
    law = wear.archard(COEFFICIENT)
    flat = wear.wear(trace, "wrist", law)
    soft = wear.wear(trace, "wrist", law, wear.foundation(steel(), 10e-3))
    depth, angle = np.asarray(flat.depth[0]), np.asarray(flat.angle)
    # Angles of the conrod's axes: the load of a dead centre is along the rod, to the one side or the other.
    along = np.abs(np.cos(angle)) > np.cos(np.pi / 4)
    return Published(
        float(soft.volume / flat.volume),
        float(soft.deepest / flat.deepest),
        float(depth.max() / depth.mean()),
        float(np.mean(depth < 0.1 * depth.max())),
        float(depth[along].sum() / depth.sum()),
    )


PUBLISHED = """## Published findings

Only the abstracts of these papers were available. Their dimensions, loads, speeds, materials and coefficients are not
known. So only shapes and the progress of wear can be compared, and not depths.

- **Not evenly round the joint** (wear in revolute clearance joints, ASME IDETC/CIE 2007, 4806X, p. 357): contact is
  wider and more frequent in some regions. Here: the wrist pin of the slider-crank at 5000 rpm, for two turns. The
  largest depth is {p.uneven:.1f} times the mean depth. In {p.unworn:.0%} of the sleeve the depth is less than a tenth
  of the largest one. {p.away:.0%} of the wear is within 45 deg of the rod's axis, in which the loads of the dead
  centres act (uniform wear would have 50 % there).
- **Volumes agree, profiles do not** (Mukras et al. 2010, J. Tribol. 132, 031604): an elastic foundation and a
  finite-element pressure predict nearly the same volumes, which an experiment confirms, and substantially different
  profiles. Here: the same motion, on a foundation (10 mm of steel) and with Hertz's line contact. The volume on the
  foundation is {p.volumes:.3f} times the other one, and the largest depth {p.depths:.2f} times. So the volumes agree.
  The difference of the profiles depends on the stiffness of the foundation, which is hardly known. It is larger for a
  soft foundation (Fig. 14 in [Paper wear](paper_wear.md)).
- **Depth goes on linearly** ("Evolution of Wear in a Two-Dimensional Bushing"): constant load, uniform pressure, and an
  experiment. Here: the running in above. The depth grows with the distance to the power of {early:.2f} at first (closed
  form: 2/3) and of {late:.2f} in the end (closed form: it tends to 1). A uniform pressure gives a final rate of k F' /
  (2 R). This is pi / 4 of the rate here, where the pressure is a cosine.
- **Edges wear most in joints with tilt** (Zhang et al. 2023, Chin. J. Mech. Eng.): see the map. The cutter hangs nearer
  to one edge. The wear at this edge is {edges[0]:.2f} times as deep as in the middle third. The other edge bears hardly
  any load, and its wear is {edges[1]:.2f} times as deep. (A weight beyond the sleeve wears both edges, on opposite
  sides, and nothing between them: `tests/wear/test_wear.py`.)
"""


def power(run: Run, part: slice) -> float:
    """With which power of the distance the depth goes."""
    return float(np.polyfit(np.log(run.slid[part]), np.log(run.deep[part]), 1)[0])


def running_figure(runs: dict[float, Run]) -> Figure:
    figure = Figure(figsize=(5.4, 3.2), layout="constrained")
    axis = figure.subplots()
    last = list(runs.values())[-1]
    axis.loglog(last.slid, last.rigid, "k--", lw=1, label="rigid pin, closed form")
    for stiffness, run in runs.items():
        axis.loglog(run.slid, run.deep, lw=1, label=f"foundation {stiffness:.1e} Pa/m")
    axis.set(xlabel="slid, m", ylabel="deepest, over the clearance")
    axis.grid(alpha=0.3)
    axis.legend(frameon=False)
    return figure


def main(quick: bool = False, out: Path = Path("out")) -> dict[str, Any]:
    """Write tables and pictures into a folder; returns what was found."""
    out.mkdir(parents=True, exist_ok=True)
    found: dict[str, Any] = {"sectors": over_sectors()}
    write("## Over sectors and over time\n")
    resolved = found["sectors"]
    rows = [(n, f"{v:.1e}", f"{p:.1e}") for n, v, p in zip(SECTORS, *resolved, strict=True)]
    rows.append(("order", f"{order(SECTORS, resolved.volumes):.2f}", f"{order(SECTORS, resolved.profiles):.2f}"))
    table(("sectors", "volume off", "worst sector off, over the largest"), rows, out / "wear_checks_sectors.md")
    found["time"] = over_time()
    rows = [(n, f"{e:.1e}") for n, e in zip(STEPS, found["time"], strict=True)]
    rows.append(("order", f"{order(STEPS, found['time']):.2f}"))
    table(("steps", "force times slip off"), rows, out / "wear_checks_time.md")
    write("## Running in\n")
    cases = ((1e12, 100),) if quick else ((2.5e11, 100), (1e12, 400))
    runs = found["runs"] = {stiffness: running_in(stiffness, steps) for stiffness, steps in cases}
    rows = [
        (
            f"{k:.1e}",
            f"{r.slid[-1]:.0f}",
            f"{r.deep[-1]:.4f}",
            f"{r.rigid[-1]:.4f}",
            f"{r.deep[-1] / r.rigid[-1] - 1:+.1e}",
        )
        for k, r in runs.items()
    ]
    table(("stiffness [Pa/m]", "slid [m]", "deepest, over c", "rigid", "off"), rows, out / "wear_checks_running_in.md")
    if quick:
        return found
    path = out / "wear_running_in.png"
    picture(compact(running_figure(runs), path), "A sleeve that wears in below a pin that turns")
    write("## Maps\n")
    worn = found["worn"] = tool_changer(END)
    for of, one in worn.items():
        drawn = wear_map(one, f"tool changer, joint 5: {of}, {1e9 * float(one.volume):.3g} mm³")
        caption = {"sleeve": "Wear of the sleeve, in its own axes", "pin": "Wear of its pin, in the pin's axes"}[of]
        picture(compact(drawn, out / f"wear_map_{of}.png"), f"{caption}, after {END:g} s")
    edges = at_edges(worn["sleeve"])
    longest = list(runs.values())[-1]
    known = found["published"] = crank_turn()
    early, late = power(longest, slice(10, 40)), power(longest, slice(-100, None))
    write(PUBLISHED.format(p=known, early=early, late=late, edges=edges))
    return found


if __name__ == "__main__":
    command(main, __doc__, "resolutions, and one short running in")
