"""Run the notebooks and keep their outputs, which the site shows: `python docs/execute.py` (`make notebooks`)."""

from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).parents[1] / "experiments" / "notebooks"


def executed(path: Path) -> nbformat.NotebookNode:
    """A notebook with its outputs, run in its own folder; without what differs from one run to the next."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=1800, resources={"metadata": {"path": str(path.parent)}}).execute()
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
        print(path.name, f"{path.stat().st_size / 1e3:.0f} kB")
