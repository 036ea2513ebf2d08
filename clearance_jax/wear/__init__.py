"""Wear of pins and sleeves: laws, pressures, what wears off along a motion and over a life."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
