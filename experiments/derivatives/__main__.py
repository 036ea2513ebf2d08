"""`python -m experiments.derivatives`."""

import sys

from experiments import derivatives
from experiments.derivatives import cost, main
from experiments.publish import command

if __name__ == "__main__":
    if "--measure" in sys.argv:
        print(cost.measured(sys.argv[-1]))
    else:
        command(main, derivatives.__doc__)
