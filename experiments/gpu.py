"""Batches on a GPU beside two cores of its CPU, float64: `python -m experiments.gpu` writes out/gpu.md.

Each batch is one loop on the GPU. Slider-cranks go through a revolution, joint 5 of a robot (with friction) through the
first 0.6 s of its motion, for clearances from 0.05 to 0.5 mm at rtol 1e-5; the batch of derivatives is the slider-
crank's, by clearance, friction and the conrod's mass. A robot arm in space with play in three of its joints
(`arm_with_play.toml`) goes through its first 5 ms, for clearances of a tenth, 7 and 5 hundredths of these. The CPU
solves a share of the same lanes, half of them on each of two cores, one process each. `ratio` is the GPU's lanes a
second over those of both cores. Errors are those of the final position, over the largest, and of the derivatives, each
over its largest, against a reference (Dopri8 at rtol 1e-10) for some of the lanes: on the CPU, and for the arm, which a
CPU takes minutes to compile, on the GPU. What is compiled is traced and compiled anew, and run twice: the second run
counts. The sweeps are those of the slider-crank, by `cj.sweep`: the final position, the same into a store, and the
peaks of error and force with energy balance; of the CPU by both cores. Without a GPU there is nothing to measure, and
nothing is written.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import clearance_jax as cj
from experiments.batches import END
from experiments.common import SCENES, joint5, output, seconds, slider_crank, table
from experiments.publish import command, say
from experiments.sweeps.asked import measured, swept

RTOL = 1e-5
TRUTH: dict[str, Any] = {"rtol": 1e-10, "solver": "dopri8"}
NAMES = ("wrist.radial_clearance", "wrist.friction.coefficient", "conrod.mass")
SLEEVES = tuple(f"axis_{axis}.radial_clearance" for axis in (2, 3, 5))
ARM = "arm, 3 sleeves"
# No program is begun later than this [s]: a GPU may be lent for ten minutes.
LATEST = 430.0


class Sizes(NamedTuple):
    """Lanes of the batches on the GPU, of the share on two cores, of the reference; the processes of the CPU; and lanes
    of the sweeps, on the GPU and on two cores.
    """

    batches: tuple[int, ...] = (256, 1024, 4096, 16384, 65536)
    share: int = 256
    references: int = 64
    processes: int = 2
    sweeps: int = 65536
    share_of_sweeps: int = 4096


QUICK = Sizes((8,), 8, 4, 1, 16, 16)


# What is solved: every program is a function of one lane's numbers, and gives a position and its derivatives ----------


def crank(numbers, rtol=RTOL, **options):
    mechanism = cj.replace(slider_crank(), dict(zip(NAMES, numbers, strict=True)))
    return cj.simulate(mechanism, END, rtol=rtol, energy_balance=False, **options)["piston.position.x"]


def crank_slopes(numbers, **options):
    value, slopes = jax.value_and_grad(lambda numbers: crank(numbers, **options))(numbers)
    return jnp.concatenate([value[None], slopes])


def robot(numbers, rtol=RTOL, **options):
    changes = {"joint5.radial_clearance": numbers[0], "joint5.friction.coefficient": numbers[1]}
    return cj.simulate(cj.replace(joint5(), changes), 0.6, rtol=rtol, energy_balance=False, **options)["end.position.x"]


def arm(numbers, rtol=RTOL, **options):
    changes = dict(zip(SLEEVES, numbers, strict=True))
    moved = cj.replace(cj.load(SCENES / "arm_with_play.toml"), changes)
    return cj.simulate(moved, 0.005, rtol=rtol, energy_balance=False, **options)["tcp.position.x"]


PROGRAMS: dict[str, Callable] = {
    "slider-crank": lambda numbers, **options: crank(numbers, **options)[None],
    "joint 5, friction": lambda numbers, **options: robot(numbers, **options)[None],
    "slider-crank, 3 derivatives": crank_slopes,
    ARM: lambda numbers, **options: arm(numbers, **options)[None],
}
# The reference of the derivatives is that of their positions, too.
REFERENCES = {"slider-crank": "slider-crank, 3 derivatives"}


def lanes(program: str, count: int, references: int = 0):
    """Numbers of the lanes: those of the reference, then as many as are left."""
    clearances = np.concatenate([np.linspace(5e-5, 5e-4, n) for n in (references, count - references)])
    if program == ARM:  # a tenth, 7 and 5 hundredths of these
        return jnp.asarray(clearances[:, None] * [0.1, 0.07, 0.05])
    others = [0.3] if program == "joint 5, friction" else [0.03, 0.21]
    return jnp.stack([jnp.asarray(clearances), *(jnp.full(count, x) for x in others)], axis=1)


# The CPU's part, in processes of its own ------------------------------------------------------------------------------


def stay_on(choose: Callable[[list[int]], set[int]]) -> None:
    """Keep this process to some of its cores. The first and the last: neighbours may be one core's two threads."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, choose(sorted(os.sched_getaffinity(0))))


def part_of_cpu(part: int, sizes: Sizes, programs: list[str]) -> dict:
    """One core's part: of each program the lanes a second, and the reference."""
    stay_on(lambda cores: {cores[0 if part == 0 else -1]})
    found = {}
    for name in programs:
        share = jnp.array_split(lanes(name, sizes.share), sizes.processes)[part]
        run = jax.jit(jax.vmap(PROGRAMS[name]))
        took = seconds(lambda run=run, share=share: run(share), 1)
        found[name] = {"rate": len(share) / took}
        if name not in REFERENCES and name != ARM:
            some = jnp.array_split(lanes(name, sizes.references), sizes.processes)[part]
            exact = jax.jit(jax.vmap(lambda numbers, name=name: PROGRAMS[name](numbers, **TRUTH)))
            found[name]["truth"] = np.asarray(exact(some)).tolist()
    return found


def sweeps_on(lanes: int) -> dict[str, float]:
    """Lanes a second of each way to sweep so many, on the device and the cores that JAX has here."""

    def stored():
        shutil.rmtree(output("gpu.zarr"), ignore_errors=True)
        return swept(lanes, RTOL, store=output("gpu.zarr"))

    ways = {
        "sweep": lambda: swept(lanes, RTOL),
        "sweep into a store": stored,
        "sweep, metrics": lambda: measured(lanes, RTOL),
    }
    rates = {way: lanes / seconds(run, 1) for way, run in ways.items()}
    shutil.rmtree(output("gpu.zarr"), ignore_errors=True)
    return rates


def by_cpu(quick: bool, sizes: Sizes, programs: list[str]) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """Lanes a second of both cores, and the references."""
    environment = os.environ | {"JAX_PLATFORMS": "cpu"}
    running = [
        subprocess.Popen(
            [sys.executable, "-m", "experiments.gpu", "--part", str(part), json.dumps(quick), *programs],
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        for part in range(sizes.processes)
    ]
    answers = [process.communicate()[0] for process in running]
    for process in running:
        if process.returncode:
            raise RuntimeError("The CPU's part of the measurement failed; what it said is above.")
    parts = [json.loads(answer.splitlines()[-1]) for answer in answers]
    rates = {name: sum(part[name]["rate"] for part in parts) for name in programs}
    truths = {
        name: np.concatenate([part[name]["truth"] for part in parts]) for name in programs if "truth" in parts[0][name]
    }
    return rates, truths


def sweeps_by_cpu(quick: bool) -> dict[str, float]:
    """Lanes a second of each sweep by a process of two cores."""
    asked = [sys.executable, "-m", "experiments.gpu", "--sweeps", json.dumps(quick)]
    environment = os.environ | {"JAX_PLATFORMS": "cpu"}
    answer = subprocess.run(asked, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout
    return json.loads(answer.splitlines()[-1])


# The GPU's ------------------------------------------------------------------------------------------------------------


def by_device(device: Any, program: str, count: int, references: int) -> tuple[np.ndarray, float, float]:
    """What the lanes of the reference gave, seconds to trace and compile, and to run."""
    numbers = jax.device_put(lanes(program, count, references), device)
    clock = time.perf_counter()
    run = jax.jit(jax.vmap(PROGRAMS[program])).lower(numbers).compile()
    compiled = time.perf_counter() - clock
    values = np.asarray(run(numbers))
    clock = time.perf_counter()
    jax.block_until_ready(run(numbers))
    return values[:references], compiled, time.perf_counter() - clock


def truth_by_device(device: Any, program: str, sizes: Sizes) -> np.ndarray:
    numbers = jax.device_put(lanes(program, sizes.references), device)
    return np.asarray(jax.jit(jax.vmap(lambda numbers: PROGRAMS[program](numbers, **TRUTH)))(numbers))


def errors(values: np.ndarray, truth: np.ndarray) -> tuple[str, str, str]:
    """Median and largest error of the position, and the median of the derivatives'."""
    truth = truth[:, : values.shape[1]]
    relative = np.abs(values - truth) / np.abs(truth).max(0)
    slopes = f"{np.median(relative[:, 1:]):.1e}" if values.shape[1] > 1 else ""
    return f"{np.median(relative[:, 0]):.1e}", f"{relative[:, 0].max():.1e}", slopes


def device_of(quick: bool) -> Any:
    """The GPU; in quick mode the CPU stands in for it. `None` where there is none."""
    try:
        return jax.devices("cpu" if quick else "gpu")[0]
    except RuntimeError:
        return None


def main(quick: bool = False) -> list[tuple]:
    """Write the table; returns its rows."""
    began = time.monotonic()
    device = device_of(quick)
    if device is None:
        print("There is no GPU that JAX can use here (`pip install 'jax[cuda13]'` on a machine with one).")
        return []
    sizes = QUICK if quick else Sizes()
    programs = ["slider-crank, 3 derivatives"] if quick else list(PROGRAMS)
    slower = sweeps_by_cpu(quick)
    rates, truths = by_cpu(quick, sizes, programs)
    for name in programs:
        if name not in REFERENCES and name not in truths:
            truths[name] = truth_by_device(device, name, sizes)
    rows, left = [], []
    # The largest first: should the time run out, small batches are missed least.
    for count in sorted(sizes.batches, reverse=True):
        for name in reversed(programs):
            if time.monotonic() - began > LATEST:
                left.append(f"{count} lanes of {name}")
                continue
            values, compiled, took = by_device(device, name, count, sizes.references)
            apart = errors(values, truths[REFERENCES.get(name, name)])
            rate, cpu = count / took, rates[name]
            figures = f"{compiled:.1f}", f"{took:.2f}", f"{rate:.0f}", f"{cpu:.0f}", f"{rate / cpu:.1f}"
            rows.append((name, count, *figures, *apart))
            print(*rows[-1], flush=True)
    rows.sort(key=lambda row: (programs.index(row[0]), row[1]))
    say(f"On {device.device_kind}.")
    head = "program", "lanes", "compile [s]", "run [s]", "lanes/s", "lanes/s, two cores", "ratio"
    head += "error median", "error max", "derivatives' median"
    table(head, rows, output(f"gpu{'_quick' if quick else ''}.md"))
    if left:
        say(f"Not measured, for want of time: {', '.join(left)}.")
    faster = sweeps_on(sizes.sweeps)
    head = "way", "lanes/s", "lanes/s, two cores", "ratio"
    beside = [(way, f"{rate:.0f}", f"{slower[way]:.0f}", f"{rate / slower[way]:.1f}") for way, rate in faster.items()]
    say(f"Sweeps of {sizes.sweeps} lanes, by two cores of {sizes.share_of_sweeps}:")
    table(head, beside, output(f"gpu_sweeps{'_quick' if quick else ''}.md"))
    return rows


if __name__ == "__main__":
    if "--sweeps" in sys.argv:
        stay_on(lambda cores: {cores[0], cores[-1]})
        cj.configure(cache=True)
        small = json.loads(sys.argv[-1])
        print(json.dumps(sweeps_on((QUICK if small else Sizes()).share_of_sweeps)))
    elif "--part" in sys.argv:
        part, small, *names = sys.argv[sys.argv.index("--part") + 1 :]
        cj.configure(cache=True)
        print(json.dumps(part_of_cpu(int(part), QUICK if json.loads(small) else Sizes(), names)))
    else:
        jax.config.update("jax_enable_compilation_cache", False)  # the table says how long compiling takes
        command(main, __doc__)
