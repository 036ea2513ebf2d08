"""`python -m experiments.paper`."""

from experiments import paper
from experiments.paper.page import main
from experiments.publish import command

if __name__ == "__main__":
    command(main, paper.__doc__, "the plane alone, two readings, two figures, one metric")
