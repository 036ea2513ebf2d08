from . import actuators as actuators
from . import controllers as controllers
from . import drives as drives
from . import paths as paths
