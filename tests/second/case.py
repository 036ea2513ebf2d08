"""One case: scenes of one structure, by both simulators, in a process whose programs are not optimised."""

import os
import tempfile
import time
from pathlib import Path

# As in tests/conftest.py: what is compiled here runs less than it compiles.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
if "xla_backend_optimization_level" not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_backend_optimization_level=1".strip()
os.environ.setdefault("CLEARANCE_KEPT", "0")

import jax

import clearance_jax as cj

from .compare import compare
from .scenes import scene

EACH = 3
"""Scenes of one structure."""


def run(i: int, case: dict, shown: int) -> dict:
    """One case: its features, whether both agree, and the worst comparisons."""
    cj.configure()
    begun = time.process_time()
    scenes = [scene(case, i, k) for k in range(EACH)]
    out = {"case": i, "features": scenes[0].case}
    try:
        with tempfile.TemporaryDirectory() as folder:
            found = compare(scenes, Path(folder), contacts=case["contacts"] == "compared", derivatives=1)
        out["verdict"] = "agree" if found[0].ratio <= 1 else "disagree"
        # Of every quantity its worst comparison.
        worst = {one.what: one for one in reversed(found)}
        out["worst"] = [one._asdict() for one in sorted(worst.values(), key=lambda one: -one.ratio)[:shown]]
    except Exception as error:  # the others go on
        out |= {"verdict": "failed", "worst": [], "error": f"{type(error).__name__}: {error}"[:500]}
    jax.clear_caches()
    return out | {"seconds": round(time.process_time() - begun, 1)}
