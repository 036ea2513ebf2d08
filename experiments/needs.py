"""The cost of what a scene contains, and of nothing else: `python -m experiments.needs` writes a table for each
scene to out/.

Each scene is measured whole, and then with one thing removed. What is removed leaves the compiled program: a friction
law of coefficient zero still costs its operations, no friction law costs none. *States* is the length of the state
without integrals. *Field* is the number of operations of one evaluation of the vector field, with the powers of the
energy balance if it is integrated. *Attempt* is the number of operations of one attempt at a step, with the location of
events and the search for peaks; stages, bisections and branches count once. Both are counted for one motion, in the
program as simplified by XLA before it fuses kernels (`experiments/hlo.py` says what counts). *Compile* is the CPU time
in which XLA compiles the solve, without a cache. *Time* is the wall time of one attempt at a step, in the shortest of
five solves at rtol 1e-6. A scene asks for the largest acceleration of a point if it has one to remove ("metric").

A scene without its only clearance may have no free coordinate (joint 5, the disc, the tool changer): nothing is
integrated, and its field has no operations. An ideal mechanism makes few steps, so that the time of an attempt is
mostly that of the start and the end of its solve.
"""

import dataclasses
import functools
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.experimental.compilation_cache import compilation_cache

import clearance_jax as cj
from clearance_jax.dynamics.field import rate
from clearance_jax.mechanism.state import layout
from experiments.common import SCENES, output, seconds, slider_crank, table
from experiments.hlo import arithmetic, busiest_loop
from experiments.operations import SIMPLIFIED, four_bar, joint5_with_friction
from experiments.publish import command, say, write

WHOLE = "nothing"


class Model(NamedTuple):
    """What is solved: a mechanism, and what is asked of its motion."""

    mechanism: cj.Mechanism
    point: str | None
    energy_balance: bool = True
    locate_events: bool = True

    def with_clearance(self, joint: Any, **changed: Any) -> "Model":
        """The same with other parts of a joint's clearance."""
        clearance = dataclasses.replace(joint.clearance, **changed)
        return self._replace(mechanism=self.mechanism.with_clearance(joint.name, clearance))

    def solve(self, mechanism: cj.Mechanism, t1: float) -> dict[str, Any]:
        """The attempts at a step, and the metric if there is one."""
        metrics: dict[str, Any] = {"attempts": lambda solution: solution.steps + solution.rejected}
        if self.point is not None:
            metrics["peak"] = cj.metrics.Peak(cj.metrics.Acceleration(self.point))
        asked = {"energy_balance": self.energy_balance, "locate_events": self.locate_events}
        return cj.measure(mechanism, metrics, t1, rtol=1e-6, **asked)


class Scene(NamedTuple):
    """A scene with everything, how much of its motion is solved [s], and what can be removed."""

    whole: Callable[[], Model]
    t1: float
    removable: tuple[str, ...]


class Row(NamedTuple):
    """What a scene costs: counts, CPU time of compiling [s], time of an attempt [s]; `None`: not measured."""

    scene: str
    removed: str
    states: int
    field: int
    attempt: int
    compiled: float | None = None
    time: float | None = None


# What can be removed -------------------------------------------------------------------------------------------------


def no_friction(model: Model) -> Model:
    for joint in model.mechanism.clearance_joints():
        model = model.with_clearance(joint, friction=None)
    return model


def one_clearance_less(model: Model) -> Model:
    joint = model.mechanism.joint(model.mechanism.clearance_joints()[0].name)
    return model._replace(mechanism=model.mechanism.with_joint(dataclasses.replace(joint, clearance=None)))


def no_axial_play(model: Model) -> Model:
    for joint in model.mechanism.clearance_joints():
        model = model.with_clearance(joint, axial_clearance=None, collar_radius=None)
    return model


def no_wear(model: Model) -> Model:
    (joint,) = model.mechanism.clearance_joints()
    return model.with_clearance(joint, depth=None)


REMOVALS: dict[str, Callable[[Model], Model]] = {
    WHOLE: lambda model: model,
    "friction": no_friction,
    "a clearance": one_clearance_less,
    "axial play": no_axial_play,
    "wear": no_wear,
    "gravity": lambda model: model._replace(mechanism=dataclasses.replace(model.mechanism, gravity=cj.Gravity())),
    "metric": lambda model: model._replace(point=None),
    "energy balance": lambda model: model._replace(energy_balance=False),
    "event location": lambda model: model._replace(locate_events=False),
}
WITHOUT_METRIC = ("friction", "a clearance", "gravity", "energy balance", "event location")
OF_ALL = (*WITHOUT_METRIC, "metric")
OF_WEAR = ("wear", "friction", "a clearance", "gravity")


# Scenes --------------------------------------------------------------------------------------------------------------


def falling(mechanism: cj.Mechanism) -> cj.Mechanism:
    """A plane mechanism under gravity."""
    return dataclasses.replace(mechanism, gravity=cj.Gravity(y=-9.81))


def tool_changer() -> cj.Mechanism:
    return cj.load(SCENES / "tool_changer.toml")


def worn_disc() -> cj.Mechanism:
    disc = cj.load(SCENES / "disc_worn.toml")
    law = cj.laws.TanhCoulomb(coefficient=0.1, transition_speed=0.01)
    return Model(disc, None).with_clearance(disc.joint("pin"), friction=law).mechanism


SCENE: dict[str, Scene] = {
    "slider-crank": Scene(lambda: Model(falling(slider_crank()), "piston"), 0.012, OF_ALL),
    "four-bar, three clearances": Scene(lambda: Model(falling(four_bar()), "tip"), 0.02, OF_ALL),
    "joint 5 in the plane": Scene(lambda: Model(joint5_with_friction(), "end"), 0.5, OF_ALL),
    "disc in a worn sleeve": Scene(lambda: Model(worn_disc(), None), 0.05, OF_WEAR),
    "tool changer in space": Scene(lambda: Model(tool_changer(), None), 0.02, ("axial play", *WITHOUT_METRIC)),
}


QUICK = ("slider-crank",)


# Measured ------------------------------------------------------------------------------------------------------------


def text_of(lowered: Any, quick: bool) -> str:
    """A program as simplified, or as written if it has to be quick."""
    if quick:
        return lowered.as_text(dialect="hlo", debug_info=True)
    return lowered.compile(compiler_options=SIMPLIFIED).as_text()


def field_operations(model: Model, quick: bool) -> int:
    """The operations of one evaluation of the field."""
    mechanism = model.mechanism.prepare()
    size = layout(mechanism).size
    if size == 0:
        return 0

    def once(time, y, mechanism):
        return rate(time, tuple(y[i] for i in range(size)), mechanism, model.energy_balance)

    return arithmetic(text_of(jax.jit(once).lower(0.0, jnp.zeros(size), mechanism), quick))


def compilation(lowered: Any) -> tuple[Any, float]:
    """A program, and the CPU time in which it is compiled without a cache [s]."""
    settings: Any = jax.config
    cached = settings.jax_enable_compilation_cache
    settings.update("jax_enable_compilation_cache", False)
    compilation_cache.reset_cache()
    clock = time.process_time()
    ready = lowered.compile()
    clock = time.process_time() - clock
    settings.update("jax_enable_compilation_cache", cached)
    compilation_cache.reset_cache()
    return ready, clock


def row_of(scene: str, removed: str, quick: bool) -> Row:
    """What a scene costs without one thing; only the counts, and nothing runs, if it has to be quick."""
    whole, t1, _ = SCENE[scene]
    model = REMOVALS[removed](whole())
    lowered = jax.jit(functools.partial(model.solve, t1=t1)).lower(model.mechanism)
    states = layout(model.mechanism.prepare()).size
    row = Row(scene, removed, states, field_operations(model, quick), busiest_loop(text_of(lowered, quick)))
    if quick:
        return row
    ready, cpu = compilation(lowered)
    attempts = int(ready(model.mechanism)["attempts"])
    return row._replace(compiled=cpu, time=seconds(lambda: ready(model.mechanism), 5) / max(attempts, 1))


def not_lower(rows: list[Row]) -> list[Row]:
    """The rows in which something was removed and neither count falls, or a count or the number of states rises."""
    whole = {row.scene: row for row in rows if row.removed == WHOLE}
    found = []
    for row in rows:
        before, after = ((r.states, r.field, r.attempt) for r in (whole[row.scene], row))
        rises = any(b < a for b, a in zip(before, after, strict=True))
        if row.removed != WHOLE and (rises or before[1:] == after[1:]):
            found.append(row)
    return found


def main(quick: bool = False) -> list[Row]:
    """Write the table; returns its rows."""
    rows = []
    for scene in QUICK if quick else SCENE:
        write(f"## {scene[0].upper()}{scene[1:]}\n")
        rows += [row_of(scene, removed, quick) for removed in (WHOLE, *SCENE[scene].removable)]
        table(
            ("removed", "states", "field", "attempt", "compile [s]", "time [us]"),
            [(r.removed, r.states, r.field, r.attempt, *times_of(r)) for r in rows if r.scene == scene],
            output(f"needs_{scene.split()[0]}{'_quick' if quick else ''}.md"),
        )
    kept = ", ".join(f"{row.removed} ({row.scene})" for row in not_lower(rows))
    say(f"Removed without a fall of the counts: {kept}." if kept else "Whatever is removed, the counts fall.")
    return rows


def times_of(row: Row) -> tuple[str, str]:
    """The times of a row in words."""
    if row.compiled is None or row.time is None:
        return "", ""
    return f"{row.compiled:.1f}", f"{1e6 * row.time:.1f}"


if __name__ == "__main__":
    command(main, __doc__, quick="the slider-crank, its operations as written, no times")
