"""A module imports its own or lower layers, without circles; device code knows no xarray, matplotlib, pint or scipy."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / "clearance_jax"
LAYERS = [
    {"_types", "_checks", "_numerics", "configure"},
    {"spatial", "laws", "units", "fits"},
    {"joints"},
    {"mechanism"},
    {"equations", "energy", "dynamics"},
    {"tolerances", "variation", "interpolate", "watch", "stepping", "control", "flow", "solve", "trace"}
    | {"signals", "observers", "metrics", "sensitivity", "periodic", "trust", "mesh"},
    {"results", "scene"},
    {"plot", "design"},
    {"study"},
    {"cli"},
]
HOST_ONLY = {"xarray", "matplotlib", "tomllib", "pint", "scipy", "typer", "rich"}
DEVICE = set().union(*LAYERS[:6]) - {"units", "fits"}
MODULES = sorted(path for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py")


def part(module: str) -> str:
    return module.split(".")[1]


def level(name: str) -> int:
    return next(i for i, names in enumerate(LAYERS) if name in names)


def imports(path: Path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} uses a relative import"
            yield node.module or ""


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_down(path):
    own = path.relative_to(ROOT).parts[0].removesuffix(".py")
    for module in imports(path):
        if module.startswith("clearance_jax."):
            other = part(module)
            assert level(other) <= level(own), (own, module)
        if own in DEVICE:
            assert module.split(".")[0] not in HOST_ONLY, (own, module)


def test_no_import_circles():
    graph = {
        p: {part(m) for m in imports(p) if m.startswith("clearance_jax.")}
        - {p.relative_to(ROOT).parts[0].removesuffix(".py")}
        for p in MODULES
    }
    edges: dict[str, set[str]] = {}
    for path, others in graph.items():
        edges.setdefault(path.relative_to(ROOT).parts[0].removesuffix(".py"), set()).update(others)

    def reach(start: str) -> set[str]:
        seen, stack = set(), list(edges.get(start, ()))
        while stack:
            name = stack.pop()
            if name not in seen:
                seen.add(name)
                stack += edges.get(name, ())
        return seen

    circles = [name for name in edges if name in reach(name)]
    assert circles == []
