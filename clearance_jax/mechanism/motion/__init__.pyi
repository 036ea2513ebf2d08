from . import drives as drives
from . import paths as paths
