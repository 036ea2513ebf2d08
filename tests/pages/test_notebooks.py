"""Every notebook runs from top to bottom, in its own folder and from the top; its own assertions are the test."""

import importlib
import re
import sys
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient
from places import ROOT

import clearance_jax as cj

sys.path.append(str(ROOT / "docs"))
execute_docs: Any = importlib.import_module("execute")

NOTEBOOKS = sorted((ROOT / "experiments" / "notebooks").glob("*.ipynb"))


# Those whose kernel runs longer than it compiles.
LONG = {"sweeps", "tolerance_design", "wear"}


def ran(path: Path):
    return pytest.param(path, id=path.stem, marks=[pytest.mark.optimised] if path.stem in LONG else [])


def execute(notebook, folder: Path) -> None:
    NotebookClient(notebook, timeout=1200, resources={"metadata": {"path": str(folder)}}).execute()


def pictures(notebook) -> list:
    return [o for cell in notebook.cells for o in cell.get("outputs", []) if "image/png" in o.get("data", {})]


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # the kernel's own machinery warns; the cells run with warnings as they are
@pytest.mark.parametrize("path", [ran(path) for path in NOTEBOOKS])
def test_notebook_runs_in_its_own_folder(path, monkeypatch):
    monkeypatch.delenv("CLEARANCE_KEPT", raising=False)  # its kernel keeps its programs, as a user's does
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        cell.pop("outputs", None)
    execute(notebook, path.parent)
    assert pictures(notebook)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_finds_its_scenes_from_the_top(path, monkeypatch):
    """Its first cell, which reads them, without a kernel."""
    notebook = nbformat.read(path, as_version=4)
    first = next(cell.source for cell in notebook.cells if cell.cell_type == "code")
    assert "cj.examples" in first
    monkeypatch.chdir(ROOT)
    # What begins with % is IPython's.
    exec(compile(re.sub("(?m)^%", "#", first), path.stem, "exec"), {"__name__": "notebook"})


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_published_with_its_outputs(path):
    """`make notebooks` runs them and keeps what they show; small enough to live with the source."""
    notebook = nbformat.read(path, as_version=4)
    assert pictures(notebook)
    assert all(cell.execution_count for cell in notebook.cells if cell.cell_type == "code")
    assert path.stat().st_size < 400_000


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_outputs_of_a_notebook_are_of_its_code(path):
    notebook = nbformat.read(path, as_version=4)
    assert notebook.metadata.get("outputs", {}).get("code") == execute_docs.code_key(notebook), "run `make notebooks`"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_takes_public_names_only(path):
    """What it imports of the library is the library, or one of its public modules or names."""
    for cell in nbformat.read(path, as_version=4).cells:
        for module, names in re.findall(r"(?m)^from (clearance_jax[.\w]*) import (.*)$", cell.source):
            home: Any = cj
            for part in module.split(".")[1:]:
                home = getattr(home, part)
            assert all(name.split()[0] in home.__all__ for name in names.split(", ")), f"{module}: {names}"
            assert module == "clearance_jax" or module.split(".")[1] in cj.__all__, module
