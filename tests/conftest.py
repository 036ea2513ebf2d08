import jax
import matplotlib as mpl
from jaxtyping import install_import_hook

jax.config.update("jax_numpy_rank_promotion", "raise")
mpl.use("Agg")

_hook = install_import_hook("clearance_jax", "beartype.beartype")
_hook.__enter__()

import clearance_jax  # noqa: E402  (the hook must come first)

clearance_jax.configure(cache=True)
