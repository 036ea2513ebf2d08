"""The pictures of README and docs: `python docs/pictures.py` writes them to docs/images (`make pictures`)."""

import itertools
from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle
from scipy.integrate import solve_ivp

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.laws import Geometry
from clearance_jax.mechanism.motion.motion_laws import Harmonic, Spline, Step5Sum, StepSum
from clearance_jax.report import figures
from clearance_jax.report.play_figures import draw_states
from clearance_jax.report.style import BLUE, RED, STYLED, legend_below

IMAGES = Path(__file__).parent / "images"
SCENES = Path(__file__).parents[1] / "experiments" / "scenes"

STIFFNESS, MASS, SPEED = 6.61e10, 0.14, 0.5
"""Of the impacts drawn: steel on steel [N/m^1.5], [kg], [m/s]."""
REVOLUTION = 0.012
"""Of the slider-crank [s]."""
BEARING = 0.035
"""When the robot's pin bears at both edges [s]."""
STEEL_PIN = Geometry(0.01, 0.0101, 1e-4, 0.02)
STEEL = 2.07e11, 2.07e11
"""Young's moduli [Pa]."""


def examples() -> tuple[dict, dict]:
    """One law of every name, normal and friction."""
    normal = {
        "kelvin-voigt": laws.LinearKelvinVoigt(2.4e8, 1000.0),
        "hertz": laws.Hertz(STIFFNESS),
        "adams-impact": laws.AdamsImpact(STIFFNESS, 2000.0, 1e-5),
        "hunt-crossley": laws.HuntCrossley(STIFFNESS, 0.6),
        "exact-restitution": laws.exact_restitution(STIFFNESS, 0.7),
        "lankarani-nikravesh": laws.lankarani_nikravesh(STIFFNESS, 0.7),
        "flores": laws.flores(STIFFNESS, 0.7),
        "hunt-crossley-1975": laws.hunt_crossley(STIFFNESS, 0.7),
        "herbert-mcwhannell": laws.herbert_mcwhannell(STIFFNESS, 0.7),
        "lee-wang": laws.lee_wang(STIFFNESS, 0.7),
        "gonthier": laws.gonthier(STIFFNESS, 0.7),
        "zhiying-qishao": laws.zhiying_qishao(STIFFNESS, 0.7),
        "hu-guo": laws.hu_guo(STIFFNESS, 0.7),
        "gharib-hurmuzlu": laws.gharib_hurmuzlu(STIFFNESS, 0.7),
        "tsuji": laws.Tsuji(STIFFNESS, 0.7, MASS),
        "anagnostopoulos": laws.Anagnostopoulos(2.4e8, 0.7, MASS),
        "johnson": laws.johnson(*STEEL, restitution=0.7),
        "radzimovsky": laws.radzimovsky(*STEEL, restitution=0.7),
        "esdu-78035": laws.esdu(*STEEL, restitution=0.7),
        "liu": laws.liu(*STEEL, restitution=0.7),
        "bai-zhao": laws.bai_zhao(*STEEL, restitution=0.7),
        "pereira": laws.pereira(*STEEL, restitution=0.7),
        "goldsmith": laws.goldsmith(*STEEL, restitution=0.7),
        "dubowsky-freudenstein": laws.dubowsky_freudenstein(*STEEL, restitution=0.7),
        "winkler": laws.Winkler(2e13, 0.7),
        "standard-linear-solid": laws.StandardLinearSolid(2.4e8, 0.4, 5e-5),
    }
    friction = {
        "cubic": laws.CubicCoulomb(0.3, 1e-2),
        "tanh": laws.TanhCoulomb(0.3, 1e-2),
        "brown-mcphee": laws.BrownMcPhee(0.4, 0.3, 1e-2),
        "lugre": laws.LuGre(0.4, 0.3, 1e-2, 1e4, 0.0, 0.0),
        "adams": laws.AdamsFriction(0.4, 0.3, 3e-3, 1e-2),
        "threlfall": laws.Threlfall(0.3, 1e-2),
        "ambrosio": laws.Ambrosio(0.3, 3e-3, 1e-2),
        "bengisu-akay": laws.BengisuAkay(0.4, 0.3, 1e-2, 5e-3),
        "stribeck": laws.Stribeck(0.4, 0.3, 1e-2, 2e-3),
        "dahl": laws.Dahl(0.3, 1e4),
        "elasto-plastic": laws.ElastoPlastic(0.4, 0.3, 1e-2, 1e4),
    }
    return normal, friction


def saved(figure: Figure, name: str, dpi: float = 110) -> None:
    """Write a picture, small enough to be kept with the source."""
    IMAGES.mkdir(exist_ok=True)
    figure.savefig(IMAGES / name, dpi=dpi)


def impact(law) -> tuple[np.ndarray, np.ndarray]:
    """Penetration [m] and force [N] of a free impact, from touch to separation."""
    ready = law.prepare(STEEL_PIN)
    memory = [SPEED if name == "impact_speed" else 0.0 for name in law.remembers]

    def numbers(y):
        depth, rate, *kept = (np.asarray(x) for x in y)
        return depth, rate, tuple(kept)

    def force(*y):
        return float(ready.force(*numbers(y)))

    def flow(t, y):
        return [y[1], -force(*y) / MASS, *(float(r) for r in ready.memory_rate(*numbers(y)))]

    def apart(t, y):
        return y[0] - 1e-12

    apart.terminal, apart.direction = True, -1
    start = (0.0, [1e-11, SPEED, *memory])
    found = solve_ivp(flow, (0, 1e-3), start[1], events=apart, rtol=1e-7, max_step=2e-6)
    return found.y[0], np.array([force(*y) for y in found.y.T])


def normal_laws() -> None:
    """Force over penetration in one impact, and what restitution it delivers."""
    figure = Figure(figsize=(9, 9.6), layout="constrained")
    axes = figure.subplots(6, 5, sharex=True, sharey=True).ravel()
    normal, _ = examples()
    elastic = impact(normal["hertz"])
    for axis, (name, law) in zip(axes, normal.items(), strict=False):
        depth, force = impact(law)
        axis.plot(elastic[0] * 1e6, elastic[1] / 1e3, color="0.8")
        axis.plot(depth * 1e6, force / 1e3)
        axis.set_title(f"{name}\nclass {law.smoothness}", fontsize=9)
        axis.grid(alpha=0.3)
    axes[0].set_ylim(-0.6, 7.5)
    for axis in axes[len(normal) :]:
        axis.axis("off")
    figure.supxlabel("penetration, µm", fontsize=9)
    figure.supylabel("normal force, kN", fontsize=9)
    saved(figure, "normal_laws.png", dpi=90)


def friction_laws() -> None:
    """Traction over slip; LuGre, which has memory, in a slow oscillation."""
    figure = Figure(figsize=(9, 7.2), layout="constrained")
    axes = figure.subplots(3, 4, sharey=True).ravel()
    slips = np.linspace(-0.03, 0.03, 401)
    for axis, (name, law) in zip(axes, examples()[1].items(), strict=False):
        ready = law.prepare(STEEL_PIN)
        if law.bristles:
            slip, ratio = _oscillation(ready)
        else:
            slip, ratio = slips, [float(ready.traction((np.asarray(s),), np.asarray(1.0), ())[0]) for s in slips]
        axis.plot(np.asarray(slip) * 1e3, ratio)
        axis.set_title(f"{name}, class {law.smoothness}", fontsize=9)
        axis.set_xlabel("slip, mm/s")
        axis.grid(alpha=0.3)
        if axis.get_subplotspec().is_first_col():
            axis.set_ylabel("traction / normal force")
    axes[-1].axis("off")
    saved(figure, "friction_laws.png")


def _oscillation(ready) -> tuple[np.ndarray, np.ndarray]:
    """Slip and traction over one period of a harmonic slip, the one before it left out."""
    peak, frequency = 0.03, 60.0

    def slip(t):
        return peak * np.sin(frequency * t)

    def bend_rate(t, z):
        one = np.asarray(1.0)
        return [float(ready.memory_rate((np.asarray(slip(t)),), one, (np.asarray(z[0]),))[0])]

    times = np.linspace(0, 4 * np.pi / frequency, 1601)
    bent = solve_ivp(bend_rate, (0, times[-1]), [0.0], t_eval=times, rtol=1e-8, atol=1e-12, method="LSODA").y[0]
    late = times >= times[-1] / 2
    traction = [
        float(ready.traction((np.asarray(slip(t)),), np.asarray(1.0), (np.asarray(z),))[0])
        for t, z in zip(times[late], bent[late], strict=True)
    ]
    return slip(times[late]), np.array(traction)


def drives() -> None:
    """Position, velocity and acceleration of every kind of drive that moves."""
    step = ([0.1], [0.5], [1.0])
    knots = np.linspace(0, 0.6, 7)
    kinds = {
        "constant-speed": cj.drives.ConstantSpeed(1.5),
        "step": StepSum(*step),
        "step5": Step5Sum(*step),
        "harmonic": Harmonic(0.5, 12.0),
        "trapezoid": cj.drives.Trapezoid([0.1], [1.0], 4.0, 40.0),
        "quintic": cj.drives.Quintic([0.05, 0.3, 0.55], [0.0, 0.8, 1.0]),
        "spline": Spline(knots, [0.0, 0.1, 0.5, 0.9, 0.8, 0.85, 1.0]),
    }
    times = np.linspace(0, 0.6, 601)
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    axes = figure.subplots(3, len(kinds), sharex=True)
    for column, (name, drive) in zip(axes.T, kinds.items(), strict=True):
        motion = np.array([[float(x) for x in drive(t)] for t in times])
        for axis, values, label in zip(column, motion.T, ("q", "q'", "q''"), strict=True):
            axis.plot(times, values)
            axis.grid(alpha=0.3)
            if column[0] is axes[0, 0]:
                axis.set_ylabel(label)
        column[0].set_title(name, fontsize=9)
        column[-1].set_xlabel("time, s")
    saved(figure, "drives.png")


def sleeve() -> None:
    """The plane revolute joint with clearance: what is measured, and which way it counts."""
    figure = Figure(figsize=(5.6, 4.2), layout="constrained")
    axis = figure.subplots()
    sleeve_radius, pin_radius, angle = 1.0, 0.72, np.radians(-35)
    unit, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    centre, point = 0.33 * unit, sleeve_radius * unit
    axis.add_patch(Circle((0, 0), sleeve_radius, fill=False, lw=2, color="tab:blue"))
    axis.add_patch(Circle(tuple(centre), pin_radius, fc="0.92", ec="0.3", lw=2))
    for start, end, colour, text, at in (
        ((0, 0), centre, "tab:red", "eccentricity e", (0.3, 0.02)),
        (point, point + 0.45 * unit, "tab:green", "normal n", (1.22, -0.92)),
        (point, point + 0.45 * across, "tab:purple", "tangent t (slip > 0)", (1.1, -0.12)),
        (point, point - 0.5 * unit, "tab:orange", "normal force\non the pin", (-0.15, -0.62)),
    ):
        axis.add_patch(FancyArrowPatch(tuple(start), tuple(end), arrowstyle="-|>", mutation_scale=13, color=colour))
        axis.text(*at, text, color=colour)
    axis.plot(*centre, "o", ms=4, color="0.3")
    axis.plot(0, 0, "+", ms=10, color="tab:blue")
    axis.text(1.1, 0.9, "R radius of the sleeve", color="tab:blue")
    axis.text(1.1, 0.72, "r radius of the pin", color="0.3")
    axis.text(1.1, 0.54, "c = R - r clearance")
    axis.text(1.1, 0.36, "d = |e| - c penetration")
    axis.set(xlim=(-1.05, 2.2), ylim=(-1.05, 1.05), aspect="equal")
    axis.axis("off")
    saved(figure, "sleeve.png")


@STYLED
def front() -> None:
    """What play does to a slider-crank: its pin's path in the sleeve, the piston's error, the contact force."""
    mechanism = cj.load(SCENES / "slider_crank.toml")
    dataset, wanted = (
        # From the second revolution on: in the first the pin falls from the sleeve's centre.
        cj.to_dataset(m, cj.trace(m, 3 * REVOLUTION, rtol=1e-8, save_at=6001)).sel(time=slice(REVOLUTION, None))
        for m in (mechanism, mechanism.ideal())
    )
    if "step_time" in dataset:
        dataset = dataset.sel(step=dataset["step_time"] >= REVOLUTION)
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(2, 3))
    orbit = left.subplots()
    draw_states(orbit, dataset, "wrist", shares=True)
    orbit.set(xlabel="e_x, µm", ylabel="e_y, µm", title="pin centre in the sleeve of wrist")
    legend_below(orbit, 2, fontsize=8)
    upper, lower = right.subplots(2, 1, sharex=True)
    error = (dataset["position"] - wanted["position"]).sel(point="piston", axis="x")
    upper.plot(dataset["time"] * 1e3, error * 1e3, lw=0.9, color=BLUE)
    upper.set_ylabel("piston error, mm")
    lower.plot(dataset["time"] * 1e3, dataset["contact_force"].sel(joint="wrist") / 1e3, lw=0.9, color=RED)
    lower.set(xlabel="time, ms (second and third revolution at 5000 rpm)", ylabel="contact force, kN")
    for axis in (upper, lower):
        axis.grid(visible=True)
    saved(figure, "slider_crank.png")


def kinds() -> None:
    """Every kind of figure of a motion, of two revolutions of the slider-crank."""
    mechanism = cj.load(SCENES / "slider_crank.toml")
    dataset = cj.to_dataset(mechanism, cj.trace(mechanism, 2 * REVOLUTION, rtol=1e-8, save_at=2001))
    for name in ("overview", "polar_load", "spectrum", "episodes"):
        saved(getattr(figures, name)(dataset), f"{name}.png", dpi=85)


def rattling() -> xr.Dataset:
    """A robot of six axes whose fifth has play, from the middle of its sleeve on."""
    robot = cj.load_urdf(SCENES / "six_axes.urdf", end_effector="tcp")
    loose = robot.with_clearance(
        "axis_5", kind="sleeve", radial_clearance=5e-5, axial_clearance=1e-4, length=0.04, pin_radius=0.015
    )
    mechanism = loose.with_drives(cj.read_trajectory(SCENES / "six_axes_turn.csv", loose))
    return cj.to_dataset(mechanism, cj.trace(mechanism, 0.05, rtol=1e-6, save_at=1001))


def play_in_space() -> None:
    """When that joint bears how, its orbits, and a frame of its film."""
    dataset = rattling()
    saved(figures.play(dataset), "play.png", dpi=80)
    film = cj.animate(dataset, "axis_5")
    when = dataset["time"].values[film.frames]
    saved(film.show(int(np.argmin(np.abs(when - BEARING)))), "film.png", dpi=100)


# The folders of the library, each floor on those below it.
FLOORS = (
    ("cli", "report", "io"),
    ("calibrate", "design", "wear", "sweep"),
    ("runs", "results", "analysis"),
    ("ask", "metrics"),
    ("solve",),
    ("dynamics",),
    ("mechanism",),
    ("joints", "laws"),
    ("_basis", "_compile", "parameters, units"),
)
# Where a clearance goes, and the floor of it from the top.
WAY = (
    (0, "a scene file: radial_clearance = 0.1 mm"),
    (6, "a Mechanism, then a PreparedMechanism"),
    (5, "the vector field: poses, contacts, accelerations"),
    (4, "steps, events, derivatives"),
    (3, "a question and its answer"),
    (1, "samples, limits, cycles of wear"),
    (0, "figures, reports, datasets"),
)


def floors() -> None:
    """The folders as floors, and the way of a clearance through them."""
    figure = Figure(figsize=(9.5, 5.6), layout="constrained")
    axis = figure.add_subplot()
    axis.set(xlim=(0, 19), ylim=(-len(FLOORS), 0.1))
    axis.axis("off")
    for floor, names in enumerate(FLOORS):
        width = 10 / len(names)
        for k, name in enumerate(names):
            corner = k * width + 0.05, -floor - 0.85
            axis.add_patch(Rectangle(corner, width - 0.1, 0.75, fc="#e9eff7", ec="#5b7ba3"))
            axis.text(corner[0] + width / 2 - 0.05, corner[1] + 0.38, name, ha="center", va="center")
    heights = [-floor - (0.3 if i < len(WAY) - 1 else 0.65) for i, (floor, _) in enumerate(WAY)]
    for i, (height, (_, said)) in enumerate(zip(heights, WAY, strict=True)):
        axis.text(11.3, height, f"{i + 1}  {said}", va="center")
    for begin, end in itertools.pairwise(heights):
        bend = -0.35 if begin < end else 0.22
        axis.annotate(
            "",
            (11.1, end),
            (11.1, begin),
            arrowprops={"arrowstyle": "->", "color": "tab:red", "connectionstyle": f"arc3,rad={bend}"},
        )
    saved(figure, "architecture.png")


def main() -> None:
    """Draw every picture."""
    cj.configure(cache=True)
    with mpl.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}):
        for draw in (normal_laws, friction_laws, drives, sleeve, front, kinds, play_in_space, floors):
            draw()


if __name__ == "__main__":
    main()
