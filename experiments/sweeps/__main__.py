"""`python -m experiments.sweeps`; and the processes of their own that it starts."""

import json
import sys

import clearance_jax as cj
from experiments import sweeps
from experiments.publish import command
from experiments.sweeps import budget

if __name__ == "__main__":
    if sys.argv[1:2] == ["memory"]:
        cj.configure(cache=True)
        print(json.dumps(budget.stages(int(sys.argv[2]))))
    else:
        command(sweeps.main, sweeps.__doc__)
