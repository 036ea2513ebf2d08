"""What large sweeps need: memory, measured; and a thousand million lanes, on paper."""

import json
import subprocess
import sys
from typing import Any

import numpy as np

from clearance_jax.solve.drivers.lanes import LANES
from clearance_jax.sweep.grid import LEAST, partition
from clearance_jax.sweep.run import CHUNKS_A_CORE, grid_of
from experiments.batches import END
from experiments.common import peak_memory
from experiments.sweeps.asked import CLEARANCE, METRICS, clearances, measured, mechanism

RTOL = 1e-5
THOUSAND_MILLION = (1000, 1000, 1000)


def stages(lanes: int) -> dict[str, float]:
    """The peak of this process [MiB], one stage after the other."""
    found = {"Python, JAX and this library imported": peak_memory()}
    measured(64, RTOL)
    found["compiled, 64 lanes"] = peak_memory()
    measured(lanes, RTOL)
    return found | {f"{lanes} lanes": peak_memory()}


def memory(lanes: int) -> dict[str, float]:
    """The same of a process of its own."""
    arguments = [sys.executable, "-m", "experiments.sweeps", "memory", str(lanes)]
    answer = subprocess.run(arguments, capture_output=True, text=True, check=True)
    return json.loads(answer.stdout.splitlines()[-1])


def large(cpu: float) -> list[tuple[Any, ...]]:
    """A thousand million lanes of so many CPU seconds on workers of some cores each: a row for each kind of worker."""
    rows, count = [], int(np.prod(THOUSAND_MILLION))
    question = grid_of(mechanism(), {CLEARANCE: clearances(64)}, METRICS, END)
    for cores in (1, 16, 64):
        cut = partition(THOUSAND_MILLION, [False] * 3, max(LEAST, LANES * CHUNKS_A_CORE * cores))
        lanes = int(np.prod(cut.chunk))
        files, size = cut.count * len(question.kinds), f"{count * question.bytes_a_lane / 1e9:.0f}"
        hours = f"{lanes * cpu / cores:.0f}", f"{count * cpu / 3600:.0f}"
        rows.append((cores, f"{lanes}", f"{cut.count}", f"{files}", size, *hours))
    return rows
