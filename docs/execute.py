"""Run the notebooks and keep their outputs, which the site shows: `python docs/execute.py` (`make notebooks`).

Each keeps a key of the code that made its outputs, and the seconds that it took: a test says when the code is another.
"""

import hashlib
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).parents[1] / "experiments" / "notebooks"


def code_key(notebook: nbformat.NotebookNode) -> str:
    """A short name of the code in its cells."""
    code = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
    return hashlib.sha256(code.encode()).hexdigest()[:16]


def executed(path: Path) -> nbformat.NotebookNode:
    """A notebook with its outputs, run in its own folder; without what differs from one run to the next."""
    notebook = nbformat.read(path, as_version=4)
    began = time.perf_counter()
    NotebookClient(notebook, timeout=1800, resources={"metadata": {"path": str(path.parent)}}).execute()
    notebook.metadata["outputs"] = {"code": code_key(notebook), "seconds": round(time.perf_counter() - began)}
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        # Objects print where they are in memory beside the pictures that they are.
        for output in cell.get("outputs", []):
            if "image/png" in output.get("data", {}):
                output.data.pop("text/plain", None)
    return notebook


if __name__ == "__main__":
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        nbformat.write(executed(path), path)
        took = nbformat.read(path, as_version=4).metadata["outputs"]["seconds"]
        print(path.name, f"{path.stat().st_size / 1e3:.0f} kB, {took} s", flush=True)
