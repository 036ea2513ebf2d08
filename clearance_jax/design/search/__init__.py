"""The search: programs, methods, starts, models of cheap and dear motions, tolerance classes."""
