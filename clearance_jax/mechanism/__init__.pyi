from . import actuators as actuators
from . import controllers as controllers
