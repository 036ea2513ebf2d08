"""`python -m experiments.derivatives`."""

import clearance_jax as cj
from experiments.derivatives import main

if __name__ == "__main__":
    cj.configure(cache=True)
    main()
