"""The order of packages, no circles between modules, and what each side of the house may know of the world outside.

Every import counts: those inside functions, and those for type checkers only.
"""

import ast
import functools
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest
from places import ROOT

pytestmark = pytest.mark.quick

PACKAGE = "clearance_jax"
LIBRARY = ROOT / PACKAGE
# Each imports only those before it, and itself. What lies at the root as a leaf is one place.
ORDER = (
    "leaves",
    "laws",
    "joints",
    "mechanism",
    "dynamics",
    "solve",
    "metrics",
    "ask",
    "analysis",
    "results",
    "runs",
    "sweep",
    "wear",
    "design",
    "calibrate",
    "io",
    "examples",
    "report",
    "cli",
)
LEAVES = {"_basis", "_compile", "_version", "configure", "errors", "parameters", "spatial", "units"}
# What the physics and the tasks still ask of the compiler: barriers by hand, and what is called by itself as one
# program. The list only gets shorter.
COMPILER = f"{PACKAGE}._compile"
PHYSICS = {"laws", "joints", "mechanism", "metrics", "wear", "design"}
KNOW_THE_COMPILER = {
    *("laws._friction", "joints._base", "joints.bore", "joints.sleeve"),
    *("mechanism.motion.motion_laws", "mechanism.motion.paths", "mechanism.motion.pieces", "mechanism.motion.drives"),
    "metrics.signals",
}
# Studies ask the engine: what they need of these modules is public, or `ask` and `analysis` compute it.
STUDIES = {"sweep", "wear", "design", "calibrate"}
ROOMS = ("dynamics", "solve.steps", "solve.flow", "solve.drivers.driver", "solve.first_state")
ROOMS += ("mechanism.prepared", "mechanism.state", "mechanism.tree", "mechanism.placement")
TOLD = f"{PACKAGE}.dynamics.quantities"
# What runs on a device is `analysis` and all that it needs; `units` reads and writes for people.
HOST_ONLY = {"xarray", "matplotlib", "PIL", "pint", "scipy", "typer", "rich", "tomllib", "jinja2", "xml", "defusedxml"}
DEVICE_EXCEPT = {f"{PACKAGE}.units"}
# A report is handed its findings and computes none.
REPORT_KNOWS = {"leaves", "results", "design", "calibrate", "report"}


def modules() -> dict[str, Path]:
    """Every module by its name, but for the package's own list of public names."""
    found = {}
    for path in sorted(LIBRARY.rglob("*.py")):
        parts = path.relative_to(LIBRARY).with_suffix("").parts
        if parts != ("__init__",):
            found[".".join((PACKAGE, *(p for p in parts if p != "__init__")))] = path
    return found


MODULES = modules()


def imported(tree: ast.AST, known: Iterable[str]) -> set[str]:
    """What a module imports anywhere in it; `from package import module` is that module."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: a relative import"
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name if name in known else str(node.module) for name in names}
    return found


@functools.cache
def imports(module: str) -> set[str]:
    return imported(ast.parse(MODULES[module].read_text(encoding="utf-8")), MODULES)


def own(found: Iterable[str]) -> set[str]:
    return {name for name in found if name.split(".")[0] == PACKAGE}


def place(module: str) -> str:
    head = module.split(".")[1]
    return "leaves" if head in LEAVES else head


def reached(start: str, edges: Mapping[str, Iterable[str]]) -> set[str]:
    """All that can be come to from `start` in one step or more."""
    seen: set[str] = set()
    stack = list(edges.get(start, ()))
    while stack:
        name = stack.pop()
        if name not in seen:
            seen.add(name)
            stack += edges.get(name, ())
    return seen


def circles(edges: Mapping[str, Iterable[str]]) -> set[str]:
    return {name for name in edges if name in reached(name, edges)}


EDGES = {module: own(imports(module)) for module in MODULES}


@pytest.mark.parametrize("module", MODULES)
def test_imports_point_down(module):
    assert place(module) in ORDER, f"{module} has no place in the order of packages"
    wrong = [m for m in EDGES[module] if ORDER.index(place(m)) > ORDER.index(place(module))]
    assert wrong == []


def test_public_names_come_from_inside():
    """Nothing inside imports the list of public names: it imports everything."""
    assert [module for module in MODULES if PACKAGE in EDGES[module]] == []


def test_no_circles_between_modules():
    assert circles(EDGES) == set()


def test_the_device_side_knows_only_the_device():
    analysis = {module for module in MODULES if place(module) == "analysis"}
    device = analysis.union(*(reached(module, EDGES) for module in analysis)) - DEVICE_EXCEPT
    assert f"{PACKAGE}.dynamics.field" in device
    host = {module: {m.split(".")[0] for m in imports(module)} & HOST_ONLY for module in device}
    assert {module: found for module, found in host.items() if found} == {}


def test_the_compiler_is_known_in_one_place():
    knows = {m.removeprefix(f"{PACKAGE}.") for m in MODULES if any(n.startswith(COMPILER) for n in EDGES[m])}
    assert {module for module in knows if place(f"{PACKAGE}.{module}") in PHYSICS} == KNOW_THE_COMPILER


def names_from(module: str) -> Iterable[tuple[str, str]]:
    """The names that a module imports, each with the module that it comes from."""
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            yield from ((str(node.module), alias.name) for alias in node.names)


def test_studies_ask_the_engine():
    stub = ast.parse((LIBRARY / "__init__.pyi").read_text(encoding="utf-8"))
    public = {alias.name for node in ast.walk(stub) if isinstance(node, ast.ImportFrom) for alias in node.names}
    inside = tuple(f"{PACKAGE}.{room}." for room in ROOMS)
    studies = [m for m in MODULES if place(m) in STUDIES or m == f"{PACKAGE}.analysis.trust"]
    asked = {(m, origin, name) for m in studies for origin, name in names_from(m) if f"{origin}.".startswith(inside)}
    assert ("mobility", f"{PACKAGE}.design.judge.static") in {(name, m) for m, _, name in asked}
    assert {entry for entry in asked if entry[2] not in public and entry[1] != TOLD} == set()


def test_private_parts_of_jax_are_asked_in_one_place():
    """What a new release of JAX may break."""
    private = ("jax._src", "jaxlib", "equinox._", "equinox.internal")
    where = f"{COMPILER}.private"
    assert {m for m in MODULES if any(n.startswith(private) for n in imports(m))} == {where}
    nodes = ast.walk(ast.parse(MODULES[where].read_text(encoding="utf-8")))
    asked = [node for node in nodes if isinstance(node, ast.ImportFrom) and str(node.module).startswith("jax._src")]
    assert sum(len(node.names) for node in asked) <= 3


def test_a_report_is_handed_what_it_shows():
    wrong = {m: {n for n in EDGES[m] if place(n) not in REPORT_KNOWS} for m in MODULES if place(m) == "report"}
    assert {module: found for module, found in wrong.items() if found} == {}


def test_the_command_starts_without_jax():
    """What its modules import on top, other than the list of public names, which Python reads first."""

    def on_top(module: str) -> set[str]:
        tree = ast.parse(MODULES[module].read_text(encoding="utf-8"))
        tree.body = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
        return imported(tree, MODULES)

    start = f"{PACKAGE}.cli.main"
    modules = {start} | reached(start, {module: own(on_top(module)) for module in MODULES})
    outside = {name.split(".")[0] for module in modules for name in on_top(module)} - {PACKAGE}
    assert outside - sys.stdlib_module_names == {"typer", "rich"}


def test_the_tests_see_what_they_are_for():
    text = """
import scipy.optimize
from a import b
from a.c import thing
if TYPE_CHECKING:
    from a.d import Type
def function():
    from a import e
"""
    assert imported(ast.parse(text), {"a", "a.b", "a.c"}) == {"scipy.optimize", "a.b", "a.c", "a.d", "a"}
    assert circles({"a": ["b"], "b": ["c"], "c": ["b"], "d": ["a"]}) == {"b", "c"}
    assert circles({"a": ["a"]}) == {"a"}
