"""What the experiments share: the scenes as the references have them, timing, tables, where output goes."""

import io
import re
import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from PIL import Image

import clearance_jax as cj
from experiments.publish import keep, say

SCENES = Path(__file__).parent / "scenes"
STUDIES = Path(__file__).parent / "studies"
CRANK_SPEED = 5000 * 2 * np.pi / 60


def output(name: str) -> Path:
    """A file in `out/` of the working directory."""
    folder = Path("out")
    folder.mkdir(exist_ok=True)
    return folder / name


def slider_crank() -> cj.Mechanism:
    return cj.load(SCENES / "slider_crank.toml")


def joint5() -> cj.Mechanism:
    return cj.load(SCENES / "joint5_velocity_1.toml")


def as_reference(kind: str, y: Any, t: Any) -> np.ndarray:
    """States as `experiments.reference` has them: absolute conrod angle for the slider-crank."""
    y = np.asarray(y)[..., :4]
    if kind == "joint5":
        return y
    turned = np.stack([CRANK_SPEED * np.asarray(t), 0 * t, CRANK_SPEED + 0 * t, 0 * t], -1)
    return y + turned


def error(y: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Largest error of each state over the samples, relative to the state's largest magnitude."""
    return np.abs(y - truth).max(0) / np.abs(truth).max(0)


def is_same(a: np.ndarray, b: np.ndarray, within: float = 1e-9) -> bool:
    """Whether two models have the same numbers, so that they are one."""
    return a.shape == b.shape and bool(np.abs(a - b).max() <= within * np.abs(a).max())


def packages(folder: Path) -> str:
    """The packages that were installed into a folder, with their versions."""
    names = sorted(path.name.removesuffix(".dist-info") for path in folder.glob("*.dist-info"))
    return f"packages: {', '.join(names)}" if names else "no packages"


def seconds(call: Callable[[], Any], repeats: int) -> float:
    """The shortest of several runs, after one that compiles."""
    jax.block_until_ready(call())
    times = []
    for _ in range(repeats):
        clock = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - clock)
    return min(times)


def peak_memory() -> float:
    """The peak of this process so far [MiB], on Linux."""
    # What Python's `resource` says is not less than the peak of the process that began this one.
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text(encoding="utf-8"))
    assert found is not None
    return int(found[1]) / 2**10


def table(head: Sequence[str], rows: Sequence[Sequence[Any]], path: Path) -> str:
    """Print a Markdown table and write it to `path`."""
    cells = [list(head), *([str(c) for c in row] for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    lines = ["| " + " | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) + " |" for row in cells]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    text = "\n".join(lines) + "\n"
    print(text, flush=True)
    path.write_text(text, encoding="utf-8")
    keep(text)
    return text


def compact(figure: Figure, path: Path, colours: int = 64, dpi: float = 110) -> Path:
    """Write a figure as a picture of few colours: enough for lines, and half the file."""
    whole = io.BytesIO()
    figure.savefig(whole, format="png", dpi=dpi)
    Image.open(whole).convert("RGB").quantize(colours).save(path, optimize=True)
    return path


def swept(name: str, **asked: Any) -> xr.Dataset:
    """A sweep by way of a store in `out/`: a run that was broken off goes on when it is started again. What was found
    is read, and the store goes, so that a run that is over is never taken for the next one.

    **Arguments:** `asked`: those of `cj.sweep`.
    """
    store = output(f"{name}.zarr")
    again, began = store.exists(), time.perf_counter()
    answers = cj.sweep(**asked, store=store, resume=True, plan=say).load()
    took = time.perf_counter() - began
    before = ", and before that a run that was broken off" if again else ""
    say(f"{answers.attrs['lanes']} lanes, {answers.attrs['failed']} failed: {took:.0f} s with compiling{before}")
    shutil.rmtree(store)
    return answers
