"""Analysis of a motion: derivatives by name and whether to trust them, limit cycles, modes of the play."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
