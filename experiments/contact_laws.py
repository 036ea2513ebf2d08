"""What contact laws deliver, and what smoothing changes: `python -m experiments.contact_laws`.

*Restitution*: a free impact of the laws F = K d^n (1 + a(e) d'/v0) delivers the root e of a (1 + e) = ln((1 + a)/(1 - a
e)), whatever n, K, mass and speed are. Other laws are solved as a free impact of 0.14 kg on a pin of 10 mm in a sleeve
of 10.1 mm and 20 mm of steel, at three speeds.

*A smooth onset*: the same impact at 0.5 m/s, of laws and of the same laws `smoothed` over a width w; d is the deepest
penetration. The bias is the largest of those of restitution, of the peak force and of the duration, relative. The last
column is that of the width that `law.smoothed(penetration=d, rtol=1e-4)` chooses.

*Friction without corners*: a block of 1 kg on a spring of 1 kN/m, pressed with 10 N on a base that moves with 0.1 m/s
sin(20/s t), over 0.4 s, of friction laws and of the same laws `smoothed` over a width w; v is the law's speed (the slip
at which friction is all but complete, or the Stribeck speed of bristles). The bias is the largest of those of place,
speed and lost work over the motion, relative to their largest values. The last column is that of the width that
`law.smoothed(rtol=1e-4)` chooses. For bristles the width is a share of a usual slip of 1 mm/s.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from clearance_jax import laws
from experiments.common import compact, output, table
from experiments.publish import command, picture, write

MASS, SPEEDS = 0.14, (0.05, 0.5, 2.0)
SIZES = 0.01, 0.0101, 1e-4, 0.02
K, STEEL = 6.61e10, (2.07e11, 2.07e11)
SET = (0.1, 0.3, 0.5, 0.7, 0.9, 0.99)
FAMILY = {
    "exact-restitution": laws.exact_restitution,
    "hunt-crossley-1975": laws.hunt_crossley,
    "herbert-mcwhannell": laws.herbert_mcwhannell,
    "lee-wang": laws.lee_wang,
    "lankarani-nikravesh": laws.lankarani_nikravesh,
    "gonthier": laws.gonthier,
    "zhiying-qishao": laws.zhiying_qishao,
    "flores": laws.flores,
    "hu-guo": laws.hu_guo,
    "gharib-hurmuzlu": laws.gharib_hurmuzlu,
}


def other_laws() -> dict[str, Any]:
    """Laws by their names and numbers."""
    return {
        "hertz": laws.Hertz(K),
        "hunt-crossley, 0.6 s/m": laws.HuntCrossley(K, 0.6),
        "adams-impact, 2 kN s/m": laws.AdamsImpact(K, 2000.0, 1e-5),
        "kelvin-voigt, 1 kN s/m": laws.LinearKelvinVoigt(2.4e8, 1000.0),
        "tsuji, 0.7": laws.Tsuji(K, 0.7, MASS),
        "tsuji, 0.7, clipped": laws.Tsuji(K, 0.7, MASS, clipped=True),
        "anagnostopoulos, 0.7": laws.Anagnostopoulos(2.4e8, 0.7, MASS),
        "johnson, 0.7": laws.johnson(*STEEL, restitution=0.7),
        "bai-zhao, 0.7": laws.bai_zhao(*STEEL, restitution=0.7),
        "pereira, 0.7": laws.pereira(*STEEL, restitution=0.7),
        "winkler, 0.7": laws.Winkler(2e13, 0.7),
        "standard-linear-solid, 0.4, 1 ms": laws.StandardLinearSolid(2.4e8, 0.4, 1e-3),
    }


SMOOTHED = (
    "hertz",
    "hunt-crossley, 0.6 s/m",
    "adams-impact, 2 kN s/m",
    "kelvin-voigt, 1 kN s/m",
    "tsuji, 0.7",
    "johnson, 0.7",
)
WIDTHS = (0.3, 0.1, 0.03, 0.01, 0.003)
RTOL = 1e-4


LOAD, BLOCK, SPRING, END = 10.0, 1.0, 1e3, 0.4
BASE_SPEED, BASE_RATE = 0.1, 20.0


def friction_laws() -> dict[str, tuple[Any, float]]:
    """Friction laws by their names, and their speeds [m/s]."""
    return {
        "cubic": (laws.CubicCoulomb(0.3, 1e-2), 1e-2),
        "adams": (laws.AdamsFriction(0.4, 0.3, 1e-2, 3e-2), 1e-2),
        "threlfall": (laws.Threlfall(0.3, 1e-2), 1e-2),
        "ambrosio": (laws.Ambrosio(0.3, 5e-3, 1e-2), 5e-3),
        "bengisu-akay": (laws.BengisuAkay(0.4, 0.3, 1e-2, 5e-3), 1e-2),
        "stribeck, p = 1": (laws.Stribeck(0.4, 0.3, 5e-3, 1e-2, 1.0), 1e-2),
        "lugre": (laws.LuGre(0.4, 0.3, 1e-3, 1e4, 1.0), 1e-3),
        "dahl": (laws.Dahl(0.3, 1e4), 1e-3),
        "elasto-plastic": (laws.ElastoPlastic(0.4, 0.3, 1e-3, 1e4, 1.0), 1e-3),
    }


class Impact(NamedTuple):
    """Restitution, peak force [N], duration [s] and deepest penetration [m] of a free impact."""

    restitution: float
    force: float
    duration: float
    deepest: float

    def bias(self, other: "Impact") -> float:
        """The largest relative difference, but for the penetration."""
        mine, its = np.array(self[:3]), np.array(other[:3])
        return float(np.max(np.abs(mine / its - 1)))


def impact(law: Any, speed: float) -> Impact:
    """A free impact, by DOP853; it ends where the surfaces part, or the force is cut off."""
    ready, count = law.prepare(laws.Geometry(*map(jnp.asarray, SIZES))), len(law.remembers)

    @jax.jit
    def flow(y):
        memory = tuple(y[2 + i] for i in range(count))
        rates = ready.memory_rate(y[0], y[1], memory)
        formula = law.formula(ready.constants, y[0], y[1], memory)
        return jnp.stack([y[1], -ready.force(y[0], y[1], memory) / MASS, *rates]), formula

    def parted(t, y):
        return y[0] if not law.clips or t == 0 else min(y[0], float(flow(y)[1]) / K)

    vars(parted).update(terminal=True, direction=-1)
    memory = [speed if name == "impact_speed" else 0.0 for name in law.remembers]
    out: Any = solve_ivp(
        lambda t, y: np.asarray(flow(y)[0]), (0, 0.1), [1e-15, speed, *memory], "DOP853",
        events=parted, dense_output=True, rtol=1e-11, atol=1e-15,
    )  # fmt: skip
    path = out.sol(np.linspace(0, out.t[-1], 4001))
    forces = -MASS * np.asarray(jax.vmap(lambda y: flow(y)[0][1])(jnp.asarray(path.T)))
    # The vertex of the parabola about the largest sample.
    best = int(np.clip(np.argmax(forces), 1, len(forces) - 2))
    low, top, high = forces[best - 1 : best + 2]
    return Impact(
        -out.y[1, -1] / speed, top + (high - low) ** 2 / (8 * (2 * top - low - high)), out.t[-1], float(path[0].max())
    )


def restitutions(quick: bool) -> None:
    """The family: restitution set and delivered, as a table and a picture."""
    write("## Restitution set and delivered\n")
    rows = [
        (name, *(f"{float(make(K, e).delivered_restitution()):.4f}" for e in SET))  # one line a law
        for name, make in FAMILY.items()
    ]
    table(("law", *(f"e = {e:g}" for e in SET)), rows, output(f"contact_laws{'_quick' if quick else ''}.md"))
    if quick:
        return
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axis, every = figure.subplots(), np.linspace(0.02, 0.995, 60)
    for name, make in FAMILY.items():
        delivered = jax.vmap(lambda e, make=make: make(K, e).delivered_restitution())(jnp.asarray(every))
        axis.plot(every, delivered, label=name, color="black" if name == "exact-restitution" else None)
    axis.set(xlabel="restitution set", ylabel="restitution delivered", xlim=(0, 1), ylim=(0, 1))
    axis.legend(fontsize=7, ncols=2)
    axis.grid(alpha=0.3)
    picture(
        compact(figure, output("contact_laws_restitution.png")), "Restitution that the laws deliver for the one set"
    )


def others(quick: bool) -> None:
    """What else delivers at three speeds."""
    write("## Restitution of other laws, by impact speed\n")
    speeds = SPEEDS[1:2] if quick else SPEEDS
    every = other_laws()
    chosen = {"tsuji, 0.7": every["tsuji, 0.7"]} if quick else every
    rows = [(name, *(f"{impact(law, v).restitution:.4f}" for v in speeds)) for name, law in chosen.items()]
    table(("law", *(f"{v:g} m/s" for v in speeds)), rows, output(f"contact_laws_speeds{'_quick' if quick else ''}.md"))


def smoothing(quick: bool) -> dict[str, float]:
    """Bias over width; returns that of the width that each law chooses."""
    write("## Bias of a smooth onset\n")
    every = other_laws()
    widths, found, rows, curves = WIDTHS[1:2] if quick else WIDTHS, {}, [], {}
    for name in SMOOTHED[1:2] if quick else SMOOTHED:
        law = every[name]
        whole = impact(law, 0.5)
        biases = [impact(law.smoothed(w * whole.deepest), 0.5).bias(whole) for w in widths]
        found[name] = impact(law.smoothed(penetration=whole.deepest, rtol=RTOL), 0.5).bias(whole)
        rows.append((name, law.smoothness, *(f"{b:.1e}" for b in biases), f"{found[name]:.1e}"))
        curves[name] = biases
    head = ("law", "class", *(f"w = {w:g} d" for w in widths), f"chosen for {RTOL:g}")
    table(head, rows, output(f"contact_laws_bias{'_quick' if quick else ''}.md"))
    if not quick:
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        axis = figure.subplots()
        for name, biases in curves.items():
            axis.loglog(widths, biases, "o-", label=name)
        axis.set(xlabel="width over deepest penetration", ylabel="relative bias")
        axis.legend(fontsize=7)
        axis.grid(alpha=0.3)
        picture(compact(figure, output("contact_laws_bias.png")), "Bias of a smooth onset over its width")
    return found


def rubbed(law: Any, end: float) -> np.ndarray:
    """Place [m], speed [m/s] and lost work [J] of the block at 401 instants, shape (3, 401), by DOP853."""
    count = len(law.bristles)

    @jax.jit
    def flow(t, y):
        slip, memory = (y[1] - BASE_SPEED * jnp.sin(BASE_RATE * t),), tuple((z,) for z in y[3:])
        (traction,) = law.traction(None, slip, jnp.asarray(LOAD), memory)
        rates = law.memory_rate(None, slip, jnp.asarray(LOAD), memory)
        force = traction - SPRING * y[0]
        return jnp.stack([y[1], force / BLOCK, -traction * slip[0], *(rate for (rate,) in rates)])

    out = solve_ivp(
        lambda t, y: np.asarray(flow(t, jnp.asarray(y))), (0, end), np.zeros(3 + count), "DOP853",
        t_eval=np.linspace(0, end, 401), rtol=1e-12, atol=1e-16,
    )  # fmt: skip
    return out.y[:3]


def friction(quick: bool) -> dict[str, float]:
    """Bias of friction laws without corners over the width; returns that of the width that each law chooses."""
    write("## Bias of friction without corners\n")
    widths, end = (WIDTHS[1:2], 0.1 * END) if quick else (WIDTHS, END)
    found, rows = {}, []
    every = friction_laws()
    for name in ("threlfall", "dahl") if quick else every:
        law, speed = every[name]
        whole = rubbed(law, end)

        def bias(smooth, whole=whole):
            difference = np.abs(rubbed(smooth, end) - whole).max(axis=1)
            return float(np.max(difference / np.abs(whole).max(axis=1)))

        chosen = law.smoothed(rtol=RTOL)
        biases, found[name] = [bias(law.smoothed(w * speed)) for w in widths], bias(chosen)
        told = f"{found[name]:.1e} ({float(chosen.width) / speed:.1g} v)"
        rows.append((name, law.smoothness, *(f"{b:.1e}" for b in biases), told))
    head = ("law", "class", *(f"w = {w:g} v" for w in widths), f"chosen for {RTOL:g}")
    table(head, rows, output(f"contact_laws_friction{'_quick' if quick else ''}.md"))
    return found


def main(quick: bool = False) -> dict[str, float]:
    """Write the tables; returns the bias of the widths that laws choose for a relative tolerance of 1e-4."""
    restitutions(quick)
    others(quick)
    return smoothing(quick) | friction(quick)


if __name__ == "__main__":
    command(main, __doc__)
