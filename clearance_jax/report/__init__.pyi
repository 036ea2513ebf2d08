from . import figures as figures
from . import sweep_figures as sweep_figures
from . import wear_figures as wear_figures
