"""Metrics: a reduction over time (`Peak`, `Rms`, `At`, ...) of a signal of a motion (`PositionError`, ...)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
