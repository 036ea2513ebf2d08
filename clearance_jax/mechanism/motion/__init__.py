"""Motions that are given: laws of time, robot controllers' drives, paths in space."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
