"""`python -m experiments.derivatives`."""

import sys

import clearance_jax as cj
from experiments.derivatives import cost, main

if __name__ == "__main__":
    if "--measure" in sys.argv:
        print(cost.measured(sys.argv[-1]))
    else:
        cj.configure(cache=True)
        main()
