"""Cases that are difficult for contact solvers, each at three tolerances beside a reference (see `__main__`)."""
