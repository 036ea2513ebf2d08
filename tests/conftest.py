import ctypes
import datetime
import gc
import hashlib
import os
import sys
from pathlib import Path

import jax
import matplotlib as mpl
import pytest
from jaxtyping import install_import_hook

# Two ways to run: as developers, with little optimised, all types checked and no program kept; and as users run.
AS_USERS = os.environ.get("CLEARANCE_TESTS") == "as-users"

# The tests compile much and run little of it, and so do the processes that they start: without optimisation they
# compile in two thirds of the time, without kernels of fusions in half. JAX 0.12 aborts on the latter's option.
FLAGS = {"xla_backend_optimization_level": "1"}
FLAGS |= {"xla_cpu_use_fusion_emitters": "false"} if jax.__version_info__ < (0, 11) else {}
for flag, value in {} if AS_USERS else FLAGS.items():
    if flag not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --{flag}={value}".strip()
# As `configure` sets it, before JAX starts.
os.environ.setdefault("PJRT_NPROC", str(2 * (os.cpu_count() or 1)))
# But for those marked `optimised`: they run longer than they compile, or count what the compiler computes twice.


def optimised(some: bool) -> None:
    """Whether what this process compiles from here on, and what it starts, is optimised somewhat, or not at all."""
    os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = str(int(not some))
    jax.config.update("jax_disable_most_optimizations", not some)


optimised(AS_USERS)
if not AS_USERS:
    jax.config.update("jax_numpy_rank_promotion", "raise")
mpl.use("Agg")

# Types and shapes are checked in every module but these and what holds them. Their functions are called for every
# scalar, operation or coordinate of a program that is traced, and their annotations tell nothing apart.
LIBRARY = Path(__file__).parents[1]
UNCHECKED = ("_compile", "spatial", "mechanism.placement", "mechanism.tree.coordinate")
FREE = tuple(f"clearance_jax.{name}." for name in UNCHECKED)
FILES = (path.relative_to(LIBRARY).with_suffix("").parts for path in (LIBRARY / "clearance_jax").rglob("*.py"))
NAMES = (".".join(parts).removesuffix(".__init__") + "." for parts in FILES)
# A name stands for all that lies below it as well.
CHECKED = [
    name.removesuffix(".")
    for name in NAMES
    if not name.startswith(FREE) and not any(free.startswith(name) for free in FREE)
]
if not AS_USERS:
    _hook = install_import_hook(CHECKED, "beartype.beartype")
    _hook.__enter__()

import clearance_jax  # noqa: E402  (the hook must come first)

# Programs are kept as executables where the tests run as users do. Elsewhere they are not: to find that a test has
# patched what a program is made of, all of the library is looked at for each.
if not AS_USERS:
    os.environ["CLEARANCE_KEPT"] = "0"
clearance_jax.configure(cache=True)

# What is imported stays: the collector need not look at it again. Tracing makes many objects that live, so that it
# would look often, and at all of them.
gc.collect()
gc.freeze()
gc.set_threshold(50_000, 20, 20)

# Those that take longest begin and the quick ones end, so that no process is left alone with one file at the end.
LONG = (
    "notebooks",
    "docs",
    "experiments",
    "spatial_mechanisms",
    "settled_start_space",
    "metrics",
    "paths",
    "design",
    "wear_design",
)

# Programs are shared by the tests of a file, and let go between files where they hold much: memory [GB], or mappings.
# Linux lets a process have 65530 of these, and XLA crashes where there are no more. Within a file they are let go where
# they hold more than a process may.
MUCH_MEMORY, MOST_MEMORY, MANY_MAPPINGS = 1.5, 2.2, 16_000


# A run of the whole suite takes one part of so many of the tests marked `slow`, another every day. A run as users takes
# one part of so many of all tests.
SLOW_PARTS, USERS_PARTS = 10, 10


def pytest_addoption(parser):
    parser.addoption("--account", metavar="FOLDER", help="write where the time goes into FOLDER/suite.md")
    parser.addoption("--all", action="store_true", help="every test, not this day's part of the slow ones")
    parser.addoption("--day", type=int, default=datetime.date.today().toordinal(), help="the parts of this day")


def pytest_configure(config):
    if config.args_source is pytest.Config.ArgsSource.ARGS:  # files or tests that are named run whole
        config.option.all = True
    config.option.day = getattr(config, "workerinput", {}).get("day", config.option.day)
    folder = config.getoption("--account")
    if folder is not None:
        from accounting import Accounting

        config.pluginmanager.register(Accounting(Path(folder)))


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node):
    node.workerinput["day"] = node.config.option.day  # a worker may start after midnight


def pytest_report_header(config):
    day = config.getoption("--day")
    if config.option.all:
        return None
    users = f"; of all, as users run: part {day % USERS_PARTS + 1} of {USERS_PARTS}" if AS_USERS else ""
    return f"slow tests: part {day % SLOW_PARTS + 1} of {SLOW_PARTS}{users} (--day {day}; --all runs every part)"


def _runs_on(day: int, item) -> bool:
    """Whether a test has its turn this day: every day, or once in as many days as there are parts."""
    slow = item.get_closest_marker("slow") is not None
    parts = (SLOW_PARTS if slow else 1) * (USERS_PARTS if AS_USERS else 1)
    return (int.from_bytes(hashlib.sha256(item.nodeid.encode()).digest()) - day) % parts == 0


def pytest_collection_modifyitems(config, items):
    if not config.option.all:
        today = [_runs_on(config.getoption("--day"), item) for item in items]
        config.hook.pytest_deselected(items=[item for item, turn in zip(items, today, strict=True) if not turn])
        items[:] = [item for item, turn in zip(items, today, strict=True) if turn]

    def place(item):
        name = item.path.stem.removeprefix("test_")
        quick = item.get_closest_marker("quick") is not None
        return LONG.index(name) if name in LONG else len(LONG) + quick

    items.sort(key=place)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    optimised(AS_USERS or item.get_closest_marker("optimised") is not None)


def _resident() -> float:
    """Memory of this process [GB]; the most that it may hold where nothing says so."""
    told = Path("/proc/self/statm")
    return int(told.read_text().split()[1]) * 4096 / 1e9 if told.exists() else MOST_MEMORY


def _let_go() -> None:
    jax.clear_caches()
    gc.collect()
    if sys.platform == "linux":
        ctypes.CDLL(None).malloc_trim(0)  # the allocator keeps what is freed, and gives it back when asked


@pytest.fixture(autouse=True)
def _memory_kept(request):
    if request.node.get_closest_marker("large") is not None:
        _let_go()
    yield
    if _resident() > MOST_MEMORY:
        _let_go()


@pytest.fixture(autouse=True, scope="module")
def _programs_let_go():
    yield
    maps = Path("/proc/self/maps")
    if _resident() > MUCH_MEMORY or (maps.exists() and len(maps.read_bytes().splitlines()) > MANY_MAPPINGS):
        _let_go()
