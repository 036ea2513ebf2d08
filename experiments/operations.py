"""Arithmetic that the compiler repeats: `python -m experiments.operations` writes out/operations.md.

XLA, the compiler of JAX, fuses operations into kernels. If two kernels need the same value, it may compute the value in
both. The table counts the arithmetic of one attempt at a step, for each lane (motion) of a batch, in three forms of the
program: as written, as simplified by XLA, and as fused by XLA (`experiments/hlo.py` says what counts; stages,
bisections and branches count once). The third count divided by the second shows how much fusion repeats. The programs
run at rtol 1e-5, without energy balance unless named. The four-bar has play in three joints.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

import clearance_jax as cj
from clearance_jax.solve.drivers.lanes import LANES
from experiments.common import SCENES, joint5, output, slider_crank, table
from experiments.hlo import busiest_loop
from experiments.publish import command

# LLVM comes after XLA, and changes none of what is counted.
_FUSED = {"xla_backend_optimization_level": 0}
SIMPLIFIED = _FUSED | {"xla_disable_hlo_passes": "fusion"}


class Row(NamedTuple):
    """Operations of a lane in one attempt: as written, simplified, fused."""

    program: str
    written: float
    simplified: float
    fused: float

    @property
    def repeated(self) -> float:
        """Operations after fusion over those before."""
        return self.fused / self.simplified


def four_bar() -> cj.Mechanism:
    mechanism = cj.load(SCENES / "four_bar.toml")
    play = mechanism.joint("knuckle").clearance
    return mechanism.with_clearance("crankpin", play).with_clearance("pivot", play)


def joint5_with_friction() -> cj.Mechanism:
    return cj.replace(joint5(), {"joint5.friction.coefficient": 0.3})


PROGRAMS: dict[str, tuple[Callable, str, dict[str, Any]]] = {
    "slider-crank": (slider_crank, "wrist", {}),
    "slider-crank, no events": (slider_crank, "wrist", {"locate_events": False}),
    "slider-crank, energy balance": (slider_crank, "wrist", {"energy_balance": True}),
    "slider-crank, Dopri8": (slider_crank, "wrist", {"solver": "dopri8"}),
    "four-bar": (four_bar, "knuckle", {}),
    "joint 5, friction": (joint5_with_friction, "joint5", {}),
}


def counted(program: str) -> Row:
    """The operations of one program; it is compiled and never run."""
    scene, joint, options = PROGRAMS[program]
    mechanism = scene()

    def lane(clearance):
        changed = cj.replace(mechanism, {f"{joint}.radial_clearance": clearance})
        solution = cj.simulate(changed, 0.01, **({"rtol": 1e-5, "energy_balance": False} | options))
        return solution.final, solution.steps

    lowered = jax.jit(jax.vmap(lane)).lower(jnp.linspace(5e-5, 5e-4, LANES))
    texts = [lowered.as_text(dialect="hlo", debug_info=True)]
    texts += [lowered.compile(compiler_options=options).as_text() for options in (SIMPLIFIED, _FUSED)]
    return Row(program, *(busiest_loop(text) / LANES for text in texts))


def main(quick: bool = False) -> list[Row]:
    """Write the table; returns its rows."""
    rows = [counted(program) for program in (list(PROGRAMS)[:1] if quick else PROGRAMS)]
    table(
        ("program", "as written", "simplified", "fused", "fused over simplified"),
        [(r.program, f"{r.written:.0f}", f"{r.simplified:.0f}", f"{r.fused:.0f}", f"{r.repeated:.2f}") for r in rows],
        output(f"operations{'_quick' if quick else ''}.md"),
    )
    return rows


if __name__ == "__main__":
    command(main, __doc__, quick="the slider-crank alone")
