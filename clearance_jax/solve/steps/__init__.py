"""The step: try, error control, events, what watches it."""
