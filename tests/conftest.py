import ctypes
import gc
import os
import sys
from pathlib import Path

import jax
import matplotlib as mpl
import pytest
from jaxtyping import install_import_hook

jax.config.update("jax_numpy_rank_promotion", "raise")
mpl.use("Agg")

# Types and shapes are checked in every module but `spatial`. Its functions are called for every scalar of a program
# that is traced, and their annotations tell nothing apart: checking them took a sixth of all tracing.
PACKAGE = Path(__file__).parents[1] / "clearance_jax"
CHECKED = [f"clearance_jax.{path.stem}" for path in PACKAGE.iterdir() if path.stem not in ("__pycache__", "spatial")]
_hook = install_import_hook(CHECKED, "beartype.beartype")
_hook.__enter__()

import clearance_jax  # noqa: E402  (the hook must come first)

os.environ["CLEARANCE_KEPT"] = "0"  # a test may patch what a kept program was made of
clearance_jax.configure(cache=True)

# What is imported stays: the collector need not look at it again. Tracing makes many objects that live, so that it
# would look often, and at all of them.
gc.collect()
gc.freeze()
gc.set_threshold(50_000, 20, 20)

# Files of which `make quick` is made: what a law or a message breaks, and what compiles little.
QUICK = {"curves", "fits", "fitting", "fuzz", "keys", "laws", "laws_reference", "layers", "numerics", "operations"}
QUICK |= {"play_holds", "play_input", "report", "squeezer", "stumbles", "sweep_figures", "urdf"}
# Those that take longest begin, so that no process is left alone with one of them at the end.
LONG = ("notebooks", "docs", "experiments", "space", "settled_space", "metrics", "paths", "design", "wear_design")

# Programs are shared by the tests of a file, and let go between files where they hold much: memory [GB], or mappings.
# Linux lets a process have 65530 of these, and XLA crashes where there are no more.
MUCH_MEMORY, MANY_MAPPINGS = 1.5, 16_000


def pytest_addoption(parser):
    parser.addoption("--account", metavar="FOLDER", help="write where the time goes into FOLDER/suite.md")


def pytest_configure(config):
    folder = config.getoption("--account")
    if folder is not None:
        from accounting import Accounting

        config.pluginmanager.register(Accounting(Path(folder)))


def pytest_collection_modifyitems(items):
    def place(item):
        name = item.path.stem.removeprefix("test_")
        return LONG.index(name) if name in LONG else len(LONG)

    items.sort(key=place)
    for item in items:
        if item.path.stem.removeprefix("test_") in QUICK:
            item.add_marker("quick")


def _holds_much() -> bool:
    process = Path("/proc/self")
    if not process.exists():
        return True
    resident = int((process / "statm").read_text().split()[1]) * 4096 / 1e9
    return resident > MUCH_MEMORY or len((process / "maps").read_bytes().splitlines()) > MANY_MAPPINGS


@pytest.fixture(autouse=True, scope="module")
def _programs_let_go():
    yield
    if _holds_much():
        jax.clear_caches()
        gc.collect()
        if sys.platform == "linux":
            ctypes.CDLL(None).malloc_trim(0)  # the allocator keeps what is freed, and gives it back when asked
