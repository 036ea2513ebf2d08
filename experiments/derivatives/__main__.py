"""`python -m experiments.derivatives`: all of it, or one part that needs no other."""

import sys

from experiments import derivatives
from experiments.derivatives import closed_forms, cost, finite, ladder, main
from experiments.publish import command

ALONE = {"ladder": ladder, "closed_forms": closed_forms, "cost": cost, "finite": finite}

if __name__ == "__main__":
    part = ALONE.get(sys.argv[1]) if len(sys.argv) > 1 else None
    if "--measure" in sys.argv:
        print(cost.measured(sys.argv[-1]))
    elif part is not None:
        del sys.argv[1]
        command(part.main, part.__doc__)
    else:
        command(main, derivatives.__doc__)
