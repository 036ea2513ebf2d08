"""Drivers of steps: one motion by diffrax, lanes side by side, batches on every core, traces in blocks."""
