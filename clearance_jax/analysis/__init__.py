"""What is asked of a motion: signals, metrics, derivatives by name, limit cycles, trust."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
