"""clearance_jax: mechanisms and robots with clearance joints in JAX.

The public names are those of `__init__.pyi`. They are imported when they are first asked for: the command's help must
not wait for JAX.
"""

from typing import Any

import lazy_loader

from clearance_jax.errors import suggest

_imported, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name not in __all__:
        hint = "" if name.startswith("_") else " " + suggest(name, __all__)
        raise AttributeError(f"clearance_jax has no `{name}`.{hint}", name=name)
    return _imported(name)
