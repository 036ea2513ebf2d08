"""Writes a motion as one HTML file with the viewer in it. The file needs no network."""

import html
import importlib.resources
import json
from pathlib import Path

import xarray as xr

from clearance_jax.errors import wrong_value
from clearance_jax.results.store import whole_file
from clearance_jax.viewer.meshes import with_meshes
from clearance_jax.viewer.scene import Fidelity, describe, motion_of

# Most bytes of numbers in a page, unless asked for more: with the script, and in base64, a page stays below 2 MB.
BYTES = 900_000
# Bytes of a sample there, by what is counted.
ROW = {"mark": 12, "joint": 19, "any_joint": 12}
HEIGHT = 860  # of a notebook's frame [px]


class View:
    """A page that shows a motion. Make one with `cj.view`. A notebook shows it by itself.

    - `title`: of the page.
    - `html`: the whole page.
    - `fidelity`: how many samples it keeps, and how far lines between them are from all samples [m].
    """

    def __init__(self, title: str, html: str, fidelity: Fidelity):
        self.title, self.html, self.fidelity = title, html, fidelity

    def save(self, path: str | Path) -> Path:
        """Write the page. It is written completely or not at all.

        **Raises:** `ClearanceError` if the file cannot be written.
        """
        with whole_file(path) as partial:
            partial.write_text(self.html, encoding="utf-8")
        return Path(path)

    def __repr__(self) -> str:
        return f"View of {self.title}, {len(self.html) / 1e6:.2f} MB. {self.fidelity}"

    def _repr_html_(self) -> str:
        style = f"width:100%;height:{HEIGHT}px;border:1px solid #dce2e8"
        title = html.escape(self.title)
        return f'<iframe title="{title}" style="{style}" srcdoc="{html.escape(self.html)}"></iframe>'


def view(
    dataset: xr.Dataset, *, urdf: str | Path | None = None, title: str | None = None, samples: int | None = None
) -> View:
    """A motion as a page: `cj.view(dataset).save("motion.html")`. It works from disk without a network.

    It shows the mechanism as it moves, the ideal mechanism behind it, their distance enlarged, forces, the paths of
    points, and each joint's pin in its sleeve.

    **Arguments:**

    - `dataset`: of `to_dataset`, with two samples at least.
    - `urdf`: the robot's file, to show its meshes (needs the extra `meshes`). The page says which were not found.
    - `title`: of the page; by default the mechanism's name.
    - `samples`: the most samples over time that the page keeps, >= 2; by default so many that it stays below 2 MB.
      Those are kept that matter most. The page and its `repr` say how far lines between them are from all samples.

    **Raises:** `ClearanceError` for a dataset without a motion.
    """
    if samples is not None and not (samples == int(samples) and samples >= 2):
        raise wrong_value("`samples`", "a whole number, at least 2", samples)
    row = 1 + sum(size * dataset.sizes.get(label, 0) for label, size in ROW.items())
    title = str(dataset.attrs.get("mechanism", "mechanism")) if title is None else title
    most = int(samples or max(BYTES // row, 100))
    motion = motion_of(dataset, most)
    scene, fidelity = describe(motion, title, most)
    if urdf is not None:
        with_meshes(scene, motion, urdf)
    static = importlib.resources.files("clearance_jax.viewer").joinpath("static")
    page, script = (static.joinpath(name).read_text(encoding="utf-8") for name in ("page.html", "viewer.js"))
    # Inside a script an end tag or a comment in a text would end it.
    text = json.dumps(scene | {"arrays": motion.numbers.entries}, allow_nan=False).replace("<", "\\u003c")
    page = page.format(title=html.escape(title), scene=text, numbers=motion.numbers.text(), script=script)
    return View(title, page, fidelity)
