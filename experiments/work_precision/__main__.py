"""`python -m experiments.work_precision`."""

from experiments import work_precision
from experiments.publish import command

if __name__ == "__main__":
    command(work_precision.main, work_precision.__doc__)
