"""The site: `make docs` writes it to out/site. Sphinx, because it checks every link and reads notebooks as they are;
nothing is loaded from a network when it is read. Pages of public names are made from their docstrings (`_ext/api.py`).
"""

import shutil
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]

# A copy of each notebook, with the outputs that it was saved with: a build runs none of them.
NOTEBOOKS = HERE / "notebooks"
NOTEBOOKS.mkdir(exist_ok=True)
for notebook in (HERE.parent / "experiments" / "notebooks").glob("*.ipynb"):
    shutil.copy(notebook, NOTEBOOKS)

project = "clearance_jax"
author = "the authors of clearance_jax"
extensions = ["myst_nb", "mathml", "api", "outputs", "stale"]
exclude_patterns = ["_build", "_ext", "_outputs", "outputs"]

myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
nb_execution_mode = "off"
nb_ipywidgets_js = {}  # would name a server

html_math_renderer = "mathml"
html_theme = "furo"
html_title = "clearance_jax"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_copyright = False
nitpicky = True

# Docstrings say what arguments are, in which unit and shape; annotations repeat it in longer words.
autodoc_typehints = "none"
autodoc_preserve_defaults = True
autodoc_inherit_docstrings = False
autodoc_member_order = "bysource"
add_module_names = False
smartquotes = False  # q'' is a derivative
toc_object_entries_show_parents = "hide"
