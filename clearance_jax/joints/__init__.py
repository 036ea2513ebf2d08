"""Clearance joints: geometry x normal law x friction law."""

from clearance_jax.joints.revolute import Contact, RevoluteClearance, Signals

__all__ = ["Contact", "RevoluteClearance", "Signals"]
