import os

import jax
import matplotlib as mpl
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
if "JAX_COMPILATION_CACHE_DIR" in os.environ:
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
mpl.use("Agg")

_hook = install_import_hook("clearance_jax", "beartype.beartype")
_hook.__enter__()
