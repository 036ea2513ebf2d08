"""Tolerance design: the largest or cheapest clearances that keep errors and forces within bounds."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
