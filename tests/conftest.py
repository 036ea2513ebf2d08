import os
from pathlib import Path

import jax
import matplotlib as mpl
import pytest
from jaxtyping import install_import_hook

jax.config.update("jax_numpy_rank_promotion", "raise")
mpl.use("Agg")

_hook = install_import_hook("clearance_jax", "beartype.beartype")
_hook.__enter__()

import clearance_jax  # noqa: E402  (the hook must come first)

os.environ["CLEARANCE_KEPT"] = "0"  # a test may patch what a kept program was made of
clearance_jax.configure(cache=True)

# Linux lets a process have 65530 mappings. Every compiled program takes some, which it keeps, and where there are no
# more XLA crashes: so programs are let go long before, between files, whose tests share them.
MANY_MAPPINGS = 16_000


@pytest.fixture(autouse=True, scope="module")
def _programs_let_go():
    yield
    mappings = Path("/proc/self/maps")
    if mappings.exists() and len(mappings.read_bytes().splitlines()) > MANY_MAPPINGS:
        jax.clear_caches()
